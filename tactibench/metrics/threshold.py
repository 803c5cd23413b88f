"""Two-point threshold: the distance at which 75 % of the pairs are resolved.

Psychometric curve with threshold m, slope b >= 0 and lapse rate g, the share of pairs that is lost
whatever their distance:

    P(resolved | d) = (1 - g) / (1 + exp(-(log(0.75 / (0.25 - g)) + b (d - m))))

so that P(m) = 0.75 of all pairs for every g, and m means the same in all fits. The curve is fitted
by maximum likelihood over the distances tested, with 0 <= g <= g_max. Protocols whose
``test.psychometric`` is "logistic" (the default, and all first versions) have g_max = 0. With
"lapse" g_max is 0.1, the goodness of the fit is reported (``tactibench.metrics.goodness``), and the
interpolated crossing replaces a curve that does not fit (``tactibench.metrics.crossing``).

The interval is that of the profile likelihood, {m : 2 (L_max - L(m)) <= t^2 phi}, which needs no
standard error and therefore survives a perfect step, where the slope is infinite. t is Student's
quantile with presses - 1 degrees of freedom; phi, the mean squared press sum of the residuals over
their mean square (at least 1), widens it when frames share a press.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import expit, log_expit

from tactibench.contacts import FloatArray
from tactibench.metrics.crossing import interpolated_threshold
from tactibench.metrics.goodness import SEED, Goodness, goodness_of_fit
from tactibench.metrics.groups import condition, members
from tactibench.metrics.separation import resolved
from tactibench.metrics.spec import MetricSpec, Rows
from tactibench.metrics.trials import Trials
from tactibench.stats import (
    Estimate,
    IntArray,
    Labels,
    cluster_codes,
    cluster_sums,
    median_by_ranks,
    t_quantile,
)

SHARE = 0.75
"""Share of pairs resolved at the threshold, the usual choice of psychophysics."""
STEEPEST = 50.0
"""Largest slope, 1/mm: from 5 % to 95 % in 0.12 mm, which looks like a step."""
GRID = 221
"""Thresholds tried before the best is refined: every 0.025 mm over 6.5..12 mm."""
MOST_LAPSES = 0.1
"""Largest lapse rate of a fit. A model that loses more than a tenth of the widest pairs does not
lapse, it fails; and with a larger bound the rate could imitate a slow rise (Wichmann and Hill 2001
bound it by 0.06 for people)."""
MISFIT = 0.01
"""Smallest p at which the fit is used. At 0.05 every twentieth model that the curve describes would
lose its fit; a table has ten rows. With 100 pairs per distance, the p of a curve that is off by a
tenth of the pairs at two distances lies far below."""
LAPSES = 11
"""Lapse rates tried at once; each round after the first searches between two neighbours."""
LAPSE_ROUNDS = 8
"""Rounds of that search: the last step is 3e-8, so that the threshold is the same within 1e-6 mm
whatever the last bit of a likelihood."""


@dataclass(frozen=True)
class Profile:
    """Likelihood of a threshold at its best slope and lapse rate.

    Attributes:
        distance: (K,) mm, rising.
        hits: (K,) resolved pairs at each distance.
        trials: (K,) pairs at each distance.
        most_lapses: g_max, the largest lapse rate.
    """

    distance: FloatArray
    hits: FloatArray
    trials: FloatArray
    most_lapses: float = 0.0

    def logit(
        self, threshold: FloatArray, slope: FloatArray, lapse: FloatArray | float = 0.0
    ) -> FloatArray:
        """Return (M, K) log odds of a resolved trial among those that do not lapse.

        Args:
            threshold: (M,) mm.
            slope: (M,) 1/mm.
            lapse: (M,) lapse rates, or one for all.
        """
        offset = self.distance[None, :] - threshold[:, None]
        middle = np.log(SHARE / (1 - SHARE - np.asarray(lapse, dtype=np.float64)))
        return np.asarray(np.atleast_1d(middle)[:, None] + slope[:, None] * offset)

    def slope(self, threshold: FloatArray, lapse: FloatArray | float = 0.0) -> FloatArray:
        """Return the (M,) most likely slope of each threshold, 1/mm, found by bisection.

        Args:
            threshold: (M,) mm.
            lapse: (M,) lapse rates, or one for all.
        """
        low, high = np.zeros(len(threshold)), np.full(len(threshold), STEEPEST)
        offset = self.distance[None, :] - threshold[:, None]
        rate = np.atleast_1d(np.asarray(lapse, dtype=np.float64))[:, None]
        for _ in range(60):
            middle = (low + high) / 2
            eta = self.logit(threshold, middle, lapse)
            missing = expit(-eta)
            residual = self.hits - self.trials * (1 - rate) * expit(eta)
            # dP/d(eta) / (P (1 - P)), which is 1 without lapses
            residual *= missing / (rate + (1 - rate) * missing)
            rising = (residual * offset).sum(axis=1) > 0
            low, high = np.where(rising, middle, low), np.where(rising, high, middle)
        return np.asarray((low + high) / 2)

    def _at_lapse(self, threshold: FloatArray, lapse: FloatArray | float) -> FloatArray:
        """Return the (M,) log likelihood of each threshold with its lapse rate."""
        eta = self.logit(threshold, self.slope(threshold, lapse), lapse)
        rate = np.atleast_1d(np.asarray(lapse, dtype=np.float64))[:, None]
        hit, miss = np.log1p(-rate) + log_expit(eta), np.log1p(-rate) + log_expit(-eta)
        with np.errstate(divide="ignore"):
            miss = np.logaddexp(np.log(rate), miss)
        terms = self.hits * hit + (self.trials - self.hits) * miss
        return np.asarray(terms.sum(axis=1), dtype=np.float64)

    def lapse(self, threshold: FloatArray) -> FloatArray:
        """Return the (M,) most likely lapse rate of each threshold."""
        best = np.full(len(threshold), self.most_lapses / 2)
        if not self.most_lapses:
            return best
        rows, half = np.arange(len(threshold)), self.most_lapses / 2
        for _ in range(LAPSE_ROUNDS):
            tried = best[:, None] + half * np.linspace(-1, 1, LAPSES)
            tried = np.clip(tried, 0.0, self.most_lapses)
            likelihood = self._at_lapse(np.repeat(threshold, LAPSES), tried.ravel())
            best = tried[rows, likelihood.reshape(-1, LAPSES).argmax(axis=1)]
            half *= 2 / (LAPSES - 1)
        return best

    def log_likelihood(self, threshold: FloatArray) -> FloatArray:
        """Return the (M,) log likelihood of each threshold."""
        return self._at_lapse(threshold, self.lapse(threshold))

    def at(self, threshold: float) -> float:
        """Return the log likelihood of one threshold."""
        return float(self.log_likelihood(np.array([threshold]))[0])

    def curve(self, threshold: float) -> tuple[float, float, float]:
        """Return threshold, slope and lapse rate of the most likely curve of one threshold."""
        at = np.array([threshold])
        lapse = self.lapse(at)
        return threshold, float(self.slope(at, lapse)[0]), float(lapse[0])


class ThresholdFit(NamedTuple):
    """A threshold with its interval, the lapse rate of the fit, and how well the curve fits.

    Attributes:
        estimate: The threshold, mm.
        lapse: Lapse rate of the fit; None where nothing could be fitted.
        goodness: Goodness of the fit; None where nothing could be fitted.
    """

    estimate: Estimate
    lapse: float | None = None
    goodness: Goodness | None = None


def fit_threshold(
    distance: FloatArray,
    hits: FloatArray,
    press: Labels,
    *,
    level: float = 0.95,
    most_lapses: float = 0.0,
) -> Estimate:
    """Return the threshold of a fitted curve, with the interval of the profile likelihood.

    The threshold is censored "<" at the shortest distance when the fit lies nowhere below 75 %, and
    ">" at the longest when it stays below everywhere. A limit beyond the tested distances is None.
    With fewer than two distances there is no value.

    Args:
        distance: (N,) mm.
        hits: (N,) 0 or 1.
        press: (N,) press ids, the clusters.
        level: Level of the interval.
        most_lapses: g_max, the largest lapse rate.
    """
    distances, index = np.unique(distance, return_inverse=True)
    codes, clusters = cluster_codes(press, len(distance))
    n = len(distance)
    if len(distances) < 2:
        return Estimate(None, None, None, n, clusters)
    profile = _profile(distances, index, hits, most_lapses)
    best, censored = _most_likely(profile, hits.mean() >= SHARE)
    if clusters < 2:
        return Estimate(best, None, None, n, clusters, censored)
    _, slope, lapse = profile.curve(best)
    eta = profile.logit(np.array([best]), np.array([slope]), lapse)
    probability = (1 - lapse) * expit(eta)[0, index]
    drop = t_quantile(level, clusters) ** 2 / 2 * _inflation(hits - probability, codes, clusters)
    low, high = _limits(profile, best, profile.at(best) - drop)
    return Estimate(best, low, high, n, clusters, censored)


def checked_threshold(
    distance: FloatArray,
    hits: FloatArray,
    press: Labels,
    *,
    rng: np.random.Generator,
    level: float = 0.95,
    most_lapses: float = MOST_LAPSES,
) -> ThresholdFit:
    """Return the threshold of ``fit_threshold`` with its goodness of fit.

    Where p is below MISFIT, the threshold is the interpolated crossing of the isotonic shares, with
    a bootstrap interval over presses, and its ``method`` is "interpolated".

    Args:
        distance: (N,) mm.
        hits: (N,) 0 or 1.
        press: (N,) press ids, the clusters.
        rng: Random numbers of the bootstrap over presses; p has random numbers of its own.
        level: Level of the interval.
        most_lapses: g_max, the largest lapse rate.
    """
    estimate = fit_threshold(distance, hits, press, level=level, most_lapses=most_lapses)
    if estimate.value is None:
        return ThresholdFit(estimate)
    distances, index = np.unique(distance, return_inverse=True)
    profile = _profile(distances, index, hits, most_lapses)
    _, slope, lapse = profile.curve(estimate.value)
    eta = profile.logit(np.array([estimate.value]), np.array([slope]), lapse)[0]
    curve = (float(eta[0]), float(eta[-1]), lapse)
    codes, clusters = cluster_codes(press, len(distance))
    # From the measured shares: residuals of a curve that does not fit agree within a press.
    spread = _inflation(hits - (profile.hits / profile.trials)[index], codes, clusters)
    goodness = goodness_of_fit(
        distances, profile.hits, profile.trials, curve, most_lapses=most_lapses, spread=spread
    )
    if goodness.p is not None and goodness.p < MISFIT:
        estimate = interpolated_threshold(distance, hits, press, SHARE, rng=rng, level=level)
    return ThresholdFit(estimate, lapse, goodness)


def _profile(
    distances: FloatArray, index: IntArray, hits: FloatArray, most_lapses: float
) -> Profile:
    k = len(distances)
    yes = np.bincount(index, hits, k).astype(np.float64)
    return Profile(distances, yes, np.bincount(index, minlength=k).astype(np.float64), most_lapses)


def _most_likely(profile: Profile, mostly_resolved: bool) -> tuple[float, str | None]:
    """Return the most likely threshold, mm, and "<" or ">" where it is censored, else None.

    The profile has one peak, so a threshold at an end of the distances is censored.
    """
    grid = np.linspace(profile.distance[0], profile.distance[-1], GRID)
    likelihood = profile.log_likelihood(grid)
    peak = int(likelihood.argmax())
    if np.ptp(likelihood) < 1e-9:  # flat: the answers do not rise with distance at all
        peak = 0 if mostly_resolved else GRID - 1
    bracket = (grid[max(peak - 1, 0)], grid[min(peak + 1, GRID - 1)])
    optimum = minimize_scalar(
        lambda m: -profile.at(m), bounds=bracket, method="bounded", options={"xatol": 1e-6}
    )
    better = float(-optimum.fun) > float(likelihood[peak]) + 1e-12
    best = float(optimum.x) if better else float(grid[peak])
    if best == grid[0]:
        return best, "<"
    return best, ">" if best == grid[-1] else None


def _inflation(residual: FloatArray, codes: IntArray, clusters: int) -> float:
    square = float((residual**2).sum())
    if square == 0:
        return 1.0
    sums = cluster_sums(residual, codes, clusters)
    return max(1.0, float((sums**2).sum()) / square)


def _limits(profile: Profile, best: float, cut: float) -> tuple[float | None, float | None]:
    """Return where the profile falls to ``cut`` on either side of ``best``, mm.

    A side is None where it does not fall so far within the tested distances.
    """
    sides: list[float | None] = []
    for end in (float(profile.distance[0]), float(profile.distance[-1])):
        if end == best or profile.at(end) >= cut:
            sides.append(None)
        else:
            sides.append(float(brentq(lambda m: profile.at(m) - cut, best, end, xtol=1e-6)))
    return sides[0], sides[1]


def threshold(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the threshold of the trials whose group is named by a distance, mm."""
    if trials.psychometric == "logistic":
        yield "all", fit_threshold(*_answers(trials), level=trials.level)
    else:
        yield "all", _fit(trials).estimate


