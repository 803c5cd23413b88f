"""Measure how often a 95 % interval holds the true mean when frames of one press are alike.

    python benchmarks/interval_coverage.py [--errors normal|gamma] [--frames 50] [--runs 1000]
                                           [--seed 0]
    python benchmarks/interval_coverage.py --threshold [--runs 200]

Prints, for within-press correlations 0, 0.05 and 0.3 and for 10, 30 and 100 presses, the coverage
of the interval that takes frames for independent, of the clustered t interval, and of the BCa and
the percentile bootstrap over presses. An error is a part of the press plus a part of the frame,
which makes the correlation exact: normal, or (--errors gamma) skewed as absolute errors are. Exit
code 1 when the coverage of the clustered t interval, which the metrics use, is outside 93 to 97 %
in a line.

With --threshold: observers that lose 0, 3 or 8 % of all pairs judge 100 pairs at each of the twelve
distances of exp2. Prints the error of the threshold and how often its interval holds the true one,
for four ways: the logistic fit of the first versions, the fit with a lapse rate, the interpolated
crossing, and the value that "lapse" protocols record, which is a fit or a crossing. Also prints how
often p reports a misfit. A fourth observer follows no logistic curve: from 10 mm on it sees nearly
all pairs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from scipy import stats
from scipy.special import expit

from tactibench.metrics import SHARE, checked_threshold, fit_threshold, interpolated_threshold
from tactibench.stats import bca_interval, bootstrap_values, mean_interval

CORRELATIONS = (0.0, 0.05, 0.3)
PRESSES = (10, 30, 100)
TARGET = (0.93, 0.97)
MEAN = 2.0
"""True mean of an error; the gamma errors have this variance too, and skewness 1.4."""


def errors(
    rng: np.random.Generator, kind: str, correlation: float, presses: int, frames: int
) -> np.ndarray:
    """Return (presses, frames) errors, sums of a part of the press and a part of the frame.

    Two gammas of one scale add up to a gamma, and two normals to a normal.

    Args:
        rng: Source of the errors.
        kind: "normal" or "gamma".
        correlation: Correlation of two frames of one press.
        presses: Number of presses.
        frames: Number of frames of each press.
    """
    shared, each = (presses, 1), (presses, frames)
    if kind == "normal":
        pressed = rng.normal(MEAN, np.sqrt(correlation), shared)
        return pressed + rng.normal(0, np.sqrt(1 - correlation), each)
    pressed = rng.gamma(MEAN * correlation, size=shared) if correlation else np.zeros(shared)
    return pressed + rng.gamma(MEAN * (1 - correlation), size=each)


def intervals(
    y: np.ndarray, level: float, rng: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Yield the naive, clustered t, BCa and percentile interval of one data set.

    Args:
        y: (presses, frames) errors.
        level: Level of the intervals.
        rng: Source of the bootstraps.
    """
    presses, frames = y.shape
    codes, flat = np.repeat(np.arange(presses), frames), y.ravel()
    yield stats.t.interval(level, flat.size - 1, loc=flat.mean(), scale=stats.sem(flat))
    clustered = mean_interval(flat, codes, level=level)
    assert clustered.low is not None  # noqa: S101
    assert clustered.high is not None  # noqa: S101
    yield clustered.low, clustered.high
    sums, counts = np.bincount(codes, flat), np.bincount(codes)

    def mean(weights: np.ndarray) -> np.ndarray:
        return np.asarray((weights @ sums) / (weights @ counts))

    yield bca_interval(mean, presses, rng=rng, level=level, resamples=1000) or (np.nan, np.nan)
    drawn = bootstrap_values(mean, presses, 1000, rng)
    low, high = np.quantile(drawn, [(1 - level) / 2, (1 + level) / 2])
    yield float(low), float(high)


DISTANCES = np.arange(6.5, 12.01, 0.5)
PAIRS = 100
MIDDLE, SLOPE = 8.6, 1.5
"""Middle, mm, and slope, 1/mm, of the observers' curves: from 5 to 95 % they take 3.9 mm."""


def observers() -> Iterator[tuple[str, np.ndarray, float]]:
    """Yield the name of an observer, its P at every distance and its true threshold, mm.

    The threshold of the observer without a curve is interpolated between two distances.
    """
    for lapse in (0.0, 0.03, 0.08):
        threshold = MIDDLE + np.log(SHARE / (1 - SHARE - lapse)) / SLOPE
        yield f"lapse {lapse:.2f}", (1 - lapse) * expit(SLOPE * (DISTANCES - MIDDLE)), threshold
    p = np.where(DISTANCES < 10, 0.2 + 0.5 * expit(SLOPE * (DISTANCES - MIDDLE)), 0.97)
    at = int((p >= SHARE).argmax())
    part = (SHARE - p[at - 1]) / (p[at] - p[at - 1])
    yield "no curve", p, float(DISTANCES[at - 1] + part * (DISTANCES[at] - DISTANCES[at - 1]))


