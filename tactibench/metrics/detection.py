"""Numbers of contacts: missed and spurious ones, single presses taken for two, and GOSPA.

GOSPA is location error and missing or false contacts in one number that no omission improves:

    d = (min over assignments of  sum over pairs of distance^p  +  c^p / 2 * unpaired)^(1/p)

of one frame, c the gate, alpha = 2, unpaired = true plus predicted contacts without a partner
(Rahmathullah, Garcia-Fernandez and Svensson 2017, equation 1 and proposition 1). The metric is the
mean over frames.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from scipy.special import ndtri  # scipy.stats takes a second to import

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.spec import MetricSpec, Rows, Sample, mean_metric, members
from tactibench.metrics.trials import CATCH, Trials, match
from tactibench.stats import (
    Estimate,
    Labels,
    cluster_codes,
    effective_size,
    rate_interval,
    share_interval,
    t_quantile,
)


def missed(trials: Trials) -> Sample:
    """Return one value per true contact: 1 where no prediction lies inside the gate, else 0."""
    trial = np.repeat(np.arange(len(trials)), trials.true_counts)
    values = np.ones(len(trial))
    starts = np.cumsum(trials.true_counts) - trials.true_counts
    values[starts[trials.matched.trial] + trials.matched.truth] = 0.0
    return Sample(values, trial)


def spurious(trials: Trials) -> Sample:
    """Return one value per frame: the number of unmatched predictions."""
    extra = trials.predicted_counts - trials.matched.per_trial(len(trials))
    return Sample(extra.astype(np.float64), np.arange(len(trials)))


def catch_resolved(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the share of catch trials (one true contact) that were answered with exactly two."""
    catch = members(trials, CATCH)
    two = (trials.predicted_counts[catch] == 2).astype(np.float64)
    yield "all", share_interval(two, trials.press[catch], level=trials.level)


def d_prime(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the sensitivity of "more than one" against "one", over two-point and catch trials."""
    catch = members(trials, CATCH)
    more = (trials.predicted_counts >= 2).astype(np.float64)
    yield (
        "all",
        sensitivity(
            more[~catch], more[catch], trials.press[~catch], trials.press[catch], trials.level
        ),
    )


def sensitivity(
    hits: FloatArray, alarms: FloatArray, hit_press: Labels, alarm_press: Labels, level: float
) -> Estimate:
    """Return z(H) - z(F), both rates log-linear: (count + 0.5) / (trials + 1) (Hautus 1995).

    The interval follows from var = sum over both rates of p (1 - p) / (n phi(z)^2) (Gourevitch and
    Galanter 1967), with the corrected rates and the effective, clustered n. So it keeps a width
    where a rate is 0 or 1, which is the usual case and where no bootstrap has any spread.

    Args:
        hits: (n,) 1 for a two-point trial that was answered with more than one contact, else 0.
        alarms: (m,) the same of catch trials.
        hit_press: (n,) press ids, the clusters.
        alarm_press: (m,) press ids, the clusters.
        level: Level of the interval.

    Returns:
        The estimate. It has no value without trials of both sorts, and no interval where a sort has
        fewer than two presses.
    """
    n = len(hits) + len(alarms)
    counts = [cluster_codes(press, len(press))[1] for press in (hit_press, alarm_press)]
    if not len(hits) or not len(alarms):
        return Estimate(None, None, None, n, sum(counts))
    rates = [(x.sum() + 0.5) / (len(x) + 1) for x in (hits, alarms)]
    z = ndtri(rates)
    value = float(z[0] - z[1])
    if min(counts) < 2:
        return Estimate(value, None, None, n, sum(counts))
    sizes = [effective_size(hits, hit_press), effective_size(alarms, alarm_press)]
    variance = sum(
        p * (1 - p) / (size * density(q) ** 2) for p, q, size in zip(rates, z, sizes, strict=True)
    )
    half = t_quantile(level, sum(counts) - 1) * math.sqrt(variance)
    return Estimate(value, value - half, value + half, n, sum(counts))


def density(z: float) -> float:
    """Return the density of the standard normal distribution at z."""
    return math.exp(-z * z / 2) / math.sqrt(2 * math.pi)


def gospa(truth: FloatArray, predicted: FloatArray, gate: float, power: int) -> float:
    """GOSPA of (K, D) true and (M, D) predicted points of D axes, mm."""
    _, _, distance = match(truth, predicted, gate, power)
    unpaired = len(truth) + len(predicted) - 2 * len(distance)
    return float(((distance**power).sum() + gate**power / 2 * unpaired) ** (1 / power))


DEPTH_GOSPA = "gospa_depth_mm"
"""Name of GOSPA that counts the depth; ``gospa1_mm`` and ``gospa2_mm`` are in the plane."""


def finite_gate(trials: Trials, metric: str) -> float:
    """Return the gate, mm; raise UserError where it is not finite."""
    if not np.isfinite(trials.gate):
        raise UserError(
            f"metric {metric!r} needs a finite gate, but the gate is {trials.gate} mm: "
            "set a number of millimetres in the protocol."
        )
    return trials.gate


def gospa_per_frame(trials: Trials, power: int) -> Sample:
    """One value per frame, mm."""
    gate = finite_gate(trials, f"gospa{power}_mm")
    pairs = zip(trials.truth, trials.predictions, strict=True)
    values = np.array([gospa(t.xy, p.xy, gate, power) for t, p in pairs], dtype=np.float64)
    return Sample(values, np.arange(len(values)))


def gospa_with_depth(trials: Trials) -> Sample:
    """One value per frame, mm: GOSPA over x, y and depth; in the plane where no depth is known."""
    gate = finite_gate(trials, DEPTH_GOSPA)
    values = []
    for true, seen in zip(trials.truth, trials.predictions, strict=True):
        pair = [
            np.column_stack([c.xy, c.depth]) if true.knows_depth else c.xy for c in (true, seen)
        ]
        values.append(gospa(pair[0], pair[1], gate, power=1))
    return Sample(np.array(values, dtype=np.float64), np.arange(len(values)))


GOSPA_SPECS = tuple(
    mean_metric(
        f"gospa{power}_mm",
        "mm",
        "lower",
        f"mean over frames of (min sum d^{power} + c^{power}/2 (missed + spurious))"
        f"^(1/{power}), c = gate",
        partial(gospa_per_frame, power=power),
    )
    for power in (1, 2)
)
SPECS = (
    mean_metric(
        "missed",
        "share",
        "lower",
        "true contacts without a partner inside the gate / true contacts",
        missed,
        share_interval,
    ),
    mean_metric(
        "spurious",
        "per frame",
        "lower",
        "predictions without a partner inside the gate / frames",
        spurious,
        rate_interval,
    ),
    MetricSpec(
        "catch_resolved",
        "share",
        "lower",
        "catch trials answered with exactly two contacts / catch trials",
        catch_resolved,
    ),
    MetricSpec(
        "d_prime",
        "",
        "higher",
        "z((h + 0.5) / (n + 1)) - z((f + 0.5) / (m + 1)); h of n "
        "two-point trials and f of m catch trials answered with two contacts or more",
        d_prime,
    ),
    *GOSPA_SPECS,
    mean_metric(
        DEPTH_GOSPA,
        "mm",
        "lower",
        "gospa1_mm with d the distance in x, y and depth; in the plane where no depth is known",
        gospa_with_depth,
    ),
)