def _answers(trials: Trials) -> tuple[FloatArray, FloatArray, Labels]:
    """Return (N,) distances, 0/1 answers and press ids of trials whose group is a distance."""
    answers = resolved(trials)
    numbers = [condition(name) for name in trials.group]
    use = np.array([numbers[i] is not None for i in answers.trial], dtype=bool)
    use &= members(trials, "all")[answers.trial]
    index = answers.trial[use]
    distance = np.array([numbers[i] for i in index], dtype=np.float64)
    return distance, answers.values[use], trials.press[index]


@lru_cache(maxsize=1)  # five metrics of one test come from one fit, which takes seconds
def _fit(trials: Trials) -> ThresholdFit:
    """Return the checked fit; its seed is fixed, so that equal answers give equal fits."""
    most = 0.0 if trials.psychometric == "logistic" else MOST_LAPSES
    rng = np.random.default_rng(SEED)
    return checked_threshold(*_answers(trials), rng=rng, level=trials.level, most_lapses=most)


def _number(
    read: Callable[[ThresholdFit], float | None],
) -> Callable[[Trials, np.random.Generator], Rows]:
    """Return the function that yields one number of the fit, without an interval."""

    def rows(trials: Trials, _rng: np.random.Generator) -> Rows:
        fit = _fit(trials)
        yield "all", Estimate(read(fit), None, None, fit.estimate.n, fit.estimate.clusters)

    return rows


