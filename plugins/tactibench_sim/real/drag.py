"""Finite-element answer of the dome to a patch of its skin dragged sideways (NGSolve).

Linear and small-strain on the undeformed dome, incompressible, one pressure per material: the
displacement of Fourier order one, u_r = a cos(phi), u_phi = b sin(phi), u_z = c cos(phi), with the
patch around the apex, which the plate holds, moved by 1 mm along phi = 0. Pre-stress of the press
is left out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench_sim.fem import Dome, require_ngsolve
from tactibench_sim.fem.meshes import dome_meridian

Array = npt.NDArray[np.float64]
_TIE = 100.0  # E_skin / mm, holds the patch; the skin then follows by 0.99 of the plate or more


def drag(dome: Dome, patches: Array, polar: Array) -> Array:
    """(K, T, 5) answer of the inner skin for K patches, at polar angles (T,) from the contact.

    patches: (K,) angular radius of the patch, rad. Columns: W inward, T away from the contact and V
    along the circle of latitude, mm per mm of drag; E and F, the turn of the inner normal likewise,
    rad per mm. W, T, E go with cos(phi), V and F with sin(phi). Raises UserError without NGSolve.
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
    """Normal strains and shears of order one, their cos(phi) or sin(phi) left out."""
    da, db, dc = ngs.grad(a), ngs.grad(b), ngs.grad(c)
    return (
        [da[0], (a + b) / r, dc[1]],
        [db[0] - (a + b) / r, da[1] + dc[0], db[1] - c / r],
    )
