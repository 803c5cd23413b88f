"""The distance at which shares cross a level, without a curve: isotonic shares are interpolated.

Shares that may only rise with distance (isotonic regression, weighted by the trials) are

    s_k = max over i <= k of min over j >= k of hits(i..j) / trials(i..j)

(the max-min formula; Robertson, Wright and Dykstra, Order Restricted Statistical Inference, 1988,
section 1.4). The crossing lies on the straight line between the last share below the level and the
next one.
"""

from __future__ import annotations

import math

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.stats import Estimate, Labels, bca_interval, cluster_codes, cluster_sums

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


def crossing(distance: FloatArray, shares: FloatArray, level: float) -> FloatArray:
    """Return the (B,) distances at which shares reach a level, mm.

    This is the first distance where all shares are at the level or above, and the last distance
    where none is.

    Args:
        distance: (K,) mm, rising.
        shares: (B, K) shares that never fall with the distance.
        level: The level that is reached.
    """
    reached = shares >= level
    after = np.where(reached.any(axis=1), reached.argmax(axis=1), len(distance) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.arange(len(shares))
    low, high = shares[rows, before], shares[rows, after]
    inside = (after > 0) & (high >= level) & (low > -np.inf)
    # -inf where no smaller distance has trials: the step lies at the next one
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(inside, (level - low) / (high - low), 1.0)
    return np.asarray(distance[before] + part * (distance[after] - distance[before]))


def interpolated_threshold(
    distance: FloatArray,
    hits: FloatArray,
    press: Labels,
    share: float,
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
        share: The share that is crossed.
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
        return crossing(distances, isotonic_shares(weights @ yes, weights @ all_), share)

    shares = isotonic_shares(yes.sum(axis=0)[None], all_.sum(axis=0)[None])
    value = float(crossing(distances, shares, share)[0])
    first, last = float(distances[0]), float(distances[-1])
    censored = "<" if shares[0, 0] >= share else ">" if shares[0, -1] < share else None
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
