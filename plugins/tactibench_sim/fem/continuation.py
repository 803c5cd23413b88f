"""Equilibria along a path of loading: adaptive increments around a Newton method.

There are two outcomes: the state is in equilibrium at the given level, or NotConvergedError is
raised and the state is the last equilibrium. A half-converged field is never seen from outside.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench import UserError
from tactibench_sim.fem.body import require_ngsolve

SOLVERS = ("umfpack", "sparsecholesky", "pardiso")
PREDICTORS = ("secant", "tangent")
_PROBE = 1e-4  # change of the level over which the load's derivative is taken


class NotConvergedError(RuntimeError):
    """A Newton run did not converge; there is no field."""


@dataclass(frozen=True)
class Settings:
    """Settings of the increments and the Newton method.

    Attributes:
        first: First increment of the level.
        largest: Largest increment.
        smallest: Increments are halved where Newton fails; below this one the path is given up.
        steps: Newton iterations of a run, at most.
        cap: Longest move of any displacement in one iteration, mm.
        tolerance: Last move of a converged run, mm.
        inverse: One of SOLVERS. "pardiso" needs an NGSolve that was built with it; those of PyPI
            need not be.
        predictor: Where the next run starts. "secant": on the straight line through the last two
            equilibria. Increments grow by 1.5, and every ``advance`` but the first one tries the
            whole way to its goal first. "tangent": on the path's tangent at the last equilibrium,
            which takes one more solution with the last factorisation. Increments continue from the
            last one, and double only after a run of at most ``easy`` iterations.
        easy: Iterations of a run after which "tangent" still doubles the increment.
        diverging: A move beyond it, mm, after the second iteration ends a run as failed.

    Raises:
        ValueError: ``inverse`` is none of SOLVERS, or ``predictor`` none of PREDICTORS.
    """

    first: float = 0.05
    largest: float = math.inf
    smallest: float = 1e-3
    steps: int = 30
    cap: float = 0.6
    tolerance: float = 1e-9
    inverse: str = "umfpack"
    predictor: str = "secant"
    easy: int = 5
    diverging: float = math.inf

    def __post_init__(self) -> None:
        for name, allowed in (("inverse", SOLVERS), ("predictor", PREDICTORS)):
            if (given := getattr(self, name)) not in allowed:
                raise ValueError(f"{name} is {given!r}; allowed: {', '.join(allowed)}")


class Continuation:
    """The path of a ``state`` from equilibrium to equilibrium as a level rises.

    Args:
        form: Symmetric NGSolve BilinearForm of Variation terms.
        state: GridFunction in equilibrium at ``level``.
        set_level: Sets the loads of ``form`` to a level: a depth, or the parameter of a path for
            several indenters.
        displacement: Range of the degrees of freedom that are displacements; None: all.
        settings: Settings of the increments and the Newton method; None: the defaults.
        on_step: Called with the level at every equilibrium on the way.
        level: Level at the start.
        tangent: Form whose second derivative is factorised; None: ``form``. A slightly different
            one costs an iteration or two, never accuracy.

    Raises:
        UserError: NGSolve is not installed or was built without the direct solver.
    """

    def __init__(
        self,
        form: Any,
        state: Any,
        set_level: Callable[[float], object],
        *,
        displacement: Any = None,
        settings: Settings | None = None,
        on_step: Callable[[float], object] | None = None,
        level: float = 0.0,
        tangent: Any = None,
    ) -> None:
        _require_solver((settings or Settings()).inverse)
        self.form, self.state, self.set_level = form, state, set_level
        self.tangent = form if tangent is None else tangent
        self.settings, self.on_step = settings or Settings(), on_step
        self.level = level
        self._moving = slice(None) if displacement is None else displacement
        self._free = state.space.FreeDofs()
        self._before: tuple[float, Any] | None = None  # the equilibrium before the last one
        self._inverse: Any = None  # of the last factorised tangent at an equilibrium
        self._step: float | None = None  # the increment that would be tried next

    def advance(self, goal: float) -> None:
        """Go to the equilibrium at ``goal`` >= level.

        Raises:
            ValueError: The goal is below the level.
            NotConvergedError: Newton fails with the smallest increment, too. The state is the last
                equilibrium.
        """
        if not goal >= self.level:
            raise ValueError(f"the goal is {goal}; it must be at least the level, {self.level}")
        s, vec = self.settings, self.state.vec
        step = self._first_try(goal)
        while self.level < goal - 1e-12:
            step = min(step, goal - self.level, s.largest)
            keep, inverse = vec.CreateVector(), self._inverse
            keep.data = vec
            self._predict(self.level + step)
            self.set_level(self.level + step)
            if iterations := self._newton():
                self._before = (self.level, keep)
                self.level += step
                step = self._next_try(step, iterations)
                if self.on_step is not None:
                    self.on_step(self.level)
                continue
            vec.data, self._inverse = keep, inverse
            self.set_level(self.level)
            self._before = None
            step /= 2
            if step < s.smallest:
                raise NotConvergedError(
                    f"the finite-element run did not converge beyond {self.level:.3f}"
                )

    def _first_try(self, goal: float) -> float:
        if self._step is None:
            return min(goal - self.level, self.settings.first)
        return self._step if self.settings.predictor == "tangent" else goal - self.level

    def _next_try(self, step: float, iterations: int) -> float:
        s = self.settings
        if s.predictor == "secant":
            self._step = 1.5 * step
        elif iterations > s.easy:
            self._step = step
        else:  # an increment cut off at the goal does not shorten those after it
            self._step = min(s.largest, 2 * max(step, self._step or 0.0))
        return self._step

    def _predict(self, to: float) -> None:
        if self.settings.predictor == "secant":
            self._extrapolate(to)
        elif self._inverse is not None:
            self._follow(to)

    def _follow(self, to: float) -> None:
        """Start on the tangent of the path of equilibria."""
        vec = self.state.vec
        now, then = vec.CreateVector(), vec.CreateVector()
        self.form.Apply(vec, now)
        self.set_level(self.level + _PROBE)
        self.form.Apply(vec, then)
        then.data -= now
        now.data = self._inverse * then
        vec.data -= (to - self.level) / _PROBE * now

    def _extrapolate(self, to: float) -> None:
        """Start from the straight line through the last two equilibria."""
        if self._before is None:
            return
        previous, vector = self._before
        change = self.state.vec.CreateVector()
        change.data = self.state.vec - vector
        self.state.vec.data += (to - self.level) / (self.level - previous) * change

    def _newton(self) -> int:
        """Run Newton with capped moves; return the iterations until convergence, 0 for none."""
        from netgen.meshing import NgException

        vec, s = self.state.vec, self.settings
        residual, update = vec.CreateVector(), vec.CreateVector()
        for iteration in range(1, s.steps + 1):
            self.form.Apply(vec, residual)
            if not math.isfinite(residual.Norm()):  # an element has turned inside out
                return 0
            self.tangent.AssembleLinearization(vec)
            try:
                self._inverse = self.tangent.mat.Inverse(self._free, inverse=s.inverse)
            except NgException:  # singular
                return 0
            update.data = self._inverse * residual
            moved = float(np.abs(update[self._moving].FV().NumPy()).max())
            if not math.isfinite(moved) or (iteration > 2 and moved > s.diverging):
                return 0
            vec.data -= min(1.0, s.cap / max(moved, 1e-30)) * update
            if moved < s.tolerance:
                return iteration
        return 0


def _require_solver(inverse: str) -> None:
    """Raise UserError where NGSolve was built without the direct solver.

    Without this check it would fail at the first factorisation, as for a singular matrix.
    """
    config = require_ngsolve().config
    available = {"umfpack": config.USE_UMFPACK, "pardiso": config.USE_PARDISO or config.USE_MKL}
    if not available.get(inverse, True):
        raise UserError(
            f"this NGSolve was built without the direct solver {inverse!r}; "
            'use "sparsecholesky" or "umfpack".'
        )
