"""The dome under any number of indenters, in three dimensions: the reference for everything else.

P2 displacement and one P1 pressure of each material, frictionless contact. With the default mesh,
the pin bases under a sphere of 3 mm on the apex differ from the axisymmetric runs by at most
0.012 mm down to 4 mm depth and 0.016 mm at 6 mm, the force by 1.5 %.

``Drag`` holds the skin that a press touched and moves the tips together, parallel to the dome's
base; friction of finite size stands in friction.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from elements import (
    Continuation,
    Dome,
    Settings,
    density,
    mixed_space,
    require_ngsolve,
    spatial_strain,
)

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Cushion:
    """The stiffness of a contact.

    Attributes:
        penalty: Stiffness, E_skin / mm.
        rounding: Overlap over which the stiffness is reached, mm.
    """

    penalty: float
    rounding: float


SPHERE = Cushion(60.0, 0.01)
PLATE = Cushion(20.0, 0.04)
"""Softer, because a plate touches much of the skin at once, at a small pressure."""


@dataclass(frozen=True)
class Tip:
    """An indenter that moves from ``start`` along -axis as its depth grows from 0.

    At depth 0 it must not overlap the dome.

    Attributes:
        start: The sphere's centre, or a point of the plate, at depth 0, mm from the dome's centre.
        axis: Unit vector along its rod, or the plate's normal, out of the dome.
        radius: Radius of the sphere, mm; inf for a plate.
    """

    start: Vector
    axis: Vector
    radius: float

    @classmethod
    def along_axis(cls, dome: Dome, direction: Array, radius: float) -> Tip:
        """Return a tip that presses towards the dome's centre; its depth is the penetration.

        Args:
            dome: The dome.
            direction: (3,) unit vector from the dome's centre to the tip.
            radius: Radius of the sphere, mm; inf for a plate.
        """
        reach = dome.outer + (0.0 if math.isinf(radius) else radius)
        n = np.asarray(direction, dtype=np.float64)
        return cls(_vector(reach * n), _vector(n), radius)

    @classmethod
    def downwards(cls, dome: Dome, x: float, y: float, radius: float) -> Tip:
        """Return a sphere that presses along -z beside the dome's axis; at depth 0 it touches.

        Args:
            dome: The dome.
            x: Place of the sphere's axis, mm.
            y: Place of the sphere's axis, mm.
            radius: Radius of the sphere, mm.

        Raises:
            ValueError: The sphere would pass beside the dome.
        """
        square = (dome.outer + radius) ** 2 - x * x - y * y
        if not 0 < square < math.inf:
            raise ValueError(f"no sphere of {radius} mm comes down on the dome at ({x}, {y}) mm")
        return cls((float(x), float(y), math.sqrt(square)), (0.0, 0.0, 1.0), radius)

    @property
    def cushion(self) -> Cushion:
        """Stiffness of the contact."""
        return PLATE if math.isinf(self.radius) else SPHERE

    def centre(self, depth: float) -> Array:
        """Return the sphere's centre, or a point of the plate, at a depth, mm."""
        return np.array(self.start) - depth * np.array(self.axis)

    def inside(self, place: Any, depth: Any) -> Any:
        """Return how deep a deformed place (an NGSolve vector) lies inside the tip, mm."""
        q, along = self._split(place, depth)
        if math.isinf(self.radius):
            return along
        side = [q[i] * self.axis[j] - q[j] * self.axis[i] for i, j in ((1, 2), (2, 0), (0, 1))]
        square = sum(component * component for component in side)  # never below 0
        return overlap(square, along + self.radius, self.radius)

    def _split(self, place: Any, depth: Any) -> tuple[list[Any], Any]:
        """Return the place from the tip's centre, and its component along the axis."""
        q = [place[i] - self.start[i] + depth * self.axis[i] for i in range(3)]
        return q, sum(q[i] * self.axis[i] for i in range(3))


def overlap(square: Any, height: Any, radius: float) -> Any:
    """Return how deep a point lies inside an indenter, mm (negative: outside).

    Args:
        square: Squared distance from the indenter's axis.
        height: Height above the indenter's lowest point, against the pressing direction, mm.
        radius: Radius of the sphere that ends a rod, mm; inf for a plate, which fills the
            half-space.
    """
    if math.isinf(radius):
        return height
    ngs = require_ngsolve()
    above = height - radius
    below = ngs.IfPos(above, 0.0, above)
    return radius - ngs.sqrt(square + below * below + 1e-20)  # no division by zero on the axis


