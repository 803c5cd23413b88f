"""Test frames of hard cases, in place of those that a protocol draws.

Scenes are pressed; faults are done to the frames of the base family when they are opened. One value
of a family changes the scene, everything else stays the same: all cases of a family draw press k
from the same random numbers, so that a case differs from the easy one in its value alone wherever
the workspace allows it, and errors can be paired press by press.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tactibench.contacts import FloatArray, Frame, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames.drawn_presses import DrawnFrames, SensorFrames
from tactibench.frames.faults import FAULTS
from tactibench.frames.presses import Presses
from tactibench.frames.source import Advance, FrameSet, spread
from tactibench.plugins import IMAGE, Sensor
from tactibench.protocols import PATIENCE, Cases, Family, Workspace, case, untouched
from tactibench.records import arrays_hash, combined, digest

PART = 5
"""Number of the part, whose frames have noise of their own: not used by ``protocols.split`` or for
reference frames."""
FAULT_STREAM = 1_000
"""Last word of the spawn key of a press's fault; the key of a scene has no such word."""


class Row(NamedTuple):
    """One frame: a press of one case of a family.

    Attributes:
        family: Name of the family.
        value: Value of the case.
        press: Number of the press in the case.
        untouched: Whether the fault is done to a frame in which nothing presses.
    """

    family: str
    value: float
    press: int
    untouched: bool = False

    @property
    def group(self) -> str:
        """Return the name of the case."""
        return untouched(self.family) if self.untouched else case(self.family, self.value)

    @property
    def name(self) -> str:
        """Return the name of the frame."""
        return f"{self.group}-{self.press}"


