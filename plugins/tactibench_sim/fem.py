"""Axisymmetric finite-element run of the skin-on-gel dome under one indenter (NGSolve).

Both layers are neo-Hookean and exactly incompressible, the flat base is clamped, contact is
frictionless. Displacement is P2, pressure P1 with **one space per material**: a single pressure
that is continuous across the interface is wrong there (the normal stress jumps with the stiffness)
and gives about 6 % too low a force. The energy is differentiated by NGSolve itself.

Coordinates: x is the distance from the axis, y the height above the dome's centre, mm. Stresses
are in units of the skin's Young's modulus, so forces are in E_skin mm^2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import UserError

Array = npt.NDArray[np.float64]


class NotConvergedError(RuntimeError):
    """A Newton run did not converge; there is no field."""


@dataclass(frozen=True)
class Dome:
    """The assumed dome. Lengths mm; moduli in units of the skin's.

    outer, skin: a TacTip dome of 40 mm diameter with a 1 mm skin (assumed from public designs).
    stiffness_ratio: E_skin / E_gel (assumed; 10 to 300 describe real plate presses equally well).
    apex_size, skin_size, gel_size: largest element edges. penalty: contact stiffness, E_skin / mm.
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
        return self.outer - self.skin


@dataclass(frozen=True, eq=False)
class Profile:
    """One converged state, sampled along two meridians at the polar angles asked for.

    inner, outer: (2, T) inward normal and tangential (away from the contact) displacement, mm.
    force: total along the axis, E_skin mm^2.
    """

    delta: float
    force: float
    inner: Array
    outer: Array


def require_ngsolve() -> Any:
    """The ngsolve module. Raises UserError where it is not installed."""
    try:
        import ngsolve
    except ImportError:
        raise UserError(
            "the finite-element run needs NGSolve, which is not installed; "
            'run pip install "tactibench[fem]".'
        ) from None
    return ngsolve


def press(dome: Dome, radius: float, deltas: Array, polar: Array) -> Iterator[Profile]:
    """Press a sphere of ``radius`` mm (inf: a plate) on the apex to each of ``deltas``, ascending.

    polar: (T,) sampling angles, rad, 0..pi/2. For depths beyond its radius the sphere is the end of
    a vertical rod. Raises NotConvergedError; UserError without NGSolve.
    """
    problem = _Problem(dome, radius)
    reached = 0.0
    for delta in deltas:
        if delta > 0:
            problem.advance(reached, float(delta))
        reached = float(delta)
        yield problem.profile(reached, polar)