def rounded_energy(inside: Any, cushion: Cushion) -> Any:
    """Return the energy of frictionless contact per area, twice continuously differentiable.

    The stiffness of the penalty rises linearly from 0. So Newton meets no kink when points begin to
    touch, which allows increments of a millimetre.

    Args:
        inside: Overlap, mm; negative: none.
        cushion: Stiffness of the contact.
    """
    ngs = require_ngsolve()
    e = cushion.rounding
    beyond = inside * inside / 2 - e * inside / 2 + e * e / 6
    within = inside * inside * inside / (6 * e)
    return cushion.penalty * ngs.IfPos(inside - e, beyond, ngs.IfPos(inside, within, 0.0))


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


GRADING = 0.3
"""Netgen's growth of element edges away from a refined spot; 0.3 is its default."""
_SPACING = 0.7  # of the points that request small elements, in element edges


@dataclass(frozen=True)
class Spot:
    """A round part of the skin with small elements on both of its surfaces.

    Attributes:
        direction: (3,) unit vector from the dome's centre to the middle of the part.
        reach: Radius of the part along the outer surface, mm.
        edge: Edge of the elements, mm.
    """

    direction: Array
    reach: float
    edge: float

    def points(self, radius: float) -> Array:
        """Return (N, 3) points of the outer surface, on a square grid of the azimuthal chart."""
        step = _SPACING * self.edge
        count = math.floor(self.reach / step)
        i, j = np.meshgrid(*[step * np.arange(-count, count + 1)] * 2)
        r = np.hypot(i, j).ravel()
        first, second = across(self.direction)
        side = np.outer(i, first).reshape(-1, 3) + np.outer(j, second).reshape(-1, 3)
        points = np.cos(r / radius)[:, None] * radius * self.direction
        points = points + np.sinc(r / radius / np.pi)[:, None] * side
        return np.asarray(points[r <= self.reach], dtype=np.float64)


def across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that complete a direction to an orthonormal basis."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first = first / np.linalg.norm(first)
    return first, np.cross(direction, first)


def dome_volume(dome: Dome, spots: Sequence[Spot], far: float, mirror: bool) -> Any:
    """Mesh the dome with curved tetrahedra of materials "skin" and "gel".

    Its boundaries are "base" (z = 0), "outer", and "mirror" (y = 0) where only the half y > 0 is
    meshed.

    Args:
        dome: The dome.
        spots: Parts of the skin with small elements.
        far: Largest element edge, mm.
        mirror: Whether only the half y > 0 is meshed.
    """
    ngs = require_ngsolve()
    from netgen.meshing import MeshingParameters
    from netgen.occ import Box, Glue, OCCGeometry, Sphere

    size = 2 * dome.outer
    above = Box((-size, 0 if mirror else -size, 0), (size, size, size))
    gel = Sphere((0, 0, 0), dome.inner) * above
    skin = (Sphere((0, 0, 0), dome.outer) - Sphere((0, 0, 0), dome.inner)) * above
    gel.solids.name, skin.solids.name = "gel", "skin"
    shape = Glue([skin, gel])
    for face in shape.faces:
        face.name = _name(face, dome, mirror)
    parameters = MeshingParameters(maxh=far, grading=GRADING)
    for spot in spots:
        for point in spot.points(dome.outer):
            if point[2] < 0.02 * dome.outer or (mirror and point[1] < -1e-9 * dome.outer):
                continue
            for at in (point, point * (dome.inner / dome.outer)):
                parameters.RestrictH(*map(float, at), h=float(spot.edge))
    mesh = ngs.Mesh(OCCGeometry(shape).GenerateMesh(mp=parameters))
    mesh.Curve(2)
    return mesh


def _name(face: Any, dome: Dome, mirror: bool) -> str:
    centre = face.center
    if abs(centre.z) < 1e-6:
        return "base"
    if mirror and abs(centre.y) < 1e-6:
        return "mirror"
    corner = math.hypot(*next(iter(face.vertices)).p)
    return "outer" if corner > (dome.outer + dome.inner) / 2 else "interface"


_INSIDE = 1e-4  # mm that a place is moved into the body, so that its element is found
_SHRINKS = (0.0, 1e-4, 4e-4, 2e-3)  # curved elements of 9 mm edge lie up to 0.02 mm inside