def _of_goodness(name: str) -> Callable[[ThresholdFit], float | None]:
    return lambda fit: None if fit.goodness is None else getattr(fit.goodness, name)


def limit(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the median of the presses' known limits, mm, with its interval by ranks."""
    limits = np.empty(0) if trials.limit is None else trials.limit[~np.isnan(trials.limit)]
    yield "all", median_by_ranks(limits, level=trials.level)


SPECS = (
    MetricSpec(
        "threshold_mm",
        "mm",
        "lower",
        "distance m at which a logistic fit of resolved "
        "against distance reaches 75 %; censored '<' or '>' at the ends of the distances "
        "tested. Where test.psychometric is 'lapse', the curve is (1 - g) / (1 + exp(-(log(0.75 / "
        "(0.25 - g)) + b (d - m)))) with 0 <= g <= 0.1; where its p is below 0.01, m is the "
        "crossing of the isotonic shares, interpolated (method 'interpolated')",
        threshold,
    ),
    MetricSpec(
        "threshold_lapse",
        "1",
        "none",
        "lapse rate g of that fit: the share of pairs lost whatever their distance",
        _number(lambda fit: fit.lapse),
    ),
    MetricSpec(
        "threshold_deviance",
        "1",
        "none",
        "2 sum over distances of (h log(h / n P) + (n - h) log((n - h) / n (1 - P))) / phi, h of n "
        "pairs resolved, P of the fit, phi >= 1 what frames of one press have in common",
        _number(_of_goodness("deviance")),
    ),
    MetricSpec(
        "threshold_freedom",
        "1",
        "none",
        "degrees of freedom of threshold_deviance: distances less parameters of the curve",
        _number(_of_goodness("freedom")),
    ),
    MetricSpec(
        "threshold_p",
        "1",
        "none",
        "share of 999 data sets drawn from the fitted curve and fitted again whose deviance is as "
        "large, the data themselves counted as one",
        _number(_of_goodness("p")),
    ),
    MetricSpec(
        "limit_mm",
        "mm",
        "none",
        "median over presses of the spacing s at which sqrt(min over single contacts of sum of "
        "(m_2(s) - m_1)^2 / v over pixels) is 3.0: 75 % of pairs and 1 % of single presses seen "
        "as two by the likelihood ratio",
        limit,
    ),
)
