"""Pins of one sensor, seen on the layout of another sensor of the same make.

A camera that is turned, shifted or nearer shows the same pins elsewhere. The similarity that takes
the pins at rest to those of a reference layout undoes this, for places and for displacements. What
remains is the difference between the two sensors themselves.

A common view of sensors with different pins: displacements on a lattice that all layouts share.

A layout is measured by itself. Its centre is the mean of its pins. Its axes are stretched so that
the pins spread alike along both, which undoes frames that were resized unevenly; its unit is the
mean distance of the six outermost pins from the centre, the corners of a hexagonal layout or some
of the outer ring of a round one. What a TacTip with 127 and one with 331 pins have in common is
this outline, not the pitch or the mean radius of their pins.

Between the pins displacements are interpolated by kriging with a linear trend (Rasmussen and
Williams 2006, eq. 2.41 and 2.42): with K the covariance of the pins, k that of a lattice point with
them, and H = [1, x, y] of the pins,

    weights = h B + k K^-1 (I - H B),    B = (H' K^-1 H)^-1 H' K^-1

so that shifts, turns and stretches of all pins are carried over exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Frame, Pose
from tactibench.errors import UserError
from tactibench.markers.pin_tracker import BySensor, PinTracker
from tactibench.markers.tracker import Tracks

Array = npt.NDArray[np.float64]

RINGS, REACH = 6, 0.8
"""Rings of the lattice, which has 127 points, and radius of the last one in units of the layout:
beyond 0.8 a hexagonal layout has pins in its corners only."""
OUTERMOST = 6
"""Pins whose mean radius is the size of a layout: a hexagon has six corners, and one pin may be
lost."""
LENGTH = 0.35
"""Length over which displacements are alike, units of the layout; dimples of a dome are wider."""
NUGGET = 1e-3
"""Variance of a pin's own motion, as a share of that of the field."""


@dataclass(frozen=True, eq=False)
class Outline:
    """The unit by which a layout of pins is measured.

    Attributes:
        centre: (2,) px.
        scale: (2,) px along x and y that are one unit.
    """

    centre: Array
    scale: Array

    @classmethod
    def of(cls, rest: Array) -> Self:
        """Return the outline of pins (P, 2) px at rest.

        Raises:
            UserError: The pins lie on a line, or are fewer than seven.
        """
        centre = rest.mean(axis=0)
        spread = np.sqrt(np.square(rest - centre).mean(axis=0))
        if len(rest) <= OUTERMOST or not spread.min() > 1e-3 * spread.max():
            raise UserError(
                f"{len(rest)} pins lie on a line or are too few to see a sensor's outline by; a "
                "model that moves between sensors needs a rest frame with all pins."
            )
        stretch = spread / np.sqrt(spread.prod())
        radius = np.hypot(*((rest - centre) / stretch).T)
        return cls(centre, stretch * np.sort(radius)[-OUTERMOST:].mean())

    def places(self, xy: Array) -> Array:
        """Return places (..., 2) px relative to the centre, in units of the layout."""
        return np.asarray((xy - self.centre) / self.scale, dtype=np.float64)


def common_lattice() -> Array:
    """Return the (L, 2) points of the lattice, in units of a layout.

    Ring k around the centre has 6 k points, and the last ring lies at ``REACH`` units.
    """
    points = [(0.0, 0.0)]
    for ring in range(1, RINGS + 1):
        turns = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        radius = REACH * ring / RINGS
        points += list(zip(radius * np.cos(turns), radius * np.sin(turns), strict=True))
    return np.array(points)


def kriging_weights(places: Array, points: Array) -> Array:
    """Return (L, P) weights that give a field at points (L, 2) from its values at places (P, 2)."""
    trend, target = _linear(places), _linear(points)
    inverse = np.linalg.inv(_covariance(places, places) + NUGGET * np.eye(len(places)))
    slope = np.linalg.solve(trend.T @ inverse @ trend, trend.T @ inverse)
    residual = np.eye(len(places)) - trend @ slope
    return np.asarray(target @ slope + _covariance(points, places) @ inverse @ residual)