class HardCaseFrames(DrawnFrames):
    """The cases of all families of a protocol; the training presses are drawn as usual."""

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the frames of all families, in their order, or as many as the request asks for.

        Raises:
            UserError: The request asks for reference scenes, or the sensor has no camera, has no
                dome, or cannot be set as a family asks.
        """
        if self.request.reference:
            raise UserError(
                f"protocol {self.spec.id!r} presses hard cases of its own and has no reference "
                "scenes; leave --test reference out."
            )
        if self.testing.sensor.signal != IMAGE:
            raise UserError(
                f"protocol {self.spec.id!r} changes images (light, blur, noise), but sensor "
                f"{self.testing.component.name!r} gives {self.testing.sensor.signal}; take a "
                "sensor with a camera."
            )
        if math.isinf(self._space.dome_radius_mm):
            raise UserError(
                f"protocol {self.spec.id!r} presses a dome as far as its edge, but sensor "
                f"{self.testing.component.name!r} is flat; take a sensor with a dome."
            )
        chosen = spread(self._rows, self.request.test_count)
        sets: list[FrameSet] = []
        for untouched_frames in (False, True):
            of_kind = [row for row in chosen if row.untouched == untouched_frames]
            for family in self.spec.families:
                rows = [row for row in of_kind if row.family == family.name]
                if rows:
                    sets += self._family_sets(family, rows)
        return tuple(sets)

    def rejected(self) -> int:
        """Return 0: every case is made to fit the workspace."""
        return 0

    @property
    def _cases(self) -> Cases:
        assert self.spec.cases is not None  # noqa: S101 - the schema asks for it
        return self.spec.cases

    @cached_property
    def _base(self) -> Family:
        """The family whose frames the faults are done to."""
        return self.spec.family(self._cases.base)

    @cached_property
    def _rows(self) -> list[Row]:
        """Every frame of every case, and then those in which nothing presses under a fault."""
        rows = [
            Row(family.name, value, press)
            for family in self.spec.families
            for value in family.pressed_values
            for press in range(self._presses(family))
        ]
        cases = self._cases
        if cases.empty is None:
            return rows
        # Every frame has one fault, so that no two are of one press. Families take turns, and in
        # each its values.
        faults = [self.spec.family(name) for name in cases.untouched]
        for press in range(self._presses(self.spec.family(cases.empty))):
            turn, number = divmod(press, len(faults))
            values = faults[number].values
            rows.append(Row(faults[number].name, values[turn % len(values)], press, True))
        return rows

    @property
    def _space(self) -> Workspace:
        return self.testing.pressed.workspace

    def _presses(self, family: Family) -> int:
        return family.presses or self._cases.presses

    def _family_sets(self, family: Family, rows: Sequence[Row]) -> list[FrameSet]:
        if family.press is not None:
            return [self._pressed(family, rows)]
        if family.fault is not None:
            return [self._faulty(family, rows)]
        return [
            self._on_another_sensor(family, value, [row for row in rows if row.value == value])
            for value in dict.fromkeys(row.value for row in rows)
        ]

    def _pressed(self, family: Family, rows: Sequence[Row]) -> FrameSet:
        """Return the frames of the family's own scenes."""
        scenes = [self._scene(family, row.value, row.press) for row in rows]
        presses = [f"{family.name}-{row.press}" for row in rows]
        frames = self._with_parameters(family, family.sensor)
        return self._frame_set_of(frames, family, rows, scenes, presses)

    def _on_another_sensor(self, family: Family, value: float, rows: Sequence[Row]) -> FrameSet:
        """Return the frames of the base family's scenes on a sensor with another parameter."""
        base = self._base
        scenes = [self._scene(base, base.values[0], row.press) for row in rows]
        presses = [f"{base.name}-{row.press}" for row in rows]
        frames = self._with_parameters(family, {str(family.parameter): f"{value:g}"})
        return self._frame_set_of(frames, family, rows, scenes, presses)

    def _faulty(self, family: Family, rows: Sequence[Row]) -> FrameSet:
        """Return frames of the base family, or those in which nothing presses, with a fault."""
        base = self._base
        if rows[0].untouched:
            base = self.spec.family(str(self._cases.empty))
        count = self._presses(base)
        frames = self._pressed(base, [Row(base.name, base.values[0], k) for k in range(count)])
        return FaultyFrameSet(
            role="test",
            name=untouched(family.name) if rows[0].untouched else family.name,
            scenes=tuple(frames.scenes[row.press] for row in rows),
            groups=tuple(row.group for row in rows),
            names=tuple(row.name for row in rows),
            presses=tuple(frames.presses[row.press] for row in rows),
            base=frames,
            fault=str(family.fault),
            seed=(self.testing.protocol.data_seed, family.stream),
            rows=tuple(rows),
        )

    def _frame_set_of(
        self,
        frames: SensorFrames,
        family: Family,
        rows: Sequence[Row],
        scenes: Sequence[Scene],
        presses: Sequence[str],
    ) -> FrameSet:
        return frames.frame_set(
            "test",
            family.name,
            scenes,
            [row.name for row in rows],
            PART,
            stream=family.stream,
            presses=presses,
            groups=[row.group for row in rows],
        )

    def _with_parameters(self, family: Family, given: dict[str, str]) -> SensorFrames:
        """Return the sensor with other parameters.

        Args:
            family: The family, for the error.
            given: Parameter -> value as text.

        Raises:
            UserError: The sensor does not have a parameter, or does not allow its value.
        """
        frames, protocol = self.testing, self.request.protocol
        if not given:
            return frames
        try:
            changed = frames.component.spec.settings(given)
        except UserError as error:
            raise UserError(
                f"family {family.name!r} of protocol {protocol.spec.id!r} changes the sensor: "
                f"{error}"
            ) from None
        return frames.with_values(**{name: changed[name] for name in given})

    def _scene(self, family: Family, value: float, press: int) -> Scene:
        protocol = self.testing.protocol
        seed = np.random.SeedSequence(protocol.data_seed, spawn_key=(family.stream, press))
        return case_scene(family, value, self._space, seed)