class _Problem:
    def __init__(self, dome: Dome, radius: float) -> None:
        ngs = require_ngsolve()
        self.ngs, self.dome, self.radius = ngs, dome, radius
        self.mesh = _mesh(dome)
        displacement = ngs.VectorH1(self.mesh, order=2, dirichlet="base", dirichletx="axis")
        pressures = [
            ngs.Compress(ngs.H1(self.mesh, order=1, definedon=self.mesh.Materials(material)))
            for material in ("skin", "gel")
        ]
        self.space = ngs.FESpace([displacement, *pressures])
        self.depth = ngs.Parameter(0.0)
        self.energy = self._energy()
        self.state = ngs.GridFunction(self.space)
        self.before: tuple[float, Any] | None = None  # the last but one converged state
        self.free = self.space.FreeDofs()

    def _overlap(self, u: Any) -> Any:
        """How deep a point of the outer skin lies inside the indenter, mm (negative: outside)."""
        ngs, top = self.ngs, self.dome.outer
        px, py = ngs.x + u[0], ngs.y + u[1]
        if math.isinf(self.radius):
            return py - (top - self.depth)
        above = py - (top + self.radius - self.depth)
        distance = ngs.IfPos(above, px, ngs.sqrt(px * px + above * above + 1e-20))
        return self.radius - distance

    def _energy(self) -> Any:
        ngs = self.ngs
        u, *pressures = self.space.TrialFunction()
        moduli = {"skin": 1.0, "gel": 1.0 / self.dome.stiffness_ratio}
        form = ngs.BilinearForm(self.space, symmetric=True)
        plane = ngs.Id(2) + ngs.Grad(u)
        hoop = 1 + u[0] / ngs.x
        jacobian = ngs.Det(plane) * hoop
        invariant = ngs.InnerProduct(plane, plane) + hoop * hoop
        for (material, young), p in zip(moduli.items(), pressures, strict=True):
            shear = young / 3  # nu = 1/2
            density = shear / 2 * (invariant - 3) - shear * ngs.log(jacobian) + p * (jacobian - 1)
            form += ngs.Variation(
                (density * ngs.x).Compile() * ngs.dx(definedon=self.mesh.Materials(material))
            )
        overlap = self._overlap(u)
        push = self.dome.penalty / 2 * ngs.IfPos(overlap, overlap * overlap, 0.0)
        form += ngs.Variation(
            (push * ngs.x).Compile() * ngs.ds(definedon=self.mesh.Boundaries("outer"))
        )
        return form

    def advance(self, start: float, goal: float, smallest: float = 1e-3) -> None:
        """Go from a converged depth to another, halving the step where Newton fails."""
        at, step = start, min(goal - start, 0.05 if start == 0 else math.inf)
        while at < goal - 1e-12:
            step = min(step, goal - at)
            keep = self.state.vec.CreateVector()
            keep.data = self.state.vec
            self._extrapolate(at, at + step)
            self.depth.Set(at + step)
            if self._newton():
                self.before = (at, keep)
                at += step
                step *= 1.5
                continue
            self.state.vec.data = keep
            self.before = None
            step /= 2
            if step < smallest:
                raise NotConvergedError(f"the finite-element run did not converge at {at:.3f} mm")

    def _extrapolate(self, at: float, to: float) -> None:
        if self.before is None or at <= self.before[0]:
            return
        previous, vector = self.before
        change = self.state.vec.CreateVector()
        change.data = self.state.vec - vector
        self.state.vec.data += (to - at) / (at - previous) * change

    def _newton(self, steps: int = 30, cap: float = 0.6, tolerance: float = 1e-9) -> bool:
        """Newton with steps of at most ``cap`` mm; True when the last one was negligible."""
        from netgen.meshing import NgException

        vec = self.state.vec
        residual, update = vec.CreateVector(), vec.CreateVector()
        for _ in range(steps):
            self.energy.Apply(vec, residual)
            self.energy.AssembleLinearization(vec)
            try:
                inverse = self.energy.mat.Inverse(self.free, inverse="umfpack")
            except NgException:
                return False
            update.data = inverse * residual
            moved = float(np.abs(update[self.space.Range(0)].FV().NumPy()).max())
            if not math.isfinite(moved):
                return False
            vec.data -= min(1.0, cap / max(moved, 1e-30)) * update
            if moved < tolerance:
                return True
        return False

    def force(self) -> float:
        """Total contact force along the axis, E_skin mm^2."""
        ngs = self.ngs
        u = self.state.components[0]
        overlap = self._overlap(u)
        pressure = ngs.IfPos(overlap, self.dome.penalty * overlap, 0.0)
        if math.isinf(self.radius):
            slope: Any = 1.0
        else:
            above = ngs.y + u[1] - (self.dome.outer + self.radius - self.depth)
            slope = ngs.IfPos(above, 0.0, -above / (self.radius - overlap))
        outer = self.mesh.Boundaries("outer")
        integrand = 2 * math.pi * ngs.x * pressure * slope
        return float(ngs.Integrate(integrand * ngs.ds(definedon=outer), self.mesh))

    def profile(self, delta: float, polar: Array) -> Profile:
        inner = self._meridian(self.dome.inner, polar)
        outer = self._meridian(self.dome.outer - 1e-5, polar)
        return Profile(delta, self.force(), inner, outer)

    def _meridian(self, radius: float, polar: Array) -> Array:
        """(2, T) inward and tangential displacement at undeformed points, mm."""
        angle = np.clip(polar, 1e-7, math.pi / 2 - 1e-7)
        sine, cosine = np.sin(angle), np.cos(angle)
        u = self.state.components[0](self.mesh(radius * sine, radius * cosine))
        inward = -(u[:, 0] * sine + u[:, 1] * cosine)
        along = u[:, 0] * cosine - u[:, 1] * sine
        along[polar == 0] = 0.0
        return np.stack([inward, along])


def _mesh(dome: Dome) -> Any:
    """Quarter discs of gel and skin, glued, curved elements."""
    from netgen.occ import Glue, OCCGeometry, Rectangle, WorkPlane
    from ngsolve import Mesh

    quarter = Rectangle(2 * dome.outer, 2 * dome.outer).Face()
    full = WorkPlane().Circle(dome.outer).Face() * quarter
    gel = WorkPlane().Circle(dome.inner).Face() * quarter
    skin = full - gel
    gel.faces.name, gel.faces.maxh = "gel", dome.gel_size
    skin.faces.name, skin.faces.maxh = "skin", dome.skin_size
    shape = Glue([skin, gel])
    for edge in shape.edges:
        (x0, y0, _), (x1, y1, _) = edge.start, edge.end
        if max(abs(x0), abs(x1)) < 1e-9:
            edge.name = "axis"
        elif max(abs(y0), abs(y1)) < 1e-9:
            edge.name = "base"
        else:
            edge.name = "outer" if math.hypot(x0, y0) > dome.inner + 1e-9 else "interface"
            edge.maxh = dome.skin_size
    for vertex in shape.vertices:
        x, y, _ = vertex.p
        if abs(x) < 1e-9 and y > dome.inner - 1e-9:
            vertex.maxh = dome.apex_size
    netgen = OCCGeometry(shape, dim=2).GenerateMesh(maxh=dome.gel_size, grading=0.15)
    mesh = Mesh(netgen)
    mesh.Curve(3)
    return mesh
