"""How well a psychometric curve fits: its deviance, and how often chance makes it as large.

The deviance compares the fitted curve with the measured share at every distance:

    D = 2 sum_k (h_k log(h_k / (n_k P_k)) + (n_k - h_k) log((n_k - h_k) / (n_k (1 - P_k))))

Its p is that of a parametric bootstrap: counts are drawn from the fitted curve and fitted again. A
chi-square with distances - parameters degrees of freedom would be too lenient: where the curve is
near 0 or 1, a distance adds next to nothing to D, and a parameter at its bound frees nothing
(Wichmann and Hill, Perception & Psychophysics 63, 2001, pages 1293-1313).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, log_expit, logit, xlogy
from scipy.stats import binom

from tactibench.contacts import FloatArray

RESAMPLES = 999
"""Data sets drawn from the curve: p is a multiple of 0.001."""
SEED = 75
"""Seed of the random numbers of a fit: equal answers get equal results, wherever they are
scored."""
TIE = 1e-6
"""Relative difference below which deviances are equal: the same counts may be drawn again, and a
fit leaves a small error."""
FLATTEST, STEEPEST = 0.01, 50.0
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
        most_lapses: g_max, the largest lapse rate.
    """

    distance: FloatArray
    trials: FloatArray
    most_lapses: float

    @property
    def offset(self) -> FloatArray:
        """The (K,) distances, less the middle one, mm."""
        return np.asarray(self.distance - (self.distance[0] + self.distance[-1]) / 2)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The smallest and the largest parameters, (3,) each."""
        far = STEEPEST * float(np.ptp(self.distance))  # a step at either end
        low = np.array([-far, np.log(FLATTEST), 0.0])
        return low, np.array([far, np.log(STEEPEST), self.most_lapses])

    def eta(self, at: FloatArray) -> FloatArray:
        """Return (B, K) log odds that a pair is resolved if it does not lapse, of curves (B, 3)."""
        return np.asarray(at[:, :1] + np.exp(at[:, 1:2]) * self.offset)

    def deviance(self, hits: FloatArray, at: FloatArray) -> FloatArray:
        """Return the deviances of tables of counts from curves, (B,).

        Args:
            hits: (B, K) resolved pairs.
            at: (B, 3) parameters of the curves.
        """
        eta, lapse = self.eta(at), at[:, 2, None]
        hit, miss = np.log1p(-lapse) + log_expit(eta), np.log1p(-lapse) + log_expit(-eta)
        with np.errstate(divide="ignore"):
            miss = np.logaddexp(np.log(lapse), miss)
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
    most_lapses: float = 0.0,
    spread: float = 1.0,
) -> Goodness:
    """Return the deviance of the best curve from the shares, and its p.

    Args:
        distance: (K,) mm, rising.
        hits: (K,) resolved pairs.
        trials: (K,) pairs.
        curve: Log odds at the first and the last distance, and lapse rate, at which the search
            begins.
        most_lapses: g_max, the largest lapse rate.
        spread: How much frames of one press have in common, 1 where each frame has a press of its
            own; the deviance is divided by it.
    """
    fits = CurveFits(distance, trials, most_lapses)
    first, last, lapse = curve
    slope = max((last - first) / (distance[-1] - distance[0]), FLATTEST)
    # The curve that was fitted, and others about the mean share: where its threshold was held at an
    # end of the distances, a flat curve may be better.
    mean = float(logit(np.clip(hits.sum() / trials.sum(), 0.01, 0.99)))
    starts = [((first + last) / 2, np.log(slope), lapse)] + [
        (mean, np.log(steepness), rate)
        for steepness in (0.1, 0.5, 2.0)
        for rate in (0.0, most_lapses / 2, most_lapses)
    ]
    best, deviances = fits.fit(hits[None], np.array(starts))
    deviance = max(0.0, float(deviances[0])) / spread
    freedom = len(distance) - (3 if most_lapses else 2)
    if freedom < 1:
        return Goodness(deviance, 0, None)
    again = best * (1.0, 1.0, 0.0)  # the fitted curve without lapses is another start
    _, drawn = fits.fit(_draw(fits, best[0]), np.concatenate([best, again][: 1 + bool(best[0, 2])]))
    larger = int((drawn >= deviance - TIE * max(1.0, deviance)).sum())
    return Goodness(deviance, freedom, (1 + larger) / (1 + RESAMPLES))


def _draw(fits: CurveFits, at: FloatArray) -> FloatArray:
    """Return (RESAMPLES, K) hits drawn from a curve (3,).

    They are drawn by the inverse of the distribution: a change of the curve's last bit changes no
    other draw.
    """
    uniform = np.random.default_rng(SEED).random((RESAMPLES, len(fits.distance)))
    p = (1 - at[2]) * expit(fits.eta(at[None])[0])
    return np.asarray(binom.ppf(uniform, fits.trials, p), dtype=np.float64)