def common_view(rest: Array, points: Array) -> Callable[[Array], Array]:
    """Return a function from displacements of pins to those on the common lattice.

    It turns displacements (N, 2 P) px, x of all before y of all, into (N, 2 L) in units of the
    layout.

    Args:
        rest: (P, 2) px, the pins at rest.
        points: (L, 2) points of the lattice, in units of the layout.

    Raises:
        UserError: The pins lie on a line, or are fewer than seven.
    """
    outline = Outline.of(rest)
    weights = kriging_weights(outline.places(rest), points)

    def view(moved: Array) -> Array:
        x, y = np.split(moved, 2, axis=1)
        unit_x, unit_y = outline.scale
        return np.concatenate([x @ weights.T / unit_x, y @ weights.T / unit_y], axis=1)

    return view


def _linear(xy: Array) -> Array:
    return np.column_stack([np.ones(len(xy)), xy])


def _covariance(a: Array, b: Array) -> Array:
    square = np.square(a[:, None] - b).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * square / LENGTH**2), dtype=np.float64)


Flags = npt.NDArray[np.bool_]
Images = npt.NDArray[np.uint8]

_TURNS_DEG = (0, 6, -6, 12, -12, 18, -18)
"""Turns of a camera from which the match starts; the match with most pins is taken. A start may be
off by 4 deg: farther, pins at the rim lie nearer to other pins. 30 deg are half the symmetry of a
hexagon."""
_ROUNDS = 20
"""Most rounds of matching pins and fitting the similarity; a few suffice."""
_NEAR = 0.4
"""Spacings within which a pin is matched to the reference's: at half a spacing another pin would be
as near."""
_FEWEST = 0.7
"""Share of the reference's pins that must be found; the public ranges lose at most 0.3 of them."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map x -> matrix x + shift of places (..., 2) px: a turn, an even stretch and a shift.

    Attributes:
        matrix: (2, 2).
        shift: (2,) px.
    """

    matrix: Array
    shift: Array

    @classmethod
    def identity(cls) -> Self:
        """Return the map that leaves every place where it is."""
        return cls(np.eye(2), np.zeros(2))

    @classmethod
    def of(cls, shift: Array, turn: float, stretch: float, about: Array) -> Self:
        """Return the map that turns and stretches about a place, then shifts.

        Args:
            shift: (2,) px.
            turn: Angle from x towards y, rad.
            stretch: Logarithm of the factor of the stretch.
            about: (2,) px, the place that is only shifted.
        """
        cosine, sine = np.cos(turn), np.sin(turn)
        matrix = np.exp(stretch) * np.array([[cosine, -sine], [sine, cosine]])
        return cls(matrix, shift + about - matrix @ about)

    @classmethod
    def between(cls, start: Array, end: Array) -> Self:
        """Return the map from places to other places with the least squared misfit.

        This is complex linear regression: end = a start + b, with a and b complex.

        Args:
            start: (N, 2) px.
            end: (N, 2) px, where the map should take them.
        """
        first, last = (places[:, 0] + 1j * places[:, 1] for places in (start, end))
        off = first - first.mean()
        a = np.vdot(off, last) / np.vdot(off, off).real
        b = last.mean() - a * first.mean()
        return cls(np.array([[a.real, -a.imag], [a.imag, a.real]]), np.array([b.real, b.imag]))

    def __call__(self, places: Array) -> Array:
        """Return where places (..., 2) come to lie."""
        return places @ self.matrix.T + self.shift

    def back(self, places: Array) -> Array:
        """Return where places (..., 2) come from."""
        return (places - self.shift) @ np.linalg.inv(self.matrix).T

    def after(self, first: Similarity) -> Similarity:
        """Return the map that applies ``first``, then this map."""
        return Similarity(self.matrix @ first.matrix, self(first.shift))


