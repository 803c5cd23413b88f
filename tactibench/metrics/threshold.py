"""Two-point trials: the errors of pairs, and the threshold at which 75 % of them are resolved.

*Resolved* means exactly two predictions, both matched inside the gate.

The psychometric curve of resolved against distance has a threshold m, a slope b >= 0 and a lapse
rate g, the share of pairs that is lost whatever their distance:

    P(resolved | d) = (1 - g) / (1 + exp(-(log(0.75 / (0.25 - g)) + b (d - m))))

so that P(m) = 0.75 of all pairs for every g. It is fitted by maximum likelihood over the distances
tested, with 0 <= g <= 0.1.

The interval is that of the profile likelihood, {m : 2 (L_max - L(m)) <= t^2 phi}, which needs no
standard error and therefore survives a perfect step, where the slope is infinite. t is Student's
quantile with presses - 1 degrees of freedom; phi, the mean squared press sum of the residuals over
their mean square (at least 1), widens it when frames share a press.

The deviance compares the fitted curve with the measured share at every distance:

    D = 2 sum_k (h_k log(h_k / (n_k P_k)) + (n_k - h_k) log((n_k - h_k) / (n_k (1 - P_k))))

Its p is that of a parametric bootstrap: counts are drawn from the fitted curve and fitted again. A
chi-square with distances - parameters degrees of freedom would be too lenient: where the curve is
near 0 or 1, a distance adds next to nothing to D, and a parameter at its bound frees nothing
(Wichmann and Hill, Perception & Psychophysics 63, 2001, pages 1293-1313).

Where the curve does not fit, the threshold is the distance at which the isotonic shares cross 75 %.
Shares that may only rise with distance (isotonic regression, weighted by the trials) are

    s_k = max over i <= k of min over j >= k of hits(i..j) / trials(i..j)

(the max-min formula; Robertson, Wright and Dykstra, Order Restricted Statistical Inference, 1988,
section 1.4). The crossing lies on the straight line between the last share below the level and the
next one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import expit, log_expit, logit, xlogy

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.spec import (
    Mask,
    MetricSpec,
    Rows,
    Sample,
    by_condition,
    condition,
    mean_metric,
    members,
)
from tactibench.metrics.trials import Trials
from tactibench.stats import (
    Estimate,
    IntArray,
    Labels,
    bca_interval,
    cluster_codes,
    cluster_sums,
    median_by_ranks,
    share_interval,
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
whatever the last bit of a likelihood, unless a few trials leave the likelihood flat there."""


