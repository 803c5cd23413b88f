"""Neo-Hookean solids with nu exactly 1/2, by displacement and pressure.

Every material has a pressure space of its **own**: the pressure jumps with the stiffness, and one
pressure that is continuous across the interface gives about 6 % too low a force on the dome.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tactibench_sim.fem.extra import require_ngsolve


def mixed_space(mesh: Any, displacement: Any, materials: Iterable[str]) -> Any:
    """Product of the displacement space and one continuous P1 pressure for each material."""
    ngs = require_ngsolve()
    pressures = [
        ngs.Compress(ngs.H1(mesh, order=1, definedon=mesh.Materials(material)))
        for material in materials
    ]
    return ngs.FESpace([displacement, *pressures])


def density(young: float, first: Any, jacobian: Any, pressure: Any) -> Any:
    """Energy of an incompressible neo-Hookean solid per undeformed volume, with its multiplier.

    first: trace of F^T F; jacobian: det F. The logarithm makes the rest state free of stress at
    zero pressure; it vanishes where the constraint holds.
    """
    shear = young / 3  # nu = 1/2
    ngs = require_ngsolve()
    stretch = shear / 2 * (first - 3) - shear * ngs.log(jacobian)
    return stretch + pressure * (jacobian - 1)


def axisymmetric_strain(u: Any) -> tuple[Any, Any]:
    """(tr F^T F, det F) of a displacement (radial, axial); x is the distance from the axis."""
    ngs = require_ngsolve()
    plane = ngs.Id(2) + ngs.Grad(u)
    hoop = 1 + u[0] / ngs.x
    return ngs.InnerProduct(plane, plane) + hoop * hoop, ngs.Det(plane) * hoop


def spatial_strain(u: Any) -> tuple[Any, Any]:
    """(tr F^T F, det F) of a displacement in three dimensions."""
    ngs = require_ngsolve()
    gradient = ngs.Id(3) + ngs.Grad(u)
    return ngs.InnerProduct(gradient, gradient), ngs.Det(gradient)
