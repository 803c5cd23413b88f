"""Finite elements of an incompressible body, and equilibria along a path of loading.

Lengths are in mm, stresses in units of the skin's modulus. Materials are neo-Hookean solids with nu
exactly 1/2, by displacement and pressure. Every material has a pressure space of its **own**: the
pressure jumps with the stiffness, and a pressure that is continuous across the interface gives a
force on the dome that is about 6 % too low.

A path goes by adaptive increments around a Newton method. There are two outcomes: the state is in
equilibrium at the given level, or NotConvergedError is raised and the state is the last
equilibrium. A half-converged field is never seen from outside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactibench import UserError

_PROBE = 1e-4  # change of the level over which the load's derivative is taken


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
        inverse: Direct solver of NGSolve, "umfpack" or "sparsecholesky".
        predictor: Where the next run starts. "secant": on the straight line through the last two
            equilibria. Increments grow by 1.5, and every ``advance`` but the first one tries the
            whole way to its goal first. "tangent": on the path's tangent at the last equilibrium,
            which takes one more solution with the last factorisation. Increments continue from the
            last one, and double only after a run of at most ``easy`` iterations.
        easy: Iterations of a run after which "tangent" still doubles the increment.
        diverging: A move beyond it, mm, after the second iteration ends a run as failed.
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