@dataclass(frozen=True)
class Profile:
    """Likelihood of a threshold at its best slope and lapse rate.

    Attributes:
        distance: (K,) mm, rising.
        hits: (K,) resolved pairs at each distance.
        trials: (K,) pairs at each distance.
    """

    distance: FloatArray
    hits: FloatArray
    trials: FloatArray

    def eta(self, threshold: FloatArray, slope: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return (M, K) log odds of a resolved trial among those that do not lapse.

        Args:
            threshold: (M,) mm.
            slope: (M,) 1/mm.
            lapse: (M,) lapse rates.
        """
        offset = self.distance[None, :] - threshold[:, None]
        middle = np.log(SHARE / (1 - SHARE - lapse))
        return np.asarray(middle[:, None] + slope[:, None] * offset)

    def slope(self, threshold: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return the (M,) most likely slope of each threshold, 1/mm, found by bisection.

        Args:
            threshold: (M,) mm.
            lapse: (M,) lapse rates.
        """
        low, high = np.zeros(len(threshold)), np.full(len(threshold), STEEPEST)
        offset = self.distance[None, :] - threshold[:, None]
        rate = lapse[:, None]
        for _ in range(60):
            middle = (low + high) / 2
            eta = self.eta(threshold, middle, lapse)
            missing = expit(-eta)
            residual = self.hits - self.trials * (1 - rate) * expit(eta)
            # dP/d(eta) / (P (1 - P)), which is 1 without lapses
            residual *= missing / (rate + (1 - rate) * missing)
            rising = (residual * offset).sum(axis=1) > 0
            low, high = np.where(rising, middle, low), np.where(rising, high, middle)
        return np.asarray((low + high) / 2)

    def _at_lapse(self, threshold: FloatArray, lapse: FloatArray) -> FloatArray:
        """Return the (M,) log likelihood of each threshold with its lapse rate."""
        eta = self.eta(threshold, self.slope(threshold, lapse), lapse)
        hit, miss = _log_shares(eta, lapse[:, None])
        terms = self.hits * hit + (self.trials - self.hits) * miss
        return np.asarray(terms.sum(axis=1), dtype=np.float64)

    def lapse(self, threshold: FloatArray) -> FloatArray:
        """Return the (M,) most likely lapse rate of each threshold."""
        best = np.full(len(threshold), MOST_LAPSES / 2)
        rows, half = np.arange(len(threshold)), MOST_LAPSES / 2
        for _ in range(LAPSE_ROUNDS):
            tried = best[:, None] + half * np.linspace(-1, 1, LAPSES)
            tried = np.clip(tried, 0.0, MOST_LAPSES)
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

    def curve(self, threshold: float) -> tuple[FloatArray, float]:
        """Return log odds (K,) and lapse rate of the most likely curve of one threshold."""
        at = np.array([threshold])
        lapse = self.lapse(at)
        return self.eta(at, self.slope(at, lapse), lapse)[0], float(lapse[0])


def _log_shares(eta: FloatArray, lapse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return log P of a resolved pair and of one that is not, (M, K) each.

    Args:
        eta: (M, K) log odds of a pair that does not lapse.
        lapse: (M, 1) lapse rates.
    """
    hit, miss = np.log1p(-lapse) + log_expit(eta), np.log1p(-lapse) + log_expit(-eta)
    with np.errstate(divide="ignore"):
        return hit, np.logaddexp(np.log(lapse), miss)


class ThresholdFit(NamedTuple):
    """A threshold with its interval, the lapse rate of the fit, and how well the curve fits.

    Attributes:
        estimate: The threshold, mm.
        lapse: Lapse rate of the fit; None where nothing could be fitted, or no pair was resolved.
        goodness: Goodness of the fit; None where nothing could be fitted.
    """

    estimate: Estimate
    lapse: float | None = None
    goodness: Goodness | None = None


def fit_threshold(
    distance: FloatArray, hits: FloatArray, press: Labels, *, level: float = 0.95
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
    """
    distances, index = np.unique(distance, return_inverse=True)
    codes, clusters = cluster_codes(press, len(distance))
    n = len(distance)
    if len(distances) < 2:
        return Estimate(None, None, None, n, clusters)
    profile = _profile(distances, index, hits)
    best, censored = _most_likely(profile, hits.mean() >= SHARE)
    if clusters < 2:
        return Estimate(best, None, None, n, clusters, censored)
    eta, lapse = profile.curve(best)
    probability = (1 - lapse) * expit(eta)[index]
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
    """
    estimate = fit_threshold(distance, hits, press, level=level)
    if estimate.value is None:
        return ThresholdFit(estimate)
    distances, index = np.unique(distance, return_inverse=True)
    profile = _profile(distances, index, hits)
    eta, lapse = profile.curve(estimate.value)
    curve = (float(eta[0]), float(eta[-1]), lapse)
    codes, clusters = cluster_codes(press, len(distance))
    # From the measured shares: residuals of a curve that does not fit agree within a press.
    spread = _inflation(hits - (profile.hits / profile.trials)[index], codes, clusters)
    goodness = goodness_of_fit(distances, profile.hits, profile.trials, curve, spread=spread)
    if goodness.p is not None and goodness.p < MISFIT:
        estimate = interpolated_threshold(distance, hits, press, rng=rng, level=level)
    # Where no pair is resolved, every lapse rate is as likely.
    return ThresholdFit(estimate, lapse if hits.any() else None, goodness)


def _profile(distances: FloatArray, index: IntArray, hits: FloatArray) -> Profile:
    k = len(distances)
    yes = np.bincount(index, hits, k).astype(np.float64)
    return Profile(distances, yes, np.bincount(index, minlength=k).astype(np.float64))


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
    rng = np.random.default_rng(SEED)
    return checked_threshold(*_answers(trials), rng=rng, level=trials.level)


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


UNDEFINED_AXIS_DEG = 45.0
"""Error of a pair whose two predictions coincide: the mean error of a random axis."""


def two_point_trials(trials: Trials) -> IntArray:
    """Return the indices of all trials but catch trials.

    Raises:
        UserError: A trial that is no catch trial has another number of true contacts than two.
    """
    index = np.flatnonzero(members(trials, "all"))
    for i in index[trials.true_counts[index] != 2]:
        raise UserError(
            f"the metrics of two-point trials (distance_mae_mm, resolved, threshold_mm ...) need "
            f"two true contacts a trial, but trial {i} of group {trials.group[i]!r} has "
            f"{trials.true_counts[i]}: take them out of the protocol or mark it 'catch'."
        )
    return index


def is_resolved(trials: Trials) -> Mask:
    """Return (N,) whether a trial has exactly two predictions, both matched inside the gate."""
    matched = trials.matched.per_trial(len(trials))
    counted = (trials.predicted_counts == 2) & (trials.true_counts == 2)
    return np.asarray(counted & (matched == 2))


def resolved(trials: Trials) -> Sample:
    """Return 1 for every resolved two-point trial, 0 for the others."""
    index = two_point_trials(trials)
    return Sample(is_resolved(trials)[index].astype(np.float64), index)


def pair_vectors(trials: Trials) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the vectors between the two contacts of resolved trials.

    Returns:
        (n, 2) vectors between the true tips, (n, 2) vectors between their partners, mm, and (n,)
        their trials.
    """
    index = two_point_trials(trials)
    index = index[is_resolved(trials)[index]]
    pairs = trials.matched
    rows = np.isin(pairs.trial, index)
    true, predicted = pairs.true_xy[rows], pairs.predicted_xy[rows]
    return true[1::2] - true[::2], predicted[1::2] - predicted[::2], index


def distance_errors(trials: Trials) -> Sample:
    """Return |predicted - true distance of the pair| of every resolved trial, mm."""
    true, predicted, index = pair_vectors(trials)
    return Sample(np.abs(_length(predicted) - _length(true)), index)


def penalised_distance_errors(trials: Trials) -> Sample:
    """Return the errors of `distance_errors`, and the true distance of trials not resolved, mm."""
    index = two_point_trials(trials)
    tips = np.array([trials.truth[i].xy for i in index]).reshape(-1, 2, 2)
    values = np.zeros(len(trials))
    values[index] = _length(tips[:, 1] - tips[:, 0])
    errors = distance_errors(trials)
    values[errors.trial] = errors.values
    return Sample(values[index], index)


def orientation_errors(trials: Trials) -> Sample:
    """Return the angle between the true and predicted axis of resolved trials, 0..90 deg."""
    true, predicted, index = pair_vectors(trials)
    cross = true[:, 0] * predicted[:, 1] - true[:, 1] * predicted[:, 0]
    dot = (true * predicted).sum(axis=1)
    angle = np.degrees(np.arctan2(np.abs(cross), np.abs(dot)))
    undefined = (cross == 0) & (dot == 0)
    return Sample(np.where(undefined, UNDEFINED_AXIS_DEG, angle), index)


def _length(vectors: FloatArray) -> FloatArray:
    return np.hypot(vectors[:, 0], vectors[:, 1])


RESAMPLES = 999
"""Data sets drawn from the curve: p is a multiple of 0.001."""
SEED = 75
"""Seed of the random numbers of a fit: equal answers get equal results, wherever they are
scored."""
TIE = 1e-6
"""Relative difference below which deviances are equal: the same counts may be drawn again, and a
fit leaves a small error."""
FLATTEST = 0.01
"""Limits of the slope of a fit, 1/mm: flat over all distances, and a step."""
STEPS, IDLE = 60, 3
"""Most steps of a fit, and steps without gain after which it ends."""
GAIN = 1e-10
"""Smallest decrease of a deviance that counts as a gain: verification asks for six digits."""
DAMPING = (1e-3, 1e-9, 1e9)
"""First, smallest and largest damping of a step."""


@dataclass(frozen=True)
class Goodness:
    """Deviance of a fit.

    Attributes:
        deviance: Deviance, divided by how much frames of one press have in common.
        freedom: Degrees of freedom: number of distances less number of parameters.
        p: How often chance makes the deviance as large; None without freedom, where the curve
            passes through all shares.
    """

    deviance: float
    freedom: int
    p: float | None


@dataclass(frozen=True)
class CurveFits:
    """Curves fitted to many tables of counts at once.

    The parameters are the log odds in the middle of the distances, the log of the slope, and the
    lapse rate: a curve is not worse because it crosses 75 % where nothing was tested, or nowhere.

    Attributes:
        distance: (K,) mm, rising.
        trials: (K,) pairs at each distance.
    """

    distance: FloatArray
    trials: FloatArray

    @property
    def offset(self) -> FloatArray:
        """The (K,) distances, less the middle one, mm."""
        return np.asarray(self.distance - (self.distance[0] + self.distance[-1]) / 2)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The smallest and the largest parameters, (3,) each."""
        far = STEEPEST * float(np.ptp(self.distance))  # a step at either end
        low = np.array([-far, np.log(FLATTEST), 0.0])
        return low, np.array([far, np.log(STEEPEST), MOST_LAPSES])

    def eta(self, at: FloatArray) -> FloatArray:
        """Return (B, K) log odds that a pair is resolved if it does not lapse, of curves (B, 3)."""
        return np.asarray(at[:, :1] + np.exp(at[:, 1:2]) * self.offset)

    def deviance(self, hits: FloatArray, at: FloatArray) -> FloatArray:
        """Return the deviances of tables of counts from curves, (B,).

        Args:
            hits: (B, K) resolved pairs.
            at: (B, 3) parameters of the curves.
        """
        hit, miss = _log_shares(self.eta(at), at[:, 2, None])
        missed = self.trials - hits
        saturated = xlogy(hits, hits / self.trials) + xlogy(missed, missed / self.trials)
        return np.asarray(2 * (saturated - hits * hit - missed * miss).sum(axis=1))

    def fit(self, hits: FloatArray, starts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit a curve to every table by damped Fisher scoring within the bounds.

        Args:
            hits: (B, K) resolved pairs.
            starts: (S, 3) parameters from which every fit starts: with lapses the likelihood may
                have two peaks.

        Returns:
            (B, 3) best parameters and (B,) their deviances.
        """
        low, high = self.bounds
        count, tries = len(hits), len(starts)
        at = np.tile(np.clip(starts, low, high), (count, 1))
        hits = np.repeat(hits, tries, axis=0)
        best = self.deviance(hits, at)
        first, least, most = DAMPING
        damping, idle = np.full(len(hits), first), 0
        for _ in range(STEPS):
            tried = np.clip(at + self._step(hits, at, damping, low, high), low, high)
            deviance = self.deviance(hits, tried)
            better = deviance < best
            idle = idle + 1 if (best - deviance).max() < GAIN else 0
            at = np.where(better[:, None], tried, at)
            best = np.where(better, deviance, best)
            damping = np.clip(np.where(better, damping / 5, damping * 4), least, most)
            if idle == IDLE:
                break
        of = np.arange(count) * tries + best.reshape(count, tries).argmin(axis=1)
        return at[of], best[of]

    def _step(
        self,
        hits: FloatArray,
        at: FloatArray,
        damping: FloatArray,
        low: FloatArray,
        high: FloatArray,
    ) -> FloatArray:
        eta, lapse = self.eta(at), at[:, 2, None]
        seen, unseen = expit(eta), expit(-eta)
        p, q = (1 - lapse) * seen, lapse + (1 - lapse) * unseen
        by_eta = p * unseen
        derivative = np.stack(
            [by_eta, np.exp(at[:, 1, None]) * self.offset * by_eta, -seen], axis=2
        )
        score = (((hits - self.trials * p) / (p * q))[:, :, None] * derivative).sum(axis=1)
        # A parameter at its bound stays there where its gradient points beyond the bound.
        held = ((at <= low) & (score < 0)) | ((at >= high) & (score > 0))
        derivative = np.where(held[:, None, :], 0.0, derivative)
        weight = self.trials / (p * q)
        information = np.einsum("bk,bki,bkj->bij", weight, derivative, derivative)
        diagonal = np.einsum("bii->bi", information)
        information = information + (damping[:, None] * (1 + diagonal))[:, :, None] * np.eye(3)
        return np.asarray(
            np.linalg.solve(information, np.where(held, 0.0, score)[:, :, None])[:, :, 0]
        )


def goodness_of_fit(
    distance: FloatArray,
    hits: FloatArray,
    trials: FloatArray,
    curve: tuple[float, float, float],
    *,
    spread: float = 1.0,
) -> Goodness:
    """Return the deviance of the best curve from the shares, and its p.

    Args:
        distance: (K,) mm, rising.
        hits: (K,) resolved pairs.
        trials: (K,) pairs.
        curve: Log odds at the first and the last distance, and lapse rate, at which the search
            begins.
        spread: How much frames of one press have in common, 1 where each frame has a press of its
            own; the deviance is divided by it.
    """
    fits = CurveFits(distance, trials)
    first, last, lapse = curve
    slope = max((last - first) / (distance[-1] - distance[0]), FLATTEST)
    # The curve that was fitted, and others about the mean share: where its threshold was held at an
    # end of the distances, a flat curve may be better.
    mean = float(logit(np.clip(hits.sum() / trials.sum(), 0.01, 0.99)))
    starts = [((first + last) / 2, np.log(slope), lapse)] + [
        (mean, np.log(steepness), rate)
        for steepness in (0.1, 0.5, 2.0)
        for rate in (0.0, MOST_LAPSES / 2, MOST_LAPSES)
    ]
    best, deviances = fits.fit(hits[None], np.array(starts))
    deviance = max(0.0, float(deviances[0])) / spread
    freedom = len(distance) - 3
    if freedom < 1:
        return Goodness(deviance, 0, None)
    # The fitted curve without lapses is another start. Ten starts, as for the data, take ten times
    # as long; without them a few fits of drawn tables stop early, and p comes out too large
    # (0.601 in place of 0.596 on a row of the board), never too small.
    again = best * (1.0, 1.0, 0.0)
    _, drawn = fits.fit(_draw(fits, best[0]), np.concatenate([best, again][: 1 + bool(best[0, 2])]))
    larger = int((drawn >= deviance - TIE * max(1.0, deviance)).sum())
    return Goodness(deviance, freedom, (1 + larger) / (1 + RESAMPLES))


def _draw(fits: CurveFits, at: FloatArray) -> FloatArray:
    """Return (RESAMPLES, K) hits drawn from a curve (3,).

    They are drawn by the inverse of the distribution: a change of the curve's last bit changes no
    other draw.
    """
    from scipy.stats import binom  # takes a second to import

    uniform = np.random.default_rng(SEED).random((RESAMPLES, len(fits.distance)))
    p = (1 - at[2]) * expit(fits.eta(at[None])[0])
    return np.asarray(binom.ppf(uniform, fits.trials, p), dtype=np.float64)


METHOD = "interpolated"
"""``Estimate.method`` of these thresholds."""


def isotonic_shares(hits: FloatArray, trials: FloatArray) -> FloatArray:
    """Return (B, K) shares that never fall with the distance.

    A distance without trials takes a share that its neighbours allow.

    Args:
        hits: (B, K) resolved pairs at K rising distances.
        trials: (B, K) pairs.
    """
    k = hits.shape[1]
    sums = [np.pad(np.cumsum(counts, axis=1), ((0, 0), (1, 0))) for counts in (hits, trials)]
    # [b, i, j]: over the distances i..j
    yes, all_ = (total[:, None, 1:] - total[:, :-1, None] for total in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = yes / all_
    inside = (np.arange(k)[:, None] <= np.arange(k)) & (all_ > 0)
    mean = np.where(inside, mean, np.inf)
    # the smallest mean of i..j over j >= k, for every k
    least = np.minimum.accumulate(mean[:, :, ::-1], axis=2)[:, :, ::-1]
    starts = np.arange(k)[:, None] <= np.arange(k)
    least = np.where(starts & np.isfinite(least), least, -np.inf)
    return np.asarray(least.max(axis=1))


def crossing(distance: FloatArray, shares: FloatArray) -> FloatArray:
    """Return the (B,) distances at which shares reach SHARE, mm.

    This is the first distance where all shares are as large or larger, and the last distance where
    none is.

    Args:
        distance: (K,) mm, rising.
        shares: (B, K) shares that never fall with the distance.
    """
    reached = shares >= SHARE
    after = np.where(reached.any(axis=1), reached.argmax(axis=1), len(distance) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.arange(len(shares))
    low, high = shares[rows, before], shares[rows, after]
    inside = (after > 0) & (high >= SHARE) & (low > -np.inf)
    # -inf where no smaller distance has trials: the step lies at the next one
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(inside, (SHARE - low) / (high - low), 1.0)
    return np.asarray(distance[before] + part * (distance[after] - distance[before]))


def interpolated_threshold(
    distance: FloatArray,
    hits: FloatArray,
    press: Labels,
    *,
    rng: np.random.Generator,
    level: float = 0.95,
) -> Estimate:
    """Return the crossing of the isotonic shares with a BCa bootstrap interval over presses.

    The crossing is censored at the ends of the distances as a fit is; a limit at an end is None.
    With fewer than two distances there is no value.

    Args:
        distance: (N,) mm.
        hits: (N,) 0 or 1.
        press: (N,) press ids, the clusters.
        rng: Random numbers of the bootstrap.
        level: Level of the interval.
    """
    distances, index = np.unique(distance, return_inverse=True)
    codes, clusters = cluster_codes(press, len(distance))
    k = len(distances)
    if k < 2:
        return Estimate(None, None, None, len(distance), clusters)
    pairs = np.eye(k)[index]
    yes, all_ = (cluster_sums(counts, codes, clusters) for counts in (pairs * hits[:, None], pairs))

    def statistic(weights: FloatArray) -> FloatArray:
        return crossing(distances, isotonic_shares(weights @ yes, weights @ all_))

    shares = isotonic_shares(yes.sum(axis=0)[None], all_.sum(axis=0)[None])
    value = float(crossing(distances, shares)[0])
    first, last = float(distances[0]), float(distances[-1])
    censored = "<" if shares[0, 0] >= SHARE else ">" if shares[0, -1] < SHARE else None
    low, high = bca_interval(statistic, clusters, rng=rng, level=level) or (-math.inf, math.inf)
    return Estimate(
        value,
        low if low > first else None,
        high if high < last else None,
        len(distance),
        clusters,
        censored,
        METHOD,
    )


SPECS = (
    mean_metric(
        "distance_mae_mm",
        "mm",
        "lower",
        "mean | |p_1 - p_2| - |t_1 - t_2| | over resolved trials",
        distance_errors,
        groups=by_condition,
    ),
    mean_metric(
        "distance_penalised_mm",
        "mm",
        "lower",
        "as distance_mae_mm over all trials; one that is not resolved counts |t_1 - t_2|",
        penalised_distance_errors,
        groups=by_condition,
    ),
    mean_metric(
        "resolved",
        "share",
        "higher",
        "trials with exactly two predictions, both matched inside the gate / trials",
        resolved,
        share_interval,
        groups=by_condition,
    ),
    mean_metric(
        "orientation_mae_deg",
        "deg",
        "lower",
        "mean angle between the axes through the "
        "two true and the two predicted contacts, modulo 180 deg, over resolved trials",
        orientation_errors,
        groups=by_condition,
    ),
    MetricSpec(
        "threshold_mm",
        "mm",
        "lower",
        "distance m at which a fit of resolved against distance reaches 75 %; censored '<' or '>' "
        "at the ends of the distances tested. The curve is (1 - g) / (1 + exp(-(log(0.75 / "
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
