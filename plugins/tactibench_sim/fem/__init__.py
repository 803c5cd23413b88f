"""Finite-element reference: a hyperelastic, exactly incompressible dome under rigid indenters."""

from tactibench_sim.fem.body import Dome, require_ngsolve
from tactibench_sim.fem.continuation import NotConvergedError

__all__ = ["Dome", "NotConvergedError", "require_ngsolve"]
