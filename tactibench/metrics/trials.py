"""Truth and predictions of every test frame: all that a metric is computed from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, FloatArray, PlatePose
from tactibench.metrics.matching import Pairs, match_trials
from tactibench.protocols import Axis
from tactibench.stats import IntArray, Labels, finite

CATCH = "catch"
"""Group of the single presses that are mixed into two-point trials."""
NOT_FINITE, RAISED = 1, 2
"""Ways in which a model can fail on a frame; 0 where it answered."""


@dataclass(frozen=True, eq=False)
class Trials:
    """N test frames answered with contacts.

    Attributes:
        truth: True contacts of every frame.
        predictions: Predicted contacts of every frame.
        press: (N,) press ids, the clusters.
        group: One name per frame ("all"; "dual", "triple"; a true distance such as "6.5"; "catch").
        max_depth: Depth that a heat of 1 stands for, mm.
        gate: Distance from which on two contacts are no pair, mm; inf for none.
        level: Level of the intervals.
        maps: (N, H, W) predicted heatmaps.
        surface: (N, H, W) true inward displacement of the skin, mm.
        floor: (N,) mean square by which the encoder's map of the true contacts differs from the
            surface, mm^2.
        bound: (K, 3) Cramer-Rao standard deviations of x, y and depth of every frame, mm; inf for a
            contact that the frame does not show.
        limit: (N,) two-point limits of the sensor, mm; NaN where it was not computed, inf where
            there is none.
        axes: Axes of the families whose cases the groups are.
        failed: (N,) NOT_FINITE or RAISED where the model failed on a frame, which then has no
            predictions, else 0; None where a failure ends the run.
        psychometric: "logistic" or "lapse", the curve of a threshold.

    Raises:
        ValueError: Lengths or shapes do not fit, a value must be finite and is not, the gate, the
            maximum depth or a bound is not positive, or the level does not lie between 0 and 1.
    """

    truth: tuple[Contacts, ...]
    predictions: tuple[Contacts, ...]
    press: Labels
    group: tuple[str, ...]
    max_depth: float = 6.0
    gate: float = 3.0
    level: float = 0.95
    maps: npt.NDArray[Any] | None = None
    surface: npt.NDArray[Any] | None = None
    floor: FloatArray | None = None
    bound: tuple[FloatArray, ...] | None = None
    limit: FloatArray | None = None
    axes: tuple[Axis, ...] = ()
    failed: npt.NDArray[np.int8] | None = None
    psychometric: str = "logistic"

    def __post_init__(self) -> None:
        n = len(self.truth)
        _lengths(n, predictions=self.predictions, press=self.press, group=self.group)
        object.__setattr__(self, "press", np.asarray(self.press))
        _limits(self.level)
        if not self.gate > 0 or not 0 < self.max_depth < np.inf:
            raise ValueError(f"gate {self.gate} mm and max_depth {self.max_depth} mm must be > 0")
        for name in ("maps", "surface"):
            value = getattr(self, name)
            if value is not None:
                _lengths(n, **{name: value})
                if not np.isfinite(value).all():
                    raise ValueError(f"{name} holds a value that is not finite")
                if value.ndim != 3:
                    raise ValueError(f"{name} has shape {value.shape}, expected (N, H, W)")
        if self.maps is not None and self.surface is not None:
            _same_shape(self.maps, self.surface)
        if self.floor is not None:
            _lengths(n, floor=self.floor)
            finite(self.floor, "floor")
        if self.limit is not None:
            _lengths(n, limit=self.limit)
        if self.failed is not None:
            _lengths(n, failed=self.failed)
        if self.bound is not None:
            _lengths(n, bound=self.bound)
            for truth, bound in zip(self.truth, self.bound, strict=True):
                filled = finite(np.where(np.isposinf(bound), 1.0, bound), "bound")
                if filled.shape != (len(truth), 3) or not (filled > 0).all():
                    raise ValueError("a bound is not one positive (x, y, depth) per true contact")

    def __len__(self) -> int:
        return len(self.truth)

    @cached_property
    def matched(self) -> Pairs:
        """Pairs inside the gate."""
        return match_trials(self.truth, self.predictions, self.gate)

    @cached_property
    def ungated(self) -> Pairs:
        """Pairs of the assignment without a gate."""
        return match_trials(self.truth, self.predictions, np.inf)

    @cached_property
    def true_counts(self) -> IntArray:
        """Number of true contacts of every frame, (N,)."""
        return np.array([len(c) for c in self.truth], dtype=np.intp)

    @cached_property
    def predicted_counts(self) -> IntArray:
        """Number of predicted contacts of every frame, (N,)."""
        return np.array([len(c) for c in self.predictions], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class PlateTrials:
    """N test frames answered with plate poses.

    Attributes:
        truth: True pose of every frame.
        predictions: Predicted pose of every frame; None where the frame was not answered.
        press: (N,) press ids, the clusters.
        level: Level of the intervals.
        published: Name of a table -> published predictions of the same N frames.
        group: Group of every frame ("50": answered after 50 labelled frames); () where all frames
            are of one group.

    Raises:
        ValueError: Lengths do not fit, a truth is None, a value is not finite, or the level does
            not lie between 0 and 1.
    """

    truth: tuple[PlatePose | None, ...]
    predictions: tuple[PlatePose | None, ...]
    press: Labels
    level: float = 0.95
    published: Mapping[str, tuple[PlatePose | None, ...]] = field(default_factory=dict)
    group: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _lengths(len(self.truth), predictions=self.predictions, press=self.press, **self.published)
        if self.group:
            _lengths(len(self.truth), group=self.group)
        object.__setattr__(self, "press", np.asarray(self.press))
        _limits(self.level)
        if any(pose is None for pose in self.truth):
            raise ValueError("a plate trial has no truth and cannot be scored")
        for pose in (*self.truth, *self.predictions, *chain(*self.published.values())):
            if pose is not None:
                finite([pose.depth, pose.tilt], "plate pose")

    def __len__(self) -> int:
        return len(self.truth)


def _lengths(n: int, **columns: Any) -> None:
    for name, column in columns.items():
        if len(column) != n:
            raise ValueError(f"{name} has {len(column)} entries for {n} trials")


def _same_shape(maps: npt.NDArray[Any], surface: npt.NDArray[Any]) -> None:
    if maps.shape != surface.shape:
        raise ValueError(f"maps have shape {maps.shape}, the surface has {surface.shape}")


def _limits(level: float) -> None:
    if not 0 < level < 1:
        raise ValueError(f"level is {level}, it must lie between 0 and 1")