@dataclass(frozen=True, kw_only=True)
class FaultyFrameSet(FrameSet):
    """Frames of the base family with a fault each; the rest frame stays as it was.

    Attributes:
        base: The frames before the fault.
        fault: Name of the fault in ``FAULTS``.
        seed: Data seed and stream of its random numbers. Press k has the same ones for every
            value, so that a greater value is the same fault, grown.
        rows: Case and number of the press of every frame.
    """

    base: FrameSet
    fault: str
    seed: tuple[int, int]
    rows: tuple[Row, ...]

    @property
    def key(self) -> str:
        """Return the identity of the base frames and their faults."""
        return digest([self.base.key, self.fault, *self.seed, self.rows])

    @property
    def cached(self) -> bool:
        """Return whether the base frames are in the cache."""
        return self.base.cached

    def remove(self) -> None:
        """Remove the base frames from the cache."""
        self.base.remove()

    def open_sensor(self) -> Sensor | None:
        """Return the sensor of the base frames, to be asked and not to be pressed."""
        return self.base.open_sensor()

    def open(self, advance: Advance) -> Presses:
        """Return the base frames with their faults."""
        presses = self.base.open(lambda _: None)
        data_seed, stream = self.seed
        frames: list[Frame] = []
        for row in self.rows:
            key = (stream, row.press, FAULT_STREAM)
            rng = np.random.default_rng(np.random.SeedSequence(data_seed, spawn_key=key))
            frame = presses.frames[row.press]
            image = FAULTS[self.fault](np.array(frame.image), row.value, rng)
            image.setflags(write=False)
            frames.append(replace(frame, signal=image))
            advance(1)
        images = arrays_hash({"images": np.stack([frame.image for frame in frames])})
        return Presses(
            presses.name,
            self.scenes,
            frames,
            self.names,
            combined([presses.hash, images, *self.names]),
            dome_radius=presses.dome_radius,
        )


Tips = tuple[FloatArray, FloatArray]
"""(K, 2) axes and (K,) depths of the tips, mm."""
Candidate = Callable[[Family, float, Workspace, np.random.Generator], Tips]


def case_scene(
    family: Family, value: float, workspace: Workspace, seed: np.random.SeedSequence
) -> Scene:
    """Return one press of a case.

    Args:
        family: Family of the case.
        value: Value of the case, graded from easy to hard.
        workspace: Workspace in which the tips lie.
        seed: Seed of the press, the same for every value of the family.

    Raises:
        UserError: The workspace leaves (almost) no room for the press.
    """
    rng = np.random.default_rng(seed)
    kind = str(family.press)
    radius = value if kind == "tip-radius" else family.radius_mm or math.nan
    for _ in range(PATIENCE):
        xy, depth = CANDIDATES[kind](family, value, workspace, rng)
        inside = kind == "off-axis" or float(np.abs(xy).max()) <= workspace.half_width_mm + 1e-9
        inside &= float(np.hypot(*xy.T).max()) < workspace.dome_radius_mm + radius
        if inside and (kind != "distance" or float(depth.min()) >= workspace.depth_min_mm):
            scene = scene_of_depths(xy, depth, radius, workspace.dome_radius_mm, kind)
            return _moved(scene, value, rng) if kind == "sheared" else scene
    raise UserError(
        f"family {family.name!r}: none of {PATIENCE:,} candidates of {value:g} fitted the "
        "workspace; make the workspace larger or the indenter smaller."
    )


def scene_of_depths(
    xy: FloatArray, depth: FloatArray, radius: float, dome_radius: float, name: str
) -> Scene:
    """Return the scene in which all tips reach the given depths at once.

    A tip at distance rho from the axis first touches at sqrt((R_d + R)^2 - rho^2) (on a flat pad at
    0), so it is made longer by depth_k minus that, up to a constant that all tips share.

    Args:
        xy: (K, 2) axis of every tip, mm.
        depth: (K,) depth of every tip, mm.
        radius: Radius R of the tips, mm.
        dome_radius: Radius R_d of the dome, mm; inf: a flat pad.
        name: Name of the indenter.
    """
    longer = depth - _first_touch(xy, dome_radius + radius)
    middle = xy.mean(axis=0)
    offsets = np.column_stack([xy - middle, longer - longer.max()])
    tips = tuple((float(x), float(y), float(z)) for x, y, z in offsets)
    x, y = (float(value) for value in middle)
    return Scene(Indenter(radius, tips, name), Pose(x, y, depth=float(depth.max())))


def _moved(scene: Scene, way: float, rng: np.random.Generator) -> Scene:
    """Return the scene reached by moving ``way`` mm sideways, in a direction that is drawn."""
    turn = rng.uniform(0, 2 * math.pi)
    pose = replace(scene.pose, dx=way * math.cos(turn), dy=way * math.sin(turn))
    return replace(scene, pose=pose)