class AlignedPins:
    """The pins of one sensor on a reference layout of P pins, in the order of the layout.

    The layout has P pins, the sensor has P'.

    Attributes:
        pins: Pins of the sensor in its own frames.
        view: From the reference layout to the sensor's frames.
    """

    def __init__(self, pins: PinTracker, layout: Array) -> None:
        """Find the pins of a reference layout among those of the sensor.

        Args:
            pins: Pins of the sensor in its own frames.
            layout: (P, 2) px, pins of the reference layout at rest.

        Raises:
            UserError: Too few pins of the layout are found among those of the sensor.
        """
        self.pins = pins
        self._layout = layout
        if np.array_equal(pins.rest, layout):
            self.view, self._own = Similarity.identity(), np.arange(len(layout))
            self._there = np.ones(len(layout), dtype=np.bool_)
        else:
            self.view, self._own, self._there = _match(pins.rest, layout)
        self._rest = np.where(self._there[:, None], self.view.back(pins.rest[self._own]), layout)

    def moved(self, motion: Similarity) -> AlignedPins:
        """Return the same pins in frames that have moved by ``motion``, in px of the layout."""
        other = copy(self)
        other.view = self.view.after(motion)
        return other

    @property
    def rest(self) -> Array:
        """The pins at rest, (P, 2) px of the layout."""
        return self._rest

    @property
    def layout_clues(self) -> Array:
        """How this sensor differs from the layout at rest, (1 + 2 P,).

        These are the logarithm of its relative size and the pins' deviations from the layout, px,
        x of all pins before y of all.
        """
        deviation = (self._rest - self._layout).T.reshape(-1)
        return np.append(self._stretch, deviation)

    @property
    def _stretch(self) -> float:
        """Logarithm of the factor from the layout to the sensor's frames."""
        return float(np.log(np.linalg.det(self.view.matrix)) / 2)

    def track(self, images: Images) -> tuple[Array, Flags]:
        """Return displacements (N, 2 P) px of the layout, and (N, P) whether each pin is sure.

        A pin that the sensor lacks is never sure.

        Args:
            images: (N, side, side) gray images of the sensor.
        """
        moved, sure = self.pins.track(images)
        return self._seen(moved), sure[:, self._own] & self._there

    def retrack(self, images: Images, moved: Array) -> tuple[Array, Flags]:
        """Return the same as ``track``, of frames in which the displacements are roughly known.

        Args:
            images: (N, side, side) gray images of the sensor.
            moved: (N, 2 P) approximate displacements, px of the layout.
        """
        start = (self.place(moved) - self.pins.rest).transpose(0, 2, 1).reshape(len(moved), -1)
        again, seen = self.pins.retrack(images, start)
        return self._seen(again), seen[:, self._own] & self._there

    def place(self, moved: Array) -> Array:
        """Return the places of the sensor's pins in its frames, (N, P', 2) px.

        Pins that the layout does not have stay at rest.

        Args:
            moved: (N, 2 P) displacements, px of the layout.
        """
        places = self._rest + moved.reshape(len(moved), 2, -1).transpose(0, 2, 1)
        xy = np.repeat(self.pins.rest[None], len(moved), axis=0)
        xy[:, self._own[self._there]] = self.view(places)[:, self._there]
        return xy

    def in_layout_order(self, values: Array) -> Array:
        """Return values (N, P') of the sensor's pins in the order of the layout, (N, P).

        The value of a pin that the sensor lacks is 0.
        """
        return np.where(self._there, values[:, self._own], 0.0)

    def in_own_order(self, values: Array) -> Array:
        """Return values (N, P) of the layout's pins in the order of the sensor, (N, P').

        The value of a pin that the layout lacks is 0.
        """
        ordered = np.zeros((len(values), len(self.pins.rest)))
        ordered[:, self._own[self._there]] = values[:, self._there]
        return ordered

    def tracks(self, images: Images) -> Tracks:
        """Return the layout's pins, moved as much since rest as those of the sensor.

        A pin of the layout that this sensor lacks stands at rest and is not seen. Radii are px of
        the sensor's frames.

        Args:
            images: (N, side, side) gray images of the sensor.
        """
        tracks = self.pins.tracker.track(images)
        xy = self.view.back(tracks.xy[:, self._own]) + (self._layout - self._rest)
        xy[:, ~self._there] = self._layout[~self._there]
        return Tracks(xy, tracks.seen[:, self._own] & self._there, tracks.radius[:, self._own])

    @cached_property
    def radius(self) -> Array:
        """Radii of the discs at rest, (P,) px of the sensor's frames.

        They are NaN where centroids are used.
        """
        radius: Array = self.tracks(self.pins.rest_image[None]).radius[0]
        return radius

    @property
    def pitch(self) -> float:
        """Median distance of a pin at rest from its nearest neighbour, px of the layout."""
        return self.pins.pitch / float(np.exp(self._stretch))

    def _seen(self, moved: Array) -> Array:
        """Return displacements (N, 2 P') in the sensor's frames on the layout, (N, 2 P)."""
        xy = self.pins.rest + moved.reshape(len(moved), 2, -1).transpose(0, 2, 1)
        places = self.view.back(xy[:, self._own]) - self._rest
        places[:, ~self._there] = 0.0
        return places.transpose(0, 2, 1).reshape(len(moved), -1)


