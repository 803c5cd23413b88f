"""The mechanics behind a tier's name."""

from __future__ import annotations

from typing import Any

from tactibench import UserError
from tactibench_sim.auto import DEFAULT_TOLERANCE_MM, AutoMechanics
from tactibench_sim.field import Mechanics
from tactibench_sim.table import Tables


def mechanics_for(
    tier: str,
    tables: Tables,
    tolerance: float = DEFAULT_TOLERANCE_MM,
    allow_fem: bool = False,
) -> Any:
    """An object with loads, displacement, pin_tips and skin. Raises UserError for another name.

    tables: of the single contacts. tolerance (mm) and allow_fem: of tier ``auto``.
    """
    if tier in ("coupled", "superpose"):
        return Mechanics(tables, tier)
    if tier == "auto":
        return AutoMechanics(tables, tolerance, allow_fem)
    if tier == "green":
        from tactibench_sim.green.kernel import shipped
        from tactibench_sim.green.mechanics import GreenMechanics

        return GreenMechanics(shipped(), tables)
    if tier == "fem":
        from tactibench_sim.fem_tier import FemMechanics

        return FemMechanics(tables)
    raise UserError(f"the tier is {tier!r}; allowed: auto, coupled, fem, green, superpose.")
