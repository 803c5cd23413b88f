"""The kernel file: the dome's response to a force on a small cap, piecewise cubic in the chord.

A field is four quantities of the angle theta from the force: w outer, t outer / sin theta, w inner,
t inner / sin theta, all even in the chord q = 2 sin(theta / 2). A *tableau* holds their cubic
coefficients, cell by cell: (C, 4 quantities, 4 powers), lowest power first.

The response at the apex stands for every place of the dome: the clamped rim is taken to be 90 deg
from each force, which is exact at the apex only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench_sim import data_file

Array = npt.NDArray[np.float64]
FILE = "kernel.npz"
MODES = 2
"""Singular vectors kept of the secant correction; they leave 1.5 % of it (root mean square)."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """Linear response of caps and its softening under load.

    step: chord between samples. log_cap: (A,) log of cap radii, mm. caps: polynomial coefficients
    over log_cap of tableaus, (4, A - 1, C, 4, 4), highest first. modes: (M, C, 4, 4) tableaus.
    force: (F,) knots, E_skin mm^2, and shares: (4, F - 1, M) cubic coefficients of how much of each
    mode a force adds. parameters, digest: of the file.
    """

    step: float
    log_cap: Array
    caps: Array
    modes: Array
    force: Array
    shares: Array
    parameters: dict[str, Any]
    digest: str

    @property
    def inner(self) -> float:
        """Radius of the inner skin, mm."""
        dome = self.parameters["dome"]
        return float(dome["outer"] - dome["skin"])

    @property
    def outer(self) -> float:
        """Radius of the outer skin, mm."""
        return float(self.parameters["dome"]["outer"])


def tableau(chord: Array, fields: Array) -> Array:
    """Return (..., C, 4, 4) of fields (..., 4, N) = w, t, w, t at (N,) uniform chords from 0."""
    sine = chord * np.sqrt(1 - chord**2 / 4)
    even = np.array(fields, dtype=np.float64)
    for odd in (1, 3):
        even[..., odd, 1:] /= sine[1:]
        a, b, c = (even[..., odd, k] for k in (1, 2, 3))
        even[..., odd, 0] = (15 * a - 6 * b + c) / 10  # even quartic through three
    spline = CubicSpline(chord, even, axis=-1, bc_type=("clamped", "not-a-knot"))
    coefficients = np.moveaxis(spline.c[::-1], (0, 1), (-1, -3))  # (..., C, 4 quantities, 4 powers)
    return np.ascontiguousarray(coefficients)


def read(path: Path) -> Kernel:
    """Read a kernel file. Raises UserError where it is unreadable or its hash does not fit."""
    return data_file.read(path, "the simulator's kernel", "reinstall tactibench.", _build)


_ARRAYS = ("chord", "cap", "linear", "force", "dented")


def _build(content: data_file.Arrays, parameters: dict[str, Any], digest: str) -> Kernel:
    arrays = {name: content[name].astype(np.float64) for name in _ARRAYS}
    chord, log_cap = arrays["chord"], np.log(arrays["cap"])
    caps = CubicSpline(log_cap, tableau(chord, arrays["linear"]), axis=0).c
    softer = arrays["dented"][1:] - arrays["dented"][:1]
    flat = softer.reshape(len(softer), -1)
    left, size, right = np.linalg.svd(flat, full_matrices=False)
    modes = right[:MODES].reshape(MODES, *softer.shape[1:])
    force = np.concatenate([[0.0], arrays["force"]])
    share = np.concatenate([np.zeros((1, MODES)), left[:, :MODES] * size[:MODES]])
    return Kernel(
        step=float(chord[1]),
        log_cap=log_cap,
        caps=np.ascontiguousarray(caps),
        modes=tableau(chord, modes),
        force=force,
        shares=np.ascontiguousarray(CubicSpline(force, share, axis=0).c),
        parameters=parameters,
        digest=digest,
    )


@cache
def shipped() -> Kernel:
    """Return the kernel that ships with the package."""
    return data_file.read_shipped(__package__, FILE, read)
