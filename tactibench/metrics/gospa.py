"""GOSPA: location error and missing or false contacts in one number that no omission improves.

    d = (min over assignments of  sum over pairs of distance^p  +  c^p / 2 * unpaired)^(1/p)

of one frame, c the gate, alpha = 2, unpaired = true plus predicted contacts without a partner
(Rahmathullah, Garcia-Fernandez and Svensson 2017, equation 1 and proposition 1). The metric is the
mean over frames.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from tactibench.contacts import FloatArray
from tactibench.errors import UserError
from tactibench.metrics.groups import by_kind, mean_metric
from tactibench.metrics.matching import match
from tactibench.metrics.spec import Sample
from tactibench.metrics.trials import Trials
from tactibench.stats import positive_mean_interval


def gospa(truth: FloatArray, predicted: FloatArray, gate: float, power: int) -> float:
    """GOSPA of (K, 2) true and (M, 2) predicted points, mm."""
    _, _, distance = match(truth, predicted, gate, power)
    unpaired = len(truth) + len(predicted) - 2 * len(distance)
    return float(((distance**power).sum() + gate**power / 2 * unpaired) ** (1 / power))


def gospa_per_frame(trials: Trials, power: int) -> Sample:
    """One value per frame, mm."""
    if not np.isfinite(trials.gate):
        raise UserError(
            f"metric 'gospa{power}_mm' needs a finite gate, but the gate is {trials.gate} mm: "
            f"set a number of millimetres in the protocol."
        )
    pairs = zip(trials.truth, trials.predictions, strict=True)
    values = np.array([gospa(t.xy, p.xy, trials.gate, power) for t, p in pairs], dtype=np.float64)
    return Sample(values, np.arange(len(values)))


SPECS = tuple(
    mean_metric(
        f"gospa{power}_mm",
        "mm",
        "lower",
        f"mean over frames of (min sum d^{power} + c^{power}/2 (missed + spurious))"
        f"^(1/{power}), c = gate",
        partial(gospa_per_frame, power=power),
        positive_mean_interval,
        by_kind,
    )
    for power in (1, 2)
)
