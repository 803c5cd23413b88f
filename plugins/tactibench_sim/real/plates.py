"""The tabulated answer of the dome to a plate: pressed on it, and dragged along its surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench_sim import sealed

Array = npt.NDArray[np.float64]

FILE = "plates.npz"
FINE_DEG = 0.25
"""Step of the polar angle the tables are refined to, so that linear look-ups do."""
INNER_MM = 19.0
PARTS = ("press", "patch", "drag")
"""Arrays of every dome."""


@dataclass(frozen=True, eq=False)
class Plate:
    """One dome. polar_step: rad.

    press: (D,) depths, mm -> (T, 3) w inward, t away from the contact, mm, and turn omega of the
    inner normal, rad. drag: patch radius, rad -> (T, 5) as ``drag.drag``, per mm. patch: depth ->
    angular radius of what touches, rad.
    """

    deepest: float
    polar_step: float
    press: CubicSpline
    drag: CubicSpline
    patches: Array
    delta: Array
    patch: Array

    def meridians(self, depth: Array) -> Array:
        """(S, T, 8) press and drag of S presses of ``depth`` (S,) mm."""
        radius = np.interp(depth, self.delta, self.patch).clip(self.patches[0], self.patches[-1])
        return np.concatenate([self.press(depth), self.drag(radius)], axis=-1)


@cache
def kinds() -> tuple[str, ...]:
    """Names of the shipped domes: stiffness ratio and friction, "50_stick"."""
    return tuple(sorted(n.removesuffix("_press") for n in _shipped() if n.endswith("_press")))


@cache
def plate(kind: str) -> Plate:
    """The tables of one dome, refined in the polar angle."""
    content = _shipped()
    delta, polar, patches = content["delta"], content["polar"], content["patches"]
    fine = np.radians(np.arange(round(90 / FINE_DEG) + 1) * FINE_DEG)
    press = CubicSpline(polar, content[f"{kind}_press"], axis=1)(fine)
    drag = CubicSpline(polar, content[f"{kind}_drag"], axis=1)(fine)
    return Plate(
        deepest=float(delta[-1]),
        polar_step=float(fine[1]),
        press=CubicSpline(delta, press, axis=0),
        drag=CubicSpline(patches, drag, axis=0),
        patches=patches,
        delta=delta,
        patch=content[f"{kind}_patch"],
    )


@cache
def digest() -> str:
    """Hash of the shipped tables' file."""
    return sha256(files(__package__).joinpath(FILE).read_bytes()).hexdigest()


def read(path: Path) -> dict[str, Array]:
    """Arrays of a file of plates. Raises UserError where it is unreadable or its hash is wrong."""
    return sealed.read(path, "the tables of plates", "reinstall tactibench.", _arrays)


def _arrays(arrays: sealed.Arrays, parameters: dict[str, Any], _: str) -> dict[str, Array]:
    wanted = ["delta", "polar", "patches"]
    wanted += [f"{kind}_{part}" for kind in parameters["kinds"] for part in PARTS]
    return {name: arrays[name].astype(np.float64) for name in wanted}


@cache
def _shipped() -> dict[str, Array]:
    with as_file(files(__package__).joinpath(FILE)) as path:
        return read(path)
