"""Make the file of plate tables of the fitted sensors from finite-element runs.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_plates.py OUT RATIO:FRICTION ...

RATIO is E_skin / E_gel, FRICTION is none or stick. It takes minutes a dome. Besides the press, each
dome has the response to a patch of its skin that is dragged sideways: linear and small-strain on
the undeformed dome, incompressible, with one pressure per material. The displacement is of Fourier
order one,

    u_r = a cos(phi), u_phi = b sin(phi), u_z = c cos(phi),

where the plate holds the patch around the apex and moves it by 1 mm along phi = 0. Pre-stress of
the press is left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from axisymmetric import dome_meridian, press
from elements import Dome, require_ngsolve
from fem_script import output_file, write_file, write_tables
from scipy.interpolate import CubicSpline
from tabulate_presses import normal_rotation

Array = npt.NDArray[np.float64]

_TIE = 100.0  # E_skin / mm, holds the patch; the skin then follows 0.99 of the plate's way or more
DEEPEST_MM, STEP_MM, POLAR_STEP_DEG = 6.25, 0.25, 1.0
PATCHES_DEG = (4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0, 36.0, 42.0, 50.0)
_CLEAR_MM = 0.03  # a point of the skin this close under the plate counts as touching


def tabulate(path: Path, kinds: Sequence[tuple[float, str]]) -> str:
    """Write tables of plates on domes and return the file's digest.

    Args:
        path: File to write.
        kinds: Stiffness ratio E_skin / E_gel and friction ("none" or "stick") of each dome.

    Raises:
        UserError: NGSolve is not installed.
        NotConvergedError: A run failed.
    """
    depths = np.arange(round(DEEPEST_MM / STEP_MM) + 1) * STEP_MM
    delta = np.asarray(depths, dtype=np.float64)
    degrees = np.arange(round(90 / POLAR_STEP_DEG) + 1) * POLAR_STEP_DEG
    polar = np.asarray(np.radians(degrees), dtype=np.float64)
    arrays: dict[str, Any] = {}
    for ratio, friction in kinds:
        dome = Dome(stiffness_ratio=ratio, apex_size=0.15)
        profiles = list(press(dome, math.inf, delta, polar, friction=friction))
        w, t = np.stack([p.inner for p in profiles], axis=1)
        outer = np.stack([p.outer for p in profiles], axis=1)
        name = f"{ratio:g}_{friction}"
        fields = np.stack([w, t, normal_rotation(dome.inner, polar, w, t)], axis=-1)
        arrays[f"{name}_press"] = fields.astype(np.float32)
        arrays[f"{name}_patch"] = _patch(dome.outer, delta, polar, outer).astype(np.float32)
        coarse = Dome(stiffness_ratio=ratio, apex_size=0.3, skin_size=0.4)
        arrays[f"{name}_drag"] = drag(coarse, np.radians(PATCHES_DEG), polar).astype(np.float32)
    arrays |= {"delta": delta, "polar": polar, "patches": np.radians(PATCHES_DEG)}
    return write_tables(path, arrays, {"kinds": [f"{r:g}_{friction}" for r, friction in kinds]})


def _patch(radius: float, delta: Array, polar: Array, outer: Array) -> Array:
    """Return the (D,) angular radius of the part of the skin that touches the plate, rad."""
    height = (radius - outer[0]) * np.cos(polar) - outer[1] * np.sin(polar)
    touching = height >= radius - delta[:, None] - _CLEAR_MM
    reach = np.where(touching, polar, 0.0).max(axis=1)
    reach[delta == 0] = 0.0
    return np.asarray(reach, dtype=np.float64)


def drag(dome: Dome, patches: Array, polar: Array) -> Array:
    """Return the (K, T, 5) response of the inner skin to the drag of a patch of the outer skin.

    The columns are the displacement W inward, T away from the contact and V along the circle of
    latitude, mm per mm of drag; then the turn of the inner normal, E and F, away from the contact
    and along the circle, rad per mm. W, T and E go with cos(phi), V and F with sin(phi).

    Args:
        dome: Dome whose skin is dragged.
        patches: (K,) angular radius of each patch, rad.
        polar: (T,) polar angles, rad.

    Raises:
        UserError: NGSolve is not installed.
    """
    ngs = require_ngsolve()
    mesh = dome_meridian(dome)
    side = ngs.H1(mesh, order=2, dirichlet="base")
    up = ngs.H1(mesh, order=2, dirichlet="base|axis")
    pressures = [
        ngs.Compress(ngs.H1(mesh, order=1, definedon=mesh.Materials(name))) for name in dome.moduli
    ]
    space = ngs.FESpace([side, side, up, *pressures])
    angle = np.clip(polar, 1e-6, math.pi / 2 - 1e-7)
    sine, cosine = np.sin(angle), np.cos(angle)
    points = mesh(dome.inner * sine, dome.inner * cosine)
    out = np.empty((len(patches), len(polar), 5))
    for k, patch in enumerate(patches):
        state = _solve(ngs, dome, mesh, space, float(patch))
        a, b, c = (state.components[i](points).ravel() for i in range(3))
        inward, away = -(a * sine + c * cosine), a * cosine - c * sine
        slope = CubicSpline(polar, inward)(polar, 1)
        out[k] = np.stack(
            [inward, away, b, (slope + away) / dome.inner, (b - inward / sine) / dome.inner], axis=1
        )
        out[k, 0, 4] = -out[k, 0, 3]
    return out


def _solve(ngs: Any, dome: Dome, mesh: Any, space: Any, patch: float) -> Any:
    r, z = ngs.x, ngs.y
    (a, b, c, *pressures), (da, db, dc, *tests) = space.TnT()
    normal, shear = _strain(ngs, r, a, b, c)
    test_normal, test_shear = _strain(ngs, r, da, db, dc)
    form = ngs.BilinearForm(space, symmetric=True)
    for (material, young), p, q in zip(dome.moduli.items(), pressures, tests, strict=True):
        energy = (2 * young / 3) * sum(x * y for x, y in zip(normal, test_normal, strict=True))
        energy += (young / 3) * sum(x * y for x, y in zip(shear, test_shear, strict=True))
        energy += p * sum(test_normal) + q * sum(normal) - 1e-9 * p * q
        form += (energy * r) * ngs.dx(definedon=mesh.Materials(material), bonus_intorder=2)
    held = ngs.IfPos(z - dome.outer * math.cos(patch), _TIE, 0.0) * r
    skin = ngs.ds(definedon=mesh.Boundaries("outer"), bonus_intorder=4)
    form += held * (a * da + b * db + c * dc) * skin
    load = ngs.LinearForm(space)
    load += held * (da - db) * skin
    form.Assemble()
    load.Assemble()
    state = ngs.GridFunction(space)
    state.vec.data = form.mat.Inverse(space.FreeDofs(), inverse="umfpack") * load.vec
    return state


def _strain(ngs: Any, r: Any, a: Any, b: Any, c: Any) -> tuple[list[Any], list[Any]]:
    """Return the normal strains and shears of order one, without their cos(phi) or sin(phi)."""
    da, db, dc = ngs.grad(a), ngs.grad(b), ngs.grad(c)
    return (
        [da[0], (a + b) / r, dc[1]],
        [db[0] - (a + b) / r, da[1] + dc[0], db[1] - c / r],
    )


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make tables of plates on domes.")
    parser.add_argument("out", type=output_file)
    parser.add_argument("kinds", nargs="+", metavar="RATIO:FRICTION")
    given = parser.parse_args()
    kinds = []
    for kind in given.kinds:
        ratio, _, friction = kind.partition(":")
        kinds.append((float(ratio), friction))
    write_file(given.out, lambda: tabulate(given.out, kinds))


if __name__ == "__main__":
    main()