class AlignedSensors(BySensor[AlignedPins]):
    """Sensors of one make, each on the layout of the first sensor.

    A frame without a rest image is taken for a frame of the first sensor.
    """

    def __init__(self, first: PinTracker) -> None:
        """Take the pins of ``first`` as the layout."""
        super().__init__(lambda own: AlignedPins(own, first.rest))
        self.number(Frame(first.rest_image, 0.0, Pose(), first.rest_image))

    @classmethod
    def of(cls, frames: Sequence[Frame], otherwise: Frame | None = None) -> Self:
        """Return the sensors of a training.

        The first sensor is that of the first frame with a rest image.

        Args:
            frames: Frames of any number of sensors.
            otherwise: A frame that is hardly pressed, for frames without a rest image.

        Raises:
            UserError: No frame has a rest image, and ``otherwise`` is None. Or the frame that is
                used shows no pins.
        """
        with_rest = [frame for frame in frames if frame.rest is not None]
        return cls(PinTracker.of(with_rest[:1], otherwise))

    @property
    def first(self) -> PinTracker:
        """The pins of the first sensor."""
        return self[0].pins

    def number(self, frame: Frame) -> int:
        """Return the number of the frame's sensor, 0 for the first one.

        Raises:
            UserError: The sensor's pins are not those of the layout.
        """
        return 0 if frame.rest is None else super().number(frame)

    def tracks(self, frames: Sequence[Frame]) -> Tracks:
        """Return the pins of frames as if all frames were of the first sensor.

        Each pin has moved and grown since rest as much as the same pin of the frame's own sensor.
        """
        shape = len(frames), len(self.first.rest)
        out = Tracks(np.empty((*shape, 2)), np.empty(shape, dtype=np.bool_), np.empty(shape))
        for number, rows in self.rows(frames).items():
            sensor = self[number]
            tracks = sensor.tracks(sensor.pins.images([frames[row] for row in rows]))
            out.xy[rows], out.seen[rows] = tracks.xy, tracks.seen
            out.radius[rows] = tracks.radius * (self[0].radius / sensor.radius)
        return out


def _match(rest: Array, layout: Array) -> tuple[Similarity, npt.NDArray[np.intp], Flags]:
    """Match the pins of a layout to those of a sensor.

    Args:
        rest: (P', 2) px, the sensor's pins at rest.
        layout: (P, 2) px.

    Returns:
        The similarity from the layout to the sensor, (P,) the number of each pin of the layout in
        the sensor, and (P,) whether the sensor has that pin.

    Raises:
        UserError: Too few pins of the layout are found among those of the sensor.
    """
    middle = layout.mean(axis=0)
    shift = rest.mean(axis=0) - middle
    spread = [np.sqrt(np.square(xy - xy.mean(axis=0)).sum(axis=1).mean()) for xy in (layout, rest)]
    stretch = float(np.log(spread[1] / spread[0]))
    starts = (Similarity.of(shift, turn, stretch, middle) for turn in np.radians(_TURNS_DEG))
    best = max((_settle(rest, layout, start) for start in starts), key=lambda each: each[2].sum())
    common = np.count_nonzero(best[2])
    if common < max(_FEWEST * len(layout), 3):
        raise UserError(
            f"the rest frame shows {len(rest)} pins, of which {common} lie where the {len(layout)} "
            "of the training sensor are; test on a sensor of the same make, or train on this one."
        )
    return best


def _settle(
    rest: Array, layout: Array, view: Similarity
) -> tuple[Similarity, npt.NDArray[np.intp], Flags]:
    """Return what ``_match`` does, from one first view; it may find too few pins."""
    from scipy.spatial import cKDTree

    tree = cKDTree(rest)
    reach = _NEAR * float(np.median(tree.query(rest, k=2)[0][:, 1]))
    for _ in range(_ROUNDS):
        apart, nearest = tree.query(view(layout))
        matched = apart < reach
        matched &= np.bincount(nearest[matched], minlength=len(rest))[nearest] == 1
        if np.count_nonzero(matched) < 3:  # too few for a turn, a stretch and a shift
            break
        fitted = Similarity.between(layout[matched], rest[nearest[matched]])
        settled = np.allclose(fitted(layout), view(layout), atol=1e-9)
        view = fitted
        if settled:
            break
    return view, nearest, matched
