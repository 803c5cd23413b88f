"""Statistics of the order of values alone, without a shape of their distribution."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import binom

from tactibench.stats.clusters import FloatArray
from tactibench.stats.intervals import Estimate


def median_by_ranks(values: FloatArray, *, level: float = 0.95) -> Estimate:
    """Return the median of (n,) independent values; inf stands for a value beyond all others.

    The k-th smallest and the k-th largest are the limits, k the largest number for which a
    binomial(n, 1/2) is below k with probability (1 - level) / 2 at most (Conover, Practical
    Nonparametric Statistics, 1999, section 3.2). Both limits are None where k is 0, and a median or
    limit that is inf is None.
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