class SpatialField:
    """An equilibrium: the displacement of the dome's points.

    Args:
        dome: The dome.
        mesh: NGSolve mesh of the dome.
        state: GridFunction (displacement, pressures), which is copied.
        mirror: Whether only the half y > 0 is meshed.
        depths: (K,) depths of the tips, mm.
        forces: (K, 3) forces on the skin by each tip, E_skin mm^2. Where the mirror plane cuts the
            contact of a tip, the force is that of the whole contact.
    """

    def __init__(
        self, dome: Dome, mesh: Any, state: Any, mirror: bool, depths: Array, forces: Array
    ) -> None:
        self.dome, self.mirror = dome, mirror
        self.depths, self.forces = depths, forces
        self._mesh = mesh
        self._state = require_ngsolve().GridFunction(state.space)
        self._state.vec.data = state.vec

    def inner(self, directions: Array) -> Array:
        """Return (P, 3) displacement of the inner skin, mm, at (P, 3) unit vectors with z >= 0."""
        return self._displacement(self.dome.inner - _INSIDE, directions)

    def outer(self, directions: Array) -> Array:
        """Return (P, 3) displacement of the outer skin, mm, at (P, 3) unit vectors with z >= 0."""
        return self._displacement(self.dome.outer - _INSIDE, directions)

    def _displacement(self, radius: float, directions: Array) -> Array:
        b = np.asarray(directions, dtype=np.float64)
        if not len(b):
            return np.zeros((0, 3))
        image = self.mirror & (b[:, 1] < 0)
        x, y, z = radius * b.T
        if self.mirror:
            y = np.maximum(np.abs(y), _INSIDE)
        u = self._inside(np.stack([x, y, np.maximum(z, _INSIDE)], axis=1))
        u[image, 1] *= -1
        if self.mirror:  # exactly odd: points of the plane were evaluated a little beside it
            u[:, 1] *= np.minimum(np.abs(b[:, 1]) * radius / _INSIDE, 1.0)
        return u

    def _inside(self, points: Array) -> Array:
        """Return the displacement at (P, 3) places, moved inwards until they are in an element."""
        out, rest = np.empty_like(points), np.arange(len(points))
        for shrink in _SHRINKS:
            elements = self._mesh(*(points[rest] * (1 - shrink)).T)
            inside = elements["nr"] >= 0
            if inside.any():
                out[rest[inside]] = self._state.components[0](elements[inside])
            rest = rest[~inside]
            if not len(rest):
                return out
        raise RuntimeError("a point of the skin lies in no element of the mesh")


SPATIAL = Settings(
    first=0.15,
    largest=1.0,
    smallest=5e-3,
    steps=16,
    tolerance=1e-3,  # moves shrink quadratically: the next would be about a thousandth of it
    inverse="sparsecholesky",  # half to a third of umfpack's time
    predictor="tangent",
    diverging=1.5,
)
_COMPRESSIBILITY = 1e-6  # of the factorised tangent only, which else has no Cholesky factors


@dataclass(frozen=True)
class Fineness:
    """Element edges of a mesh.

    Attributes:
        contact: Edge under a spherical tip, in units of its radius.
        largest: Largest edge under a spherical tip, and the edge under a plate, mm.
        margin: Distance beyond a tip's radius to which the elements are small, mm; half of it
            beyond where a plate touches.
        far: Largest edge elsewhere, mm.
    """

    contact: float = 0.4
    largest: float = 1.9
    margin: float = 2.0
    far: float = 4.5

    def spot(self, dome: Dome, tip: Tip, depths: Array) -> Spot:
        """Return the part of the skin that a tip will touch at ``depths`` (N,), mm."""
        ends = [tip.centre(depth) for depth in (max(depths.min(), 0.0), max(depths.max(), 0.0))]
        if math.isinf(tip.radius):
            height = min(max(float(np.array(tip.axis) @ ends[1]), 0.0), dome.outer)
            touched = math.sqrt(dome.outer**2 - height**2)
            return Spot(np.array(tip.axis), touched + self.margin / 2, self.largest)
        first, last = (end / np.linalg.norm(end) for end in ends)
        middle = (first + last) / np.linalg.norm(first + last)
        drift = dome.outer * math.acos(min(float(first @ middle), 1.0))
        edge = min(self.contact * tip.radius, self.largest)
        return Spot(middle, min(tip.radius, 8.0) + self.margin + drift, edge)


