"""Make the kernel file of tier `green`: the dome's response to a force on a cap at the apex.

    PYTHONPATH=.:plugins python scripts/fem/tabulate_green.py OUT

Two runs. One linear, exactly incompressible: a unit force on caps of many sizes, so that a contact
of any size finds a cap of its node spacing. One finite-strain run of one cap under growing force:
its secant compliance says how the dome softens, then stiffens, as it is dented.
A cap's traction is along the axis, (1 - r)^4 (4 r + 1) with r the distance from the axis over the
cap's radius (Wendland C2: positive definite, so that influence matrices are too).
"""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from axisymmetric import Array, axisymmetric_strain
from dome_press import dome_meridian
from fem_script import output_file, write_file

from tactibench_sim import data_file
from tactibench_sim.fem.body import Dome, density, mixed_space, require_ngsolve
from tactibench_sim.fem.continuation import Continuation, Settings

CHORDS = 284
CHORD_STEP = math.sqrt(2) / (CHORDS - 1)
"""Samples are even in the chord of the unit sphere, 0.1 mm apart, from 0 to the rim at 90 deg."""
CAPS_MM = tuple(0.15 * 2 ** (k / 2) for k in range(11))
DENT_CAP_MM = 2.0
DENT_FORCES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2)
"""Cap and forces (E_skin mm^2) of the finite-strain run; 1.2 dents the dome by 6 mm."""
FINE_MM = 0.03


def tabulate(path: Path, dome: Dome) -> str:
    """Write the kernel file at ``path``, return its digest; a quarter of a minute.

    Raises UserError without NGSolve, NotConvergedError where the finite-strain run fails.
    """
    ngsolve = require_ngsolve()
    caps = linear(dome, CAPS_MM)
    arrays = {
        "chord": np.arange(CHORDS) * CHORD_STEP,
        "cap": np.array(CAPS_MM),
        "linear": caps.astype(np.float32),
        "force": np.array(DENT_FORCES),
        "dented": dented(dome, DENT_CAP_MM, DENT_FORCES).astype(np.float32),
    }
    parameters = {
        "dome": asdict(dome),
        "dent_cap": DENT_CAP_MM,
        "solver": f"ngsolve {ngsolve.__version__}",
    }
    return data_file.write(path, arrays, parameters)


def linear(dome: Dome, caps: tuple[float, ...]) -> Array:
    """Return (A, 4, C) w, t of outer and inner skin per unit force, mm / (E_skin mm^2)."""
    ngs = require_ngsolve()
    mesh = dome_meridian(replace(dome, apex_size=min(dome.apex_size, FINE_MM)))
    space = mixed_space(mesh, _moving(mesh), dome.moduli)
    (u, *pressures), (v, *tests) = space.TnT()
    form = ngs.BilinearForm(space, symmetric=True)
    for (material, young), p, q in zip(dome.moduli.items(), pressures, tests, strict=True):
        strain = ngs.InnerProduct(ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v)))
        strain += u[0] * v[0] / (ngs.x * ngs.x)
        weak = 2 * young / 3 * strain + p * _divergence(v) + q * _divergence(u)
        form += (weak * ngs.x).Compile() * ngs.dx(definedon=mesh.Materials(material))
    form.Assemble()
    inverse = form.mat.Inverse(space.FreeDofs(), inverse="umfpack")
    state = ngs.GridFunction(space)
    rows = []
    for cap in caps:
        load = ngs.LinearForm(space)
        load += -_traction(mesh, cap) * ngs.x * v[1] * _outer(mesh)
        load.Assemble()
        state.vec.data = inverse * load.vec
        rows.append(_sample(mesh, dome, state.components[0]))
    return np.stack(rows)


def dented(dome: Dome, cap: float, forces: tuple[float, ...]) -> Array:
    """Return the (F + 1, 4, C) secant response per force; row 0 is the limit of no force."""
    ngs = require_ngsolve()
    mesh = dome_meridian(replace(dome, apex_size=0.1))
    space = mixed_space(mesh, _moving(mesh), dome.moduli)
    u, *pressures = space.TrialFunction()
    form = ngs.BilinearForm(space, symmetric=True)
    first, jacobian = axisymmetric_strain(u)
    for (material, young), p in zip(dome.moduli.items(), pressures, strict=True):
        stored = density(young, first, jacobian, p) * ngs.x
        form += ngs.Variation(stored.Compile() * ngs.dx(definedon=mesh.Materials(material)))
    force = ngs.Parameter(0.0)
    work = force * _traction(mesh, cap) * u[1] * ngs.x
    form += ngs.Variation(work.Compile() * _outer(mesh))
    state = ngs.GridFunction(space)
    settings = Settings(first=0.02, largest=0.2, tolerance=1e-8)
    path = Continuation(form, state, force.Set, displacement=space.Range(0), settings=settings)
    rows = []
    for level in (1e-4, *forces):
        path.advance(level)
        rows.append(_sample(mesh, dome, state.components[0]) / level)
    return np.stack(rows)


def _moving(mesh: Any) -> Any:
    ngs = require_ngsolve()
    return ngs.VectorH1(mesh, order=2, dirichlet="base", dirichletx="axis")


def _divergence(u: Any) -> Any:
    ngs = require_ngsolve()
    return ngs.Trace(ngs.Grad(u)) + u[0] / ngs.x


def _outer(mesh: Any) -> Any:
    return require_ngsolve().ds(definedon=mesh.Boundaries("outer"), bonus_intorder=6)


def _traction(mesh: Any, cap: float) -> Any:
    """Downward traction of total force 1; the factor 2 pi of the form is in it."""
    ngs = require_ngsolve()
    r = ngs.x / cap
    bump = ngs.IfPos(1 - r, (1 - r) ** 4 * (4 * r + 1), 0.0)
    return bump / (2 * math.pi * ngs.Integrate(bump * ngs.x * _outer(mesh), mesh))


def _sample(mesh: Any, dome: Dome, u: Any) -> Array:
    """Return (4, C) w outer, t outer, w inner, t inner."""
    angle = 2 * np.arcsin(np.minimum(np.arange(CHORDS) * CHORD_STEP / 2, math.sqrt(0.5)))
    angle = np.clip(angle, 1e-7, math.pi / 2 - 1e-7)
    sine, cosine = np.sin(angle), np.cos(angle)
    rows = []
    for radius in (dome.outer - 1e-5, dome.inner):
        move = np.asarray(u(mesh(radius * sine, radius * cosine)))
        along = move[:, 0] * cosine - move[:, 1] * sine
        along[0] = 0.0
        rows += [-(move[:, 0] * sine + move[:, 1] * cosine), along]
    return np.stack(rows)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Make the kernel file of tier green.")
    parser.add_argument("out", type=output_file)
    given = parser.parse_args()
    write_file(given.out, lambda: tabulate(given.out, Dome()))


if __name__ == "__main__":
    main()
