"""The vocabulary: contacts, indenters, poses, scenes, frames and the heatmap grid.

Frame of reference: right-handed, origin at the undeformed apex of the dome, x right and y down in
the sensor image (the camera looks outward), z out of the dome. Lengths are millimetres, angles
degrees. Depth is a tip's travel past its own first touch along -z.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import compress, pairwise
from typing import cast

import numpy as np
import numpy.typing as npt

from tactibench.errors import NotFiniteError, UserError

FloatArray = npt.NDArray[np.float64]


def _column(values: npt.ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if name == "depth" and array.size and np.isnan(array).all():  # not known
        array.flags.writeable = False
        return array.reshape(shape)
    if array.shape != shape:
        if array.size:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
        array = array.reshape(shape)
    if not all(map(math.isfinite, array.ravel().tolist())):  # a few values: faster than an array
        raise NotFiniteError(f"{name} holds a value that is not finite")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of one frame, best first. Zero contacts are allowed.

    Attributes:
        xy: (N, 2) axis of each tip, mm.
        depth: (N,) travel past first touch, mm; all NaN: not known.
        score: (N,) in 0..1, descending; truth has score 1.
        std: (N, 3) the model's own 1-sigma of x, y and depth, mm.
        force: (N, 3) force on the skin along x, y and z, N; None: not known. The part along the
            line from a tip's centre to the dome's is the normal force, the rest the tangential one.

    Raises:
        ValueError: Shapes do not fit, a value is not finite, or a score lies outside 0..1.
    """

    xy: FloatArray
    depth: FloatArray
    score: FloatArray
    std: FloatArray | None = None
    force: FloatArray | None = None

    def __post_init__(self) -> None:
        n = np.size(self.depth)
        columns = {
            "xy": _column(self.xy, (n, 2), "xy"),
            "depth": _column(self.depth, (n,), "depth"),
            "score": _column(self.score, (n,), "score"),
        }
        for name, values in (("std", self.std), ("force", self.force)):
            if values is not None:
                columns[name] = _column(values, (n, 3), name)
        score = columns["score"].tolist()
        if n and not (min(score) >= 0 and max(score) <= 1):
            raise ValueError("score lies outside 0..1")
        if any(later > earlier for earlier, later in pairwise(score)):
            order = np.argsort(-columns["score"], kind="stable")
            columns = {name: _column(c[order], c.shape, name) for name, c in columns.items()}
        for name, column in columns.items():
            object.__setattr__(self, name, column)

    @classmethod
    def truth(
        cls,
        xy: npt.ArrayLike,
        depth: npt.ArrayLike | None = None,
        force: npt.ArrayLike | None = None,
    ) -> Contacts:
        """Return contacts that are true rather than predicted: every score is 1.

        Without depths they are not known, and NaN.
        """
        places = np.asarray(xy)
        depths = np.full(len(places), np.nan) if depth is None else np.asarray(depth)
        known = None if force is None else np.asarray(force)
        return cls(places, depths, np.ones(np.size(depths)), force=known)

    @classmethod
    def none(cls) -> Contacts:
        """Return no contact at all."""
        return cls(np.empty((0, 2)), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def knows_depth(self) -> bool:
        """Whether the depths are known; those of no contact are."""
        return not np.isnan(self.depth).any()

    def top(self, count: int) -> Contacts:
        """Return the ``count`` contacts with the highest scores."""
        std, force = (None if c is None else c[:count] for c in (self.std, self.force))
        return Contacts(self.xy[:count], self.depth[:count], self.score[:count], std, force)


@dataclass(frozen=True)
class PlatePose:
    """A flat plate on the dome.

    Attributes:
        depth: Indentation along the plate's normal, mm.
        tilt: Angle between the plate's normal and the dome's axis, deg.
        std: The model's own 1-sigma of depth and tilt.
    """

    depth: float
    tilt: float
    std: tuple[float, float] | None = None


@dataclass(frozen=True)
class Sites:
    """The places that are touched, of a list of K places that have names.

    Attributes:
        names: Name of every place.
        probability: Probability that each place is touched, 0..1.
        touched: Whether each place is in the predicted set, or in the true one.

    Raises:
        ValueError: Lengths differ, or a probability lies outside 0..1 or is not finite.
    """

    names: tuple[str, ...]
    probability: tuple[float, ...]
    touched: tuple[bool, ...]

    def __post_init__(self) -> None:
        if not len(self.names) == len(self.probability) == len(self.touched):
            raise ValueError("names, probability and touched differ in length")
        if not all(map(math.isfinite, self.probability)):
            raise NotFiniteError("a probability is not finite")
        if not all(0 <= value <= 1 for value in self.probability):
            raise ValueError("a probability lies outside 0..1")

    @classmethod
    def truth(cls, names: Sequence[str], touched: Iterable[bool]) -> Sites:
        """Return places of which it is known whether they are touched."""
        known = tuple(map(bool, touched))
        return cls(tuple(names), tuple(map(float, known)), known)

    @property
    def count(self) -> int:
        """Number of touched places."""
        return sum(self.touched)

    def __str__(self) -> str:
        return "+".join(compress(self.names, self.touched)) or "nothing"


Answer = Contacts | PlatePose | Sites
"""A model's answer to one frame, or its truth."""


@dataclass(frozen=True)
class Indenter:
    """Spherical tips on a rigid holder, or a plate.

    Attributes:
        radius: Radius of every tip, mm; ``inf`` for a plate, NaN where it is not known.
        offsets: One (dx, dy, dz) per tip, mm, in the indenter's own frame; a larger dz reaches
            further towards the sensor.
        name: Name of the kind, such as "dual".

    Raises:
        ValueError: The radius is not positive, there is no tip, or an offset is not finite.
    """

    radius: float
    offsets: tuple[tuple[float, float, float], ...]
    name: str

    def __post_init__(self) -> None:
        if self.radius <= 0:
            raise ValueError(f"an indenter's radius is {self.radius} mm, it must be positive")
        if not self.offsets:
            raise ValueError("an indenter needs at least one tip")
        if not all(math.isfinite(value) for offset in self.offsets for value in offset):
            raise ValueError(f"an indenter's offsets {self.offsets} are not finite")

    @property
    def is_plate(self) -> bool:
        """True for a plate."""
        return math.isinf(self.radius)

    @classmethod
    def single(cls, radius: float = 3.0) -> Indenter:
        """Return one spherical tip."""
        return cls(radius, ((0.0, 0.0, 0.0),), "single")

    @classmethod
    def dual(cls, distance: float, radius: float = 3.0) -> Indenter:
        """Return two tips of equal height, ``distance`` mm apart along the indenter's x axis."""
        half = distance / 2
        return cls(radius, ((-half, 0.0, 0.0), (half, 0.0, 0.0)), "dual")

    @classmethod
    def triple(
        cls, heights: tuple[float, float, float], side: float = 8.0, radius: float = 3.0
    ) -> Indenter:
        """Return three tips on an equilateral triangle.

        Args:
            heights: Height of the insert under each tip, mm.
            side: Side of the triangle, mm.
            radius: Radius of every tip, mm.
        """
        r = side / math.sqrt(3)
        turns = (math.pi / 2 + k * 2 * math.pi / 3 for k in range(3))
        offsets = tuple(
            (r * math.cos(a), r * math.sin(a), h) for a, h in zip(turns, heights, strict=True)
        )
        return cls(radius, offsets, "triple")

    @classmethod
    def plate(cls) -> Indenter:
        """Return a flat plate."""
        return cls(math.inf, ((0.0, 0.0, 0.0),), "plate")


@dataclass(frozen=True)
class Pose:
    """Pose of an indenter.

    Attributes:
        x: Place of its axis, mm.
        y: Place of its axis, mm.
        yaw: Turn about z, deg.
        tilt: Angle to z, deg.
        depth: Travel past the indenter's first touch, mm: the tip that touches first has this
            depth, the others less. A plate's depth is measured along its own normal. NaN: it
            touches, and nobody knows how deep.
        dx: Travel along x after first touch, to its present place, mm.
        dy: Travel along y after first touch, mm.
        dyaw: Turn about z after first touch, deg.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    tilt: float = 0.0
    depth: float = 0.0
    dx: float = 0.0
    dy: float = 0.0
    dyaw: float = 0.0

    @property
    def moved(self) -> bool:
        """True where it moved sideways after first touch and so may have dragged the skin."""
        return self.dx != 0.0 or self.dy != 0.0 or self.dyaw != 0.0


@dataclass(frozen=True)
class Scene:
    """A press: an indenter at a pose. A sensor turns it into a Frame.

    Attributes:
        indenter: The indenter.
        pose: The pose of the indenter.
        sites: The named places that it touches; None where contacts are known instead.
    """

    indenter: Indenter
    pose: Pose
    sites: Sites | None = None

    @classmethod
    def of_sites(cls, sites: Sites) -> Scene:
        """Return a scene of which nothing is known but the named places that are touched."""
        unknown = Pose(*(math.nan,) * 5)
        return cls(Indenter(math.nan, ((0.0, 0.0, 0.0),), "named places"), unknown, sites)


@dataclass(frozen=True)
class Workspace:
    """The range in which a sensor can be pressed: the box of every tip of every press.

    Attributes:
        half_width_mm: Largest x and y in either direction, mm.
        depth_min_mm: Smallest depth of a tip, mm.
        depth_max_mm: Largest depth of a tip, mm; both NaN where depths are not known.
        dome_radius_mm: Radius of the touched surface, mm; inf where it is flat.
    """

    half_width_mm: float
    depth_min_mm: float
    depth_max_mm: float
    dome_radius_mm: float

    def __str__(self) -> str:
        shape = "flat" if math.isinf(self.dome_radius_mm) else f"dome of {self.dome_radius_mm:g} mm"
        depths = f"{self.depth_min_mm:.3g} to {self.depth_max_mm:.3g} mm deep"
        if math.isnan(self.depth_max_mm):
            depths = "depth not known"
        return f"x and y within {self.half_width_mm:.3g} mm, {depths}, {shape}"


Signal = npt.NDArray[np.uint8] | npt.NDArray[np.float32]
"""An image (uint8), or channels of any other sensor (float32)."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The signal of a sensor at one time.

    Attributes:
        signal: An image, (H, W) or (H, W, 3) uint8, or channels of any shape, float32: voltages,
            counts of magnetometers, pressures of taxels.
        timestamp: Monotonic time, s.
        pose: Pose that the indenter actually reached.
        rest: Signal of the undeformed sensor, of the same shape, if there is one. Where presses are
            spread over several sensor instances, it is that of the instance that was pressed.
        force: (K, 3) force on the skin of every true contact, N, see ``Contacts``; None: not known.
        session: Name of the session in which it was recorded; "" where it is not known.
    """

    signal: Signal
    timestamp: float
    pose: Pose
    rest: Signal | None = field(default=None, repr=False)
    force: FloatArray | None = field(default=None, repr=False)
    session: str = ""

    @property
    def image(self) -> npt.NDArray[np.uint8]:
        """The signal as an image.

        Raises:
            UserError: The signal is a row of channels and no image.
        """
        return _as_image(self.signal)

    @property
    def rest_image(self) -> npt.NDArray[np.uint8] | None:
        """The rest signal as an image, if there is one.

        Raises:
            UserError: The rest signal is a row of channels and no image.
        """
        return None if self.rest is None else _as_image(self.rest)


def _as_image(signal: Signal) -> npt.NDArray[np.uint8]:
    if signal.ndim < 2:
        raise UserError(
            f"the frame holds {signal.size} channels and no image; read its signal, or take a "
            "sensor with a camera."
        )
    return cast("npt.NDArray[np.uint8]", signal)


@dataclass(frozen=True)
class Grid:
    """The cells of heatmaps: the one place that maps cells to millimetres and back.

    Attributes:
        shape: (rows, columns); rows run along y, columns along x.
        origin: (x, y) of the centre of cell [0, 0], mm.
        pitch: Size of a cell, mm.
    """

    shape: tuple[int, int]
    origin: tuple[float, float]
    pitch: float

    @classmethod
    def centred(cls, cells: int, pitch: float) -> Grid:
        """Return a square grid around the apex, with centres at (i - (cells - 1) / 2) * pitch."""
        start = -(cells - 1) / 2 * pitch
        return cls((cells, cells), (start, start), pitch)

    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Return x of every column (W,) and y of every row (H,), mm."""
        rows, columns = self.shape
        return (
            np.asarray(self.origin[0] + self.pitch * np.arange(columns), dtype=np.float64),
            np.asarray(self.origin[1] + self.pitch * np.arange(rows), dtype=np.float64),
        )

    def xy(self, row: npt.ArrayLike, column: npt.ArrayLike) -> FloatArray:
        """Return the places of cell indices, which may be fractional, (..., 2) mm."""
        x = self.origin[0] + self.pitch * np.asarray(column, dtype=np.float64)
        y = self.origin[1] + self.pitch * np.asarray(row, dtype=np.float64)
        return np.stack([x, y], axis=-1)

    def cells(self, xy: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the fractional (row, column) of places (..., 2) mm; they are not rounded."""
        points: FloatArray = np.asarray(xy, dtype=np.float64)
        row = np.asarray((points[..., 1] - self.origin[1]) / self.pitch, dtype=np.float64)
        column = np.asarray((points[..., 0] - self.origin[0]) / self.pitch, dtype=np.float64)
        return row, column
