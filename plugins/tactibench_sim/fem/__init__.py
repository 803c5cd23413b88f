"""Finite-element reference: hyperelastic, exactly incompressible bodies under rigid indenters."""

from tactibench_sim.fem.bodies import Dome
from tactibench_sim.fem.continuation import NotConvergedError
from tactibench_sim.fem.dome import Profile, press
from tactibench_sim.fem.extra import require_ngsolve

__all__ = ["Dome", "NotConvergedError", "Profile", "press", "require_ngsolve"]