def _first_touch(xy: FloatArray, reach: float) -> FloatArray:
    """Return the (K,) height at which each tip of equal length first touches, mm.

    It is 0 beside the dome.

    Args:
        xy: (K, 2) axis of every tip, mm.
        reach: Sum of the radii of dome and tip, mm; inf: a flat pad.
    """
    if math.isinf(reach):
        return np.zeros(len(xy))
    height: FloatArray = np.sqrt(np.maximum(reach**2 - (xy**2).sum(axis=1), 0.0))
    return height


def _anywhere(space: Workspace, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(-space.half_width_mm, space.half_width_mm, 2)


def _depth(family: Family, rng: np.random.Generator) -> float:
    low, high = family.depth_mm or (math.nan, math.nan)
    return float(rng.uniform(low, high))


def _pair(middle: FloatArray, apart: float, turn: float) -> FloatArray:
    half = apart / 2 * np.array([math.cos(turn), math.sin(turn)])
    return np.stack([middle - half, middle + half])


def _nothing(_: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return a tip that touches the skin and does not press it."""
    return _anywhere(space, rng)[None], np.zeros(1)


def _single(_: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip, as `exp1` presses: place and depth uniform over the workspace."""
    xy = _anywhere(space, rng)[None]
    return xy, rng.uniform(space.depth_min_mm, space.depth_max_mm, 1)


def _at_depth(_: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip of depth ``value``, mm."""
    return _anywhere(space, rng)[None], np.array([value])


def _between(family: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip of a depth in a range; the value is its radius or its way sideways, mm."""
    return _anywhere(space, rng)[None], np.array([_depth(family, rng)])


def _off_axis(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip whose axis is ``value`` times the dome's radius away from the dome's axis."""
    turn = rng.uniform(0, 2 * math.pi)
    away = value * space.dome_radius_mm * np.array([[math.cos(turn), math.sin(turn)]])
    return away, np.array([_depth(family, rng)])


def _distance(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal height, as `exp2` presses, at distance ``value``, mm."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, math.pi)
    deepest = rng.uniform(space.depth_min_mm, space.depth_max_mm)
    xy = _pair(middle, value, turn)
    radius = space.dome_radius_mm + (family.radius_mm or math.nan)
    touch = _first_touch(xy, radius)
    return xy, deepest - (touch.max() - touch)


def _equal(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal depth at distance ``value``, mm."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, math.pi)
    return _pair(middle, value, turn), np.full(2, _depth(family, rng))


def _symmetric(family: Family, value: float, _: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal depth around the apex at distance ``value``, mm.

    They lie along a row, a column or a diagonal of the image.
    """
    turn = float(rng.integers(4)) * math.pi / 4
    return _pair(np.zeros(2), value, turn), np.full(2, _depth(family, rng))


def _beside(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return a deep tip and another one, whose depth is ``value`` times that of the first."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, 2 * math.pi)
    return _pair(middle, family.apart_mm or math.nan, turn), _depth(family, rng) * np.array(
        [1.0, value]
    )


def _ring(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return ``value`` tips at equal steps of a circle, each of its own depth."""
    count, ring = round(value), family.ring_mm or math.nan
    room = max(space.half_width_mm - ring, 0.0)
    middle, turn = rng.uniform(-room, room, 2), rng.uniform(0, 2 * math.pi)
    turns = turn + 2 * math.pi * np.arange(count) / count
    depth = np.array([_depth(family, rng) for _ in range(count)])
    return middle + ring * np.column_stack([np.cos(turns), np.sin(turns)]), depth


CANDIDATES: Mapping[str, Candidate] = {
    "nothing": _nothing,
    "anywhere": _single,
    "depth": _at_depth,
    "tip-radius": _between,
    "sheared": _between,
    "off-axis": _off_axis,
    "distance": _distance,
    "equal-depths": _equal,
    "symmetric": _symmetric,
    "beside": _beside,
    "ring": _ring,
}
"""Kind of press in a protocol -> function that draws the tips of a candidate."""
