"""The dome as a body of finite elements, in mm and units of the skin's modulus.

Its materials are neo-Hookean solids with nu exactly 1/2, by displacement and pressure. Every
material has a pressure space of its **own**: the pressure jumps with the stiffness, and a pressure
that is continuous across the interface gives a force on the dome that is about 6 % too low.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tactibench import UserError


@dataclass(frozen=True)
class Dome:
    """The assumed dome. Lengths are in mm, moduli in units of the skin's.

    Attributes:
        outer: Radius of the outer skin: a TacTip dome of 40 mm diameter (assumed from public
            designs).
        skin: Thickness of the skin (likewise).
        stiffness_ratio: E_skin / E_gel (assumed; 10 to 300 describe real plate presses equally
            well).
        apex_size: Largest element edge at the apex of axisymmetric meshes.
        skin_size: Largest element edge in the skin of axisymmetric meshes.
        gel_size: Largest element edge in the gel of axisymmetric meshes.
        penalty: Contact stiffness, E_skin / mm.
    """

    outer: float = 20.0
    skin: float = 1.0
    stiffness_ratio: float = 50.0
    apex_size: float = 0.08
    skin_size: float = 0.3
    gel_size: float = 1.2
    penalty: float = 100.0

    @property
    def inner(self) -> float:
        """Radius of the inner skin, mm."""
        return self.outer - self.skin

    @property
    def moduli(self) -> dict[str, float]:
        """Young's modulus of each material."""
        return {"skin": 1.0, "gel": 1.0 / self.stiffness_ratio}


def require_ngsolve() -> Any:
    """Return the module ngsolve, an optional extra.

    Raises:
        UserError: NGSolve is not installed.
    """
    try:
        import ngsolve
    except ImportError:
        raise UserError(
            "the finite-element run needs NGSolve, which is not installed; "
            'run pip install "tactibench[fem]".'
        ) from None
    return ngsolve


def mixed_space(mesh: Any, displacement: Any, materials: Iterable[str]) -> Any:
    """Return the product of a displacement space and a continuous P1 pressure for each material."""
    ngs = require_ngsolve()
    pressures = [
        ngs.Compress(ngs.H1(mesh, order=1, definedon=mesh.Materials(material)))
        for material in materials
    ]
    return ngs.FESpace([displacement, *pressures])


def density(young: float, first: Any, jacobian: Any, pressure: Any) -> Any:
    """Return the energy of an incompressible neo-Hookean solid per undeformed volume.

    The logarithm makes the rest state free of stress at zero pressure; it vanishes where the
    constraint holds.

    Args:
        young: Young's modulus.
        first: The trace of F^T F.
        jacobian: det F.
        pressure: The multiplier of the constraint det F = 1.
    """
    shear = young / 3  # nu = 1/2
    ngs = require_ngsolve()
    stretch = shear / 2 * (first - 3) - shear * ngs.log(jacobian)
    return stretch + pressure * (jacobian - 1)


def spatial_strain(u: Any) -> tuple[Any, Any]:
    """Return (tr F^T F, det F) of a displacement in three dimensions."""
    ngs = require_ngsolve()
    gradient = ngs.Id(3) + ngs.Grad(u)
    return ngs.InnerProduct(gradient, gradient), ngs.Det(gradient)
