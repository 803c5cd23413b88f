"""Two-point threshold: the distance at which 75 % of the pairs are resolved.

Logistic model, threshold m and slope b >= 0 as its parameters:

    P(resolved | d) = 1 / (1 + exp(-(log 3 + b (d - m))))

fitted by maximum likelihood over the distances tested. The interval is that of the profile
likelihood, {m : 2 (L_max - L(m)) <= t^2 phi}, which needs no standard error and therefore survives
a perfect step, where the slope is infinite. t is Student's quantile with presses - 1 degrees of
freedom; phi, the mean squared press sum of the residuals over their mean square (at least 1),
widens it when frames share a press.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import expit, log_expit
from scipy.stats import binom

from tactibench.contacts import FloatArray
from tactibench.metrics.groups import condition, members
from tactibench.metrics.separation import resolved
from tactibench.metrics.spec import MetricSpec, Rows
from tactibench.metrics.trials import Trials
from tactibench.stats.clusters import IntArray, Labels, cluster_codes, cluster_sums
from tactibench.stats.intervals import Estimate, t_quantile

SHARE = 0.75
"""Share of pairs resolved at the threshold, the usual choice of psychophysics."""
STEEPEST = 50.0
"""Largest slope, 1/mm: from 5 % to 95 % in 0.12 mm, a step to any eye."""
GRID = 221
"""Thresholds tried before the best is refined: every 0.025 mm over 6.5..12 mm."""


@dataclass(frozen=True)
class Profile:
    """Likelihood of a threshold at its best slope. distance, hits, trials: (K,) per distance."""

    distance: FloatArray
    hits: FloatArray
    trials: FloatArray

    def logit(self, threshold: FloatArray, slope: FloatArray) -> FloatArray:
        """Return (M, K) log odds of a resolved trial."""
        offset = self.distance[None, :] - threshold[:, None]
        return math.log(SHARE / (1 - SHARE)) + slope[:, None] * offset

    def slope(self, threshold: FloatArray) -> FloatArray:
        """The (M,) most likely slope for each threshold, by bisection of the concave likelihood."""
        low, high = np.zeros(len(threshold)), np.full(len(threshold), STEEPEST)
        offset = self.distance[None, :] - threshold[:, None]
        for _ in range(60):
            middle = (low + high) / 2
            residual = self.hits - self.trials * expit(self.logit(threshold, middle))
            rising = (residual * offset).sum(axis=1) > 0
            low, high = np.where(rising, middle, low), np.where(rising, high, middle)
        return np.asarray((low + high) / 2)

    def log_likelihood(self, threshold: FloatArray) -> FloatArray:
        """Return the (M,) log likelihood of each threshold."""
        eta = self.logit(threshold, self.slope(threshold))
        terms = self.hits * log_expit(eta) + (self.trials - self.hits) * log_expit(-eta)
        return np.asarray(terms.sum(axis=1), dtype=np.float64)

    def at(self, threshold: float) -> float:
        """Return the log likelihood of one threshold."""
        return float(self.log_likelihood(np.array([threshold]))[0])


def fit_threshold(
    distance: FloatArray, hits: FloatArray, press: Labels, *, level: float = 0.95
) -> Estimate:
    """Threshold from (N,) distances and 0/1 answers.

    Censored "<" at the shortest distance when the fit lies nowhere below 75 %, ">" at the longest
    when it stays below everywhere; a limit beyond the tested distances is None. No value with
    fewer than two distances.
    """
    distances, index = np.unique(distance, return_inverse=True)
    codes, clusters = cluster_codes(press, len(distance))
    n = len(distance)
    if len(distances) < 2:
        return Estimate(None, None, None, n, clusters)
    k = len(distances)
    yes = np.bincount(index, hits, k).astype(np.float64)
    profile = Profile(distances, yes, np.bincount(index, minlength=k).astype(np.float64))
    best, censored = _most_likely(profile, hits.mean() >= SHARE)
    if clusters < 2:
        return Estimate(best, None, None, n, clusters, censored)
    probability = expit(profile.logit(np.array([best]), profile.slope(np.array([best]))))[0, index]
    drop = t_quantile(level, clusters) ** 2 / 2 * _inflation(hits - probability, codes, clusters)
    low, high = _limits(profile, best, profile.at(best) - drop)
    return Estimate(best, low, high, n, clusters, censored)


def _most_likely(profile: Profile, mostly_resolved: bool) -> tuple[float, str | None]:
    """Threshold of largest likelihood; the profile has one peak, so an end means censoring."""
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
    """Return where the profile falls to ``cut`` on either side, within the tested distances."""
    sides: list[float | None] = []
    for end in (float(profile.distance[0]), float(profile.distance[-1])):
        if end == best or profile.at(end) >= cut:
            sides.append(None)
        else:
            sides.append(float(brentq(lambda m: profile.at(m) - cut, best, end, xtol=1e-6)))
    return sides[0], sides[1]


def threshold(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Fit over the trials whose group is a distance; the group's number is the distance."""
    answers = resolved(trials)
    numbers = [condition(name) for name in trials.group]
    use = np.array([numbers[i] is not None for i in answers.trial], dtype=bool)
    use &= members(trials, "all")[answers.trial]
    index = answers.trial[use]
    distance = np.array([numbers[i] for i in index], dtype=np.float64)
    yield (
        "all",
        fit_threshold(distance, answers.values[use], trials.press[index], level=trials.level),
    )


def limit(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the median over the presses whose limit is known, with its interval by ranks."""
    known = np.empty(0) if trials.limit is None else trials.limit[~np.isnan(trials.limit)]
    yield "all", median_by_ranks(known, level=trials.level)


def median_by_ranks(values: FloatArray, *, level: float = 0.95) -> Estimate:
    """Return the median of (n,) independent values; inf stands for one beyond all others.

    The k-th smallest and the k-th largest are the limits, k the largest number for which a
    binomial(n, 1/2) is below k with probability (1 - level) / 2 at most (Conover, Practical
    Nonparametric Statistics, 1999, section 3.2). None where k is 0 or the value is inf.
    """
    n = len(values)
    if not n:
        return Estimate.nothing()
    ordered = np.sort(values)
    k = int(binom.ppf((1 - level) / 2, n, 0.5))
    ends = (float(ordered[k - 1]), float(ordered[n - k])) if k else (math.inf, math.inf)
    middle, low, high = (
        end if math.isfinite(end) else None for end in (float(np.median(ordered)), *ends)
    )
    return Estimate(middle, low, high, n, n)


SPECS = (
    MetricSpec(
        "threshold_mm",
        "mm",
        "lower",
        "distance m at which a logistic fit of resolved "
        "against distance reaches 75 %; censored '<' or '>' at the ends of the distances "
        "tested",
        threshold,
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