def threshold_table(runs: int, level: float, seed: int) -> int:
    """Print the table of --threshold and return the exit code.

    The code is 1 where fewer than 90 % of the recorded intervals of an observer hold the truth.

    Args:
        runs: Number of simulated data sets of each observer.
        level: Level of the intervals.
        seed: Seed of the data sets.
    """
    names = ("curve", "crossing", "recorded")
    print(f"{PAIRS} pairs a distance, {runs} runs, nominal {level:.0%}: bias, mm, and coverage")
    print("observer    " + "".join(f"{name:>20s}" for name in names) + "   p < .01   p < .05")
    press, distance = np.arange(PAIRS * len(DISTANCES)), np.repeat(DISTANCES, PAIRS)
    worst = 1.0
    streams = np.random.SeedSequence(seed).spawn(4)
    for (name, p, truth), stream in zip(observers(), streams, strict=True):
        rng = np.random.default_rng(stream)
        off, held, misfits = np.zeros(3), np.zeros(3), np.zeros(2)
        for _ in range(runs):
            hits = (rng.random(len(distance)) < np.repeat(p, PAIRS)).astype(np.float64)
            fit = checked_threshold(distance, hits, press, rng=rng, level=level)
            assert fit.goodness is not None  # noqa: S101
            assert fit.goodness.p is not None  # noqa: S101
            estimates = (
                fit_threshold(distance, hits, press, level=level),
                interpolated_threshold(distance, hits, press, rng=rng, level=level),
                fit.estimate,
            )
            off += [(estimate.value or np.nan) - truth for estimate in estimates]
            held += [
                (estimate.low or -np.inf) <= truth <= (estimate.high or np.inf)
                for estimate in estimates
            ]
            misfits += fit.goodness.p < 0.01, fit.goodness.p < 0.05
        cells = (f"{o:+9.3f} {h:10.1%}" for o, h in zip(off / runs, held / runs, strict=True))
        shares = "".join(f"{share:10.1%}" for share in misfits / runs)
        print(f"{name:12s}" + "".join(cells) + shares, flush=True)
        worst = min(worst, held[-1] / runs)
    return int(worst < 0.90)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--errors", choices=("normal", "gamma"), default="normal")
    parser.add_argument("--frames", type=int, default=50, help="frames of one press")
    parser.add_argument("--runs", type=int, default=1000, help="simulated data sets per line")
    parser.add_argument("--level", type=float, default=0.95)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threshold", action="store_true", help="of the two-point threshold")
    options = parser.parse_args()
    if options.threshold:
        return threshold_table(options.runs, options.level, options.seed)
    print(
        f"{options.errors} errors, {options.frames} frames a press, {options.runs} runs, "
        f"nominal {options.level:.0%}"
    )
    print("correlation  presses   naive  clustered t     BCa  percentile")
    streams = np.random.SeedSequence(options.seed).spawn(len(CORRELATIONS) * len(PRESSES))
    reached = []
    for k, stream in enumerate(streams):
        rng = np.random.default_rng(stream)
        correlation, presses = CORRELATIONS[k // len(PRESSES)], PRESSES[k % len(PRESSES)]
        held = np.zeros(4)
        for _ in range(options.runs):
            y = errors(rng, options.errors, correlation, presses, options.frames)
            limits = np.array(list(intervals(y, options.level, rng)))
            held += (limits[:, 0] <= MEAN) & (limits[:, 1] >= MEAN)
        naive, clustered, bca, percentile = held / options.runs
        print(
            f"{correlation:11.2f} {presses:8d} {naive:7.1%} {clustered:12.1%} {bca:7.1%} "
            f"{percentile:11.1%}"
        )
        reached.append(clustered)
    met = min(reached) >= TARGET[0] and max(reached) <= TARGET[1]
    noise = (options.level * (1 - options.level) / options.runs) ** 0.5
    print(
        f"clustered t: {min(reached):.1%} to {max(reached):.1%}, target {TARGET[0]:.0%} to "
        f"{TARGET[1]:.0%}: {'met' if met else 'missed'} (standard error of a line {noise:.1%})"
    )
    return int(not met)


if __name__ == "__main__":
    sys.exit(main())