class SpatialPress:
    """A dome and its tips: ``move`` moves them, ``field`` returns the present equilibrium.

    Args:
        dome: The dome.
        tips: K tips.
        depths: (N, K) depths for which the mesh is made, mm. The run starts from the first row, or
            from 0 where that is deeper.
        mirror: Mesh the half y > 0 only. Every tip beside the plane y = 0 then stands for itself
            and its image.
        fineness: Element edges; None: the defaults.
        settings: Settings of the increments and the Newton method.

    Raises:
        UserError: NGSolve is not installed.
    """

    def __init__(
        self,
        dome: Dome,
        tips: Sequence[Tip],
        depths: Array,
        *,
        mirror: bool = False,
        fineness: Fineness | None = None,
        settings: Settings = SPATIAL,
    ) -> None:
        ngs = require_ngsolve()
        planned = np.asarray(depths, dtype=np.float64)
        self.dome, self.tips, self.mirror = dome, tuple(tips), mirror
        fineness = fineness or Fineness()
        spots = [fineness.spot(dome, tip, planned[:, k]) for k, tip in enumerate(self.tips)]
        self.mesh = dome_volume(dome, spots, fineness.far, mirror)
        held = {"dirichlet": "base", **({"dirichlety": "mirror"} if mirror else {})}
        moving = ngs.VectorH1(self.mesh, order=2, **held)
        self.space = mixed_space(self.mesh, moving, dome.moduli)
        self.state = ngs.GridFunction(self.space)
        self.depths = np.minimum(planned[0], 0.0)
        self._way = np.zeros_like(self.depths)
        self._from, self._since = self.depths, 0.0
        self._at = [ngs.Parameter(float(depth)) for depth in self.depths]
        self._contacts = [self._contact(k) for k in range(len(self.tips))]
        form, tangent = self.forms(lambda u: [self._push(k, u) for k in range(len(self.tips))])
        self.path = Continuation(
            form,
            self.state,
            self._set,
            displacement=self.space.Range(0),
            settings=settings,
            tangent=tangent,
        )

    def _set(self, level: float) -> None:
        """Set the depths at a level: the way so far of the tip with the longest way, mm."""
        self.depths = self._from + (level - self._since) * self._way
        for parameter, depth in zip(self._at, self.depths, strict=True):
            parameter.Set(float(depth))

    def forms(self, contacts: Callable[[Any], Sequence[Any]]) -> tuple[Any, Any]:
        """Return the energy, and the energy whose second derivative is factorised.

        Args:
            contacts: Function that returns the terms of what touches the skin, for a trial
                displacement.
        """
        ngs = require_ngsolve()
        forms = [ngs.BilinearForm(self.space, symmetric=True) for _ in range(2)]
        u, *pressures = self.space.TrialFunction()
        for (material, young), pressure in zip(self.dome.moduli.items(), pressures, strict=True):
            stored = density(young, *spatial_strain(u), pressure)
            soft = stored - _COMPRESSIBILITY / (2 * young) * pressure * pressure
            volume = ngs.dx(definedon=self.mesh.Materials(material))
            for form, energy in zip(forms, (stored, soft), strict=True):
                form += ngs.Variation(energy.Compile() * volume)
        for form in forms:
            for term in contacts(u):
                form += term
        return forms[0], forms[1]

    def _push(self, k: int, u: Any) -> Any:
        ngs = require_ngsolve()
        place = [ngs.x + u[0], ngs.y + u[1], ngs.z + u[2]]
        tip = self.tips[k]
        energy = rounded_energy(tip.inside(place, self._at[k]), tip.cushion)
        return ngs.Variation(energy.Compile() * ngs.ds(definedon=self.mesh.Boundaries("outer")))

    def _contact(self, k: int) -> Any:
        """Return the energy of one tip's contact; its first derivative is the force on the skin."""
        form = require_ngsolve().BilinearForm(self.space, symmetric=True)
        form += self._push(k, self.space.TrialFunction()[0])
        return form

    def move(self, depths: Array) -> None:
        """Move the tips to (K,) depths, mm, on a straight way.

        Raises:
            NotConvergedError: A run failed; the state is the last equilibrium on the way.
        """
        goal = np.asarray(depths, dtype=np.float64)
        length = float(np.abs(goal - self.depths).max())
        if length < 1e-12:
            return
        self._from, self._since = self.depths, self.path.level
        self._way = (goal - self.depths) / length
        self.path.advance(self._since + length)

    def field(self) -> SpatialField:
        """Return the present equilibrium."""
        forces = np.array([self._force(k) for k in range(len(self.tips))])
        return SpatialField(
            self.dome, self.mesh, self.state, self.mirror, self.depths.copy(), forces
        )

    def _force(self, k: int) -> Array:
        """Return the (3,) force of a tip in the discrete equilibrium, at its integration points."""
        ngs = require_ngsolve()
        resisting, shift = self.state.vec.CreateVector(), ngs.GridFunction(self.space)
        self._contacts[k].Apply(self.state.vec, resisting)
        force = np.zeros(3)
        for axis, unit in enumerate(np.eye(3)):
            shift.components[0].Set(tuple(map(float, unit)))
            force[axis] = -ngs.InnerProduct(resisting, shift.vec)
        if self.mirror and self.tips[k].start[1] == 0:
            force *= [2.0, 0.0, 2.0]
        return force


