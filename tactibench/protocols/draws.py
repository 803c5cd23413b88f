"""Drawing the presses of a protocol from a seed, and their division for training and test.

Presses are drawn by rejection. A press is in one part only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import NamedTuple
from typing import Protocol as StructuralType

import numpy as np
import numpy.typing as npt

from tactibench import contacts
from tactibench.contacts import Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.geometry import scene_of_contacts, tip_depths, tip_positions
from tactibench.protocols.schema import Draw, Plates, Protocol, Recorded, Split, Workspace

SAME_MM = 0.01
"""Lengths that differ by less are equal: tables state contacts in hundredths at worst, and the
lengths that protocols draw from are 0.5 mm apart."""
LABELLED_STREAM = 2_000_000
"""Random stream of the labelled presses of a tested sensor; protocols draw from streams below a
million."""
RESTART = 0.02
"""Probability that a place too near to another one ends a set of scattered tips: fifty such places
are tried for a set on average."""
PATIENCE = 10_000
"""Most candidates for one press; the rarest press of exp1, exp2 and exp3 takes some hundred."""


@dataclass(frozen=True)
class SceneSet:
    """Accepted scenes in order, and the number of candidates that did not fit the workspace."""

    scenes: tuple[Scene, ...]
    rejected: int


def draw_scenes(protocol: Protocol, name: str) -> SceneSet:
    """Return all presses of one draw: the same for equal keys and data seed, on every machine.

    Raises:
        UserError: The workspace leaves (almost) no room for a press of the draw.
    """
    return _drawn(protocol.draw(name), protocol.workspace, protocol.data_seed)


@lru_cache(maxsize=32)  # many runs of one process ask for the same thousands of presses
def _drawn(draw: Draw, workspace: Workspace, data_seed: int) -> SceneSet:
    seed = np.random.SeedSequence(data_seed, spawn_key=(draw.stream,))
    rng = np.random.default_rng(seed)
    scenes: list[Scene] = []
    rejected = 0
    for distance in _wanted_distances(draw):
        scene, refused = _accepted(draw, workspace, rng, distance)
        scenes.append(scene)
        rejected += refused
    return SceneSet(tuple(scenes), rejected)


def _wanted_distances(draw: Draw) -> list[float | None]:
    """Return the tip distance of every press, mm; None where it is drawn or there is none."""
    if draw.per_distance is None:
        return [None] * (draw.count or 0)
    return [distance for distance in draw.distances_mm for _ in range(draw.per_distance)]


def _accepted(
    draw: Draw, workspace: Workspace, rng: np.random.Generator, distance: float | None
) -> tuple[Scene, int]:
    """Return the first candidate that fits, and how many before it did not.

    Raises:
        UserError: None of ``PATIENCE`` candidates fits the workspace.
    """
    for refused in range(PATIENCE):
        scene = _candidate(draw, workspace, rng, distance)
        if fits(scene, workspace):
            return scene, refused
    at = "" if distance is None else f" at {distance} mm"
    raise UserError(
        f"draw {draw.name!r}: none of {PATIENCE:,} candidates{at} fitted the workspace; make the "
        "workspace or the depth range larger, or the indenter smaller."
    )


def fits(scene: Scene, workspace: Workspace) -> bool:
    """Return whether all tips lie in the workspace and inside its depth range."""
    half = workspace.half_width_mm
    if np.abs(tip_positions(scene)[:, :2]).max() > half:
        return False
    depth = tip_depths(scene, workspace.dome_radius_mm)
    # The deepest tip has the pose's depth up to rounding; a drawn 6.0 must not be refused.
    slack = 1e-9
    too_light = depth.min() < workspace.depth_min_mm - slack
    too_deep = depth.max() > workspace.depth_max_mm + slack
    return not (too_light or too_deep)  # a depth that is not known, NaN, lies in every range


def _candidate(
    draw: Draw, workspace: Workspace, rng: np.random.Generator, distance: float | None
) -> Scene:
    half = workspace.half_width_mm
    x, y = rng.uniform(-half, half, 2)
    depth = rng.uniform(workspace.depth_min_mm, workspace.depth_max_mm)
    yaw = 0.0 if draw.indenter == "single" else float(rng.uniform(0, 360))
    pose = Pose(float(x), float(y), yaw, 0.0, float(depth))
    if draw.indenter == "single":
        return Scene(Indenter.single(draw.radius_mm), pose)
    if draw.indenter == "dual":
        apart = float(rng.choice(draw.distances_mm)) if distance is None else distance
        return Scene(Indenter.dual(apart, draw.radius_mm), pose)
    if draw.indenter == "scattered":
        return _scattered(draw, workspace, rng)
    if draw.indenter == "tips":
        return Scene(Indenter(draw.radius_mm, draw.offsets_mm, draw.name), pose)
    a, b, c = (float(h) for h in rng.choice(draw.heights_mm, 3))
    return Scene(Indenter.triple((a, b, c), draw.side_mm or 0.0, draw.radius_mm), pose)


def _scattered(draw: Draw, workspace: Workspace, rng: np.random.Generator) -> Scene:
    """Return tips anywhere in the workspace, ``apart_mm`` or more apart, each with its own depth.

    Places are drawn one after another, each again until it is far enough from those before it. If
    whole sets were drawn, one in thousands with five tips would fit.

    Raises:
        UserError: ``PATIENCE`` places do not make a set of tips that far apart.
    """
    half = workspace.half_width_mm
    places: list[tuple[float, float]] = []
    for _ in range(PATIENCE):
        x, y = rng.uniform(-half, half, 2).tolist()
        if all(math.dist((x, y), place) >= (draw.apart_mm or 0.0) for place in places):
            places.append((x, y))
        elif rng.random() < RESTART:
            places = []  # the first tips may leave no room for the last one
        if len(places) == draw.tips:
            break
    else:
        raise UserError(
            f"draw {draw.name!r}: {draw.tips} tips {draw.apart_mm} mm apart hardly fit the "
            "workspace; make the distance smaller."
        )
    depths = rng.uniform(workspace.depth_min_mm, workspace.depth_max_mm, draw.tips)
    return scene_of_contacts(np.array(places), depths, draw.radius_mm, workspace.dome_radius_mm)


def draw_plates(spec: Protocol, plates: Plates) -> SceneSet:
    """Return all training presses of a plate: the same for equal keys and data seed everywhere."""
    seed = np.random.SeedSequence(spec.data_seed, spawn_key=(plates.stream,))
    rng = np.random.default_rng(seed)
    space = spec.workspace
    depth = rng.uniform(space.depth_min_mm, space.depth_max_mm, plates.count)
    tilt = rng.uniform(-plates.tilt_deg, plates.tilt_deg, plates.count)
    return SceneSet(
        tuple(
            Scene(Indenter.plate(), Pose(yaw=plates.yaw_deg, tilt=t, depth=d))
            for d, t in zip(depth.tolist(), tilt.tolist(), strict=True)
        ),
        0,
    )


def draw_shots(spec: Protocol, pool: int) -> tuple[int, ...]:
    """Return the numbers of the labelled frames among ``pool`` frames.

    A model that is given k labelled frames gets the first k. The result is empty where the protocol
    tests no other sensor than the trained one.
    """
    if spec.transfer is None:
        return ()
    seed = np.random.SeedSequence(spec.data_seed, spawn_key=(spec.transfer.stream,))
    order = np.random.default_rng(seed).permutation(pool)
    return tuple(order[: max(spec.transfer.shots)].tolist())


def draw_labelled(spec: Protocol, count: int) -> SceneSet:
    """Return ``count`` single presses of the tested sensor that a model is shown with labels.

    They lie in the ranges of the presses that the split divides, but come from a random stream of
    their own. The first k presses are the same for every ``count``.

    Raises:
        UserError: The split divides presses that are not single.
    """
    assert spec.split is not None  # noqa: S101 - a protocol that draws divides its draws
    singles = spec.draw(spec.split.draw)
    if singles.indenter != "single":
        raise UserError(
            f"protocol {spec.id!r} divides presses of indenter {singles.indenter!r}, so it has no "
            "ranges of single presses to show; leave --test shots out."
        )
    shown = singles.model_copy(update={"count": count, "stream": LABELLED_STREAM})
    return _drawn(shown, spec.workspace, spec.data_seed)


def in_range(spec: Protocol, workspace: contacts.Workspace) -> Protocol:
    """Return the protocol with another range; heatmap grid and gate grow with it.

    Depths that are not known, NaN, leave the protocol's range of depths.
    """
    published = spec.workspace
    grown = workspace.half_width_mm / published.half_width_mm
    grid = spec.grid.model_copy(update={"pitch_mm": spec.grid.pitch_mm * grown})
    known = {name: value for name, value in asdict(workspace).items() if value == value}
    space = published.model_copy(update=known)
    test = spec.test.model_copy(update={"gate_mm": spec.test.gate_mm * grown})
    return spec.model_copy(update={"workspace": space, "grid": grid, "test": test})


class SensorShape(StructuralType):
    """Surface of a sensor, see the attributes of ``tactibench.Sensor``."""

    @property
    def dome_radius_mm(self) -> float | None:
        """Radius of the dome; None: that of the protocol."""

    @property
    def deepest_mm(self) -> float:
        """Deepest press that the sensor stands."""

    @property
    def workspace(self) -> contacts.Workspace | None:
        """Range in place of the protocol's; None: the protocol's."""


def pressable(spec: Protocol, sensor: SensorShape) -> Protocol:
    """Return the protocol on the sensor's own surface, as deep as the sensor can be pressed.

    A sensor with a range of its own is pressed there, and the heatmap grid grows with it. A sensor
    that states neither range nor shape leaves the protocol as it is.

    Raises:
        UserError: The sensor cannot be pressed deeper than the protocol's shallowest tip.
    """
    if sensor.workspace is not None:
        return in_range(spec, sensor.workspace)
    workspace = spec.workspace
    deepest = min(workspace.depth_max_mm, sensor.deepest_mm)
    if not deepest > workspace.depth_min_mm:
        raise UserError(
            f"the sensor can be pressed {sensor.deepest_mm:g} mm deep, but protocol {spec.id!r} "
            f"presses {workspace.depth_min_mm:g} mm and more; take another sensor."
        )
    radius = sensor.dome_radius_mm
    if radius is None:
        radius = workspace.dome_radius_mm
    shape = {"dome_radius_mm": radius, "depth_max_mm": deepest}
    return spec.model_copy(update={"workspace": workspace.model_copy(update=shape)})


SPLIT_STREAM = 0
"""Spawn key of the data seed that permutes presses; draws use 1 and above."""
FIT, VALIDATION, TEST, WHOLE = 0, 1, 2, 3
"""Parts of a draw; the frames of each have noise of their own."""
CHUNK = 250
"""Presses that a sensor makes with one seed: about a fifth of a second of work is lost by an
interruption. Another number would make other frames."""


class PressSplit(NamedTuple):
    """Indices of the presses that train, validate and test."""

    fit: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]


def split_presses(count: int, split: Split, data_seed: int) -> PressSplit:
    """Divide ``count`` drawn presses by a seeded permutation."""
    order = permutation(count, data_seed)
    return _parts(order, split.test, split.validation)


def split_recorded(
    names: Sequence[str], spec: Recorded, data_seed: int, published: Sequence[str] | None
) -> PressSplit:
    """Divide recorded presses.

    Args:
        names: Name of every press.
        spec: Shares of the parts.
        data_seed: Seed of the permutation.
        published: Names of published test frames, which are taken as they are; None: there are
            none.

    Raises:
        UserError: A part would have no press.
    """
    if published is not None:
        index = {name: i for i, name in enumerate(names)}
        test = [index[name] for name in published]
        left = sorted(set(range(len(names))) - set(test))
        order = np.array(left, dtype=np.int64)[permutation(len(left), data_seed)]
        parts = _parts(order, 0, round(spec.validation_share * len(left)))
        return _trainable(PressSplit(parts.fit, parts.validation, tuple(sorted(test))), len(names))
    test_count = round(spec.test_share * len(names))
    validation = round(spec.validation_share * (len(names) - test_count))
    order = permutation(len(names), data_seed)
    return _trainable(_parts(order, test_count, validation), len(names))


def _trainable(parts: PressSplit, count: int) -> PressSplit:
    if not (parts.fit and parts.validation and parts.test):
        raise UserError(
            f"the data folder holds {count:,} presses, of which {len(parts.fit):,} would train, "
            f"{len(parts.validation):,} validate and {len(parts.test):,} test a model; each part "
            "needs at least one: record more presses."
        )
    return parts


def permutation(count: int, data_seed: int) -> npt.NDArray[np.int64]:
    """Return the seeded order, (count,), in which presses are divided."""
    seed = np.random.SeedSequence(data_seed, spawn_key=(SPLIT_STREAM,))
    return np.random.default_rng(seed).permutation(count)


def _parts(order: npt.NDArray[np.int64], test: int, validation: int) -> PressSplit:
    return PressSplit(
        fit=tuple(sorted(order[test + validation :].tolist())),
        validation=tuple(sorted(order[test : test + validation].tolist())),
        test=tuple(sorted(order[:test].tolist())),
    )
