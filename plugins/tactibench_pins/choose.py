"""Which setting of the kernel regression fits frames that it has not learned from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_pins.components import Components
from tactibench_pins.ridge import Setting, kernel, weights

Array = npt.NDArray[np.float64]

START = Setting()
CHOICES: Mapping[str, tuple[Any, ...]] = {
    "ridge": (1e-3, 1e-2, 3e-2, 1e-1),
    "components": (20, 40, 60),
    "length": (0.7, 1.0, 1.5),
    "whitening": (0.25, 0.5),
}
"""What is tried, in this order, each at the best of what was tried before."""
MOST = max(CHOICES["components"])


@dataclass(frozen=True, eq=False)
class Features:
    """Displacements (N, 2 P) that are learned from, and normalised targets (N, T)."""

    components: Components
    moved: Array
    targets: Array

    def places(self, setting: Setting, moved: Array | None = None) -> tuple[Array, float]:
        """(M, K) of displacements (these, if none are given), and the kernel's length."""
        some = self.components.first(setting.components)
        own = some.of(self.moved, setting.whitening)
        length = setting.length * float(np.sqrt(np.square(own).sum(axis=1).mean()))
        return (own if moved is None else some.of(moved, setting.whitening)), max(length, 1e-9)


def best(learned: Features, held: Array, wanted: Array) -> Setting:
    """The setting with the least mean absolute error of (M, T) targets ``wanted`` of ``held``."""
    found = START
    least = error(learned, held, wanted, found)
    for name, values in CHOICES.items():
        for value in values:
            tried = replace(found, **{name: value})
            if value == getattr(found, name):
                continue
            mae = error(learned, held, wanted, tried)
            if mae < least:
                least, found = mae, tried
    return found


def error(learned: Features, held: Array, wanted: Array, setting: Setting) -> float:
    """Mean absolute error of the normalised targets of frames that were held out."""
    own, length = learned.places(setting)
    alpha = weights(kernel(own, own, length), learned.targets, setting)
    there, _ = learned.places(setting, held)
    return float(np.abs(kernel(there, own, length) @ alpha - wanted).mean())