_TIE = 100.0  # E_skin / mm, of skin that sticks
_SETTINGS = replace(SPATIAL, first=0.1, smallest=1e-3, largest=0.25, steps=25)


class Drag:
    """The tips of a press at rest, moved sideways from there with the skin stuck to them."""

    def __init__(self, press: SpatialPress, direction: Array) -> None:
        """Begin at the present state of ``press``, which the drag then changes.

        Args:
            press: Tips that have been pressed without friction.
            direction: (2,) unit vector of the move.
        """
        ngs = require_ngsolve()
        self.press, self.direction = press, direction
        displacement = press.state.components[0]
        self._before = ngs.GridFunction(displacement.space)
        self._before.vec.data = displacement.vec
        self._moved = ngs.Parameter(0.0)
        energy, tangent = press.forms(self._contacts)
        self._path = Continuation(
            energy,
            press.state,
            self._moved.Set,
            displacement=press.space.Range(0),
            settings=_SETTINGS,
            tangent=tangent,
        )

    def move(self, way: float) -> SpatialField:
        """Move on to ``way`` mm from the start and return the field there.

        The forces in the field are computed for tips that did not move; do not use them.

        Raises:
            NotConvergedError: A run failed.
        """
        self._path.advance(way)
        return self.press.field()

    def force(self) -> float:
        """Return the force of all tips along the move, E_skin mm^2."""
        ngs = require_ngsolve()
        form = ngs.BilinearForm(self.press.space, symmetric=True)
        for term in self._contacts(self.press.space.TrialFunction()[0]):
            form += term
        resisting = self.press.state.vec.CreateVector()
        form.Apply(self.press.state.vec, resisting)
        unit = ngs.GridFunction(self.press.space)
        unit.components[0].Set((*map(float, self.direction), 0.0))
        half = 2.0 if self.press.mirror else 1.0
        return -half * float(ngs.InnerProduct(resisting, unit.vec))

    def _contacts(self, u: Any) -> list[Any]:
        ngs, press = require_ngsolve(), self.press
        skin = ngs.ds(definedon=press.mesh.Boundaries("outer"))
        way = [float(part) * self._moved for part in self.direction] + [0.0]
        moved = [axis + u[i] - way[i] for i, axis in enumerate((ngs.x, ngs.y, ngs.z))]
        slip = [u[i] - self._before[i] - way[i] for i in range(3)]
        terms = []
        for tip, depth in zip(press.tips, press.depths, strict=True):
            pushed = rounded_energy(tip.inside(moved, float(depth)), tip.cushion)
            held = self._held(tip, float(depth), slip)
            terms += [ngs.Variation(term.Compile() * skin) for term in (pushed, held)]
        return terms

    def _held(self, tip: Tip, depth: float, slip: list[Any]) -> Any:
        """Return an energy per area of springs that hold the skin which the press touched."""
        ngs = require_ngsolve()
        axes = (ngs.x, ngs.y, ngs.z)
        pressed = [axis + self._before[i] for i, axis in enumerate(axes)]
        normal = surface_normal(tip, pressed, depth)
        along = sum(a * b for a, b in zip(slip, normal, strict=True))
        square = sum((a - along * b) ** 2 for a, b in zip(slip, normal, strict=True))
        return ngs.IfPos(tip.inside(pressed, depth), 1.0, 0.0) * _TIE / 2 * square


def surface_normal(tip: Tip, place: list[Any], depth: Any) -> list[Any]:
    """Return the outward normal of a tip's surface at a place that touches it.

    Args:
        tip: The tip.
        place: Three components of the place, mm, numbers or coefficient functions.
        depth: Depth of the tip, mm, likewise.
    """
    if math.isinf(tip.radius):
        return [float(part) for part in tip.axis]
    ngs = require_ngsolve()
    q = [
        place[i] - float(start) + depth * float(part)
        for i, (start, part) in enumerate(zip(tip.start, tip.axis, strict=True))
    ]
    above = sum(a * float(b) for a, b in zip(q, tip.axis, strict=True))
    rod = ngs.IfPos(above, above, 0.0)  # beside the rod the normal is that of a cylinder
    side = [a - rod * float(b) for a, b in zip(q, tip.axis, strict=True)]
    length = ngs.sqrt(sum(a * a for a in side) + 1e-20)
    return [a / length for a in side]
