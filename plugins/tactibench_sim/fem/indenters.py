"""Rigid indenters as signed distances: a plate, or a sphere that ends a rod along the axis."""

from __future__ import annotations

import math
from typing import Any

from tactibench_sim.fem.extra import require_ngsolve


def overlap(square: Any, height: Any, radius: float) -> Any:
    """How deep a point lies inside an indenter, mm (negative: outside).

    square: squared distance from the indenter's axis; height: above its lowest point, against the
    pressing direction. radius: mm, inf for a plate, which fills the half-space above.
    """
    if math.isinf(radius):
        return height
    ngs = require_ngsolve()
    above = height - radius
    below = ngs.IfPos(above, 0.0, above)
    return radius - ngs.sqrt(square + below * below + 1e-20)  # no division by zero on the axis


def steepness(square: Any, height: Any, radius: float) -> Any:
    """Component along the axis of the unit normal: what contact pressure adds to the force."""
    if math.isinf(radius):
        return 1.0
    above = height - radius
    ngs = require_ngsolve()
    return ngs.IfPos(above, 0.0, -above / (radius - overlap(square, height, radius)))


def contact_energy(inside: Any, penalty: float) -> Any:
    """Energy of frictionless contact per area: half the penalty times the overlap squared."""
    ngs = require_ngsolve()
    return penalty / 2 * ngs.IfPos(inside, inside * inside, 0.0)


def contact_pressure(inside: Any, penalty: float) -> Any:
    ngs = require_ngsolve()
    return ngs.IfPos(inside, penalty * inside, 0.0)
