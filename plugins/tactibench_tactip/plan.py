"""The presses of a collection: ordered by what has to be mounted, checked before any motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tactibench import Indenter, Scene, UserError
from tactibench.lab import Press, plan_presses, press_rows, spread
from tactibench_tactip.geometry import (
    PressGeometry,
    PressPath,
    angle_between,
    envelope_violation,
    geometry_of,
)
from tactibench_tactip.motion import move_seconds, steps_in_touch
from tactibench_tactip.settings import Pose6, Settings

SAME_MM = 1e-6
"""Difference within which radii and tips of two indenters are the same: the numbers come from
files, not from measurements."""
SIDEWAYS_MM = 7.0
"""Distance from a press to the next one."""
LOOK_S = 0.1
"""Time until it is seen that a step in touch has ended."""
SEARCH_S = 60.0
"""Time of a search for first touch."""
TURN_DEG = 0.05
"""Turn up to which a stage, which cannot turn the tool, is considered to reach a pose."""


@dataclass(frozen=True)
class CollectionPlan:
    """The presses of a collection.

    Attributes:
        source: Protocol or file of the presses.
        presses: The presses in the order in which they are made.
        splits: Splits of the protocol: name -> subset -> ids.
    """

    source: str
    presses: tuple[Press, ...]
    splits: dict[str, dict[str, list[int]]]

    def __len__(self) -> int:
        return len(self.presses)

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of plan.jsonl."""
        return press_rows(self.presses)


def plan_of(
    source: str,
    settings: Settings,
    *,
    draws: Sequence[str] = (),
    count: int | None = None,
    seed: int | None = None,
) -> CollectionPlan:
    """Return the presses of a protocol or of a plan.jsonl, those of one indenter together.

    Args:
        source: Name of a protocol, or path of a plan.jsonl.
        settings: Configuration of the setup, whose sensor limits the depth.
        draws: Draws of the protocol to take, all by default; NAME=N takes N presses of every
            indenter of that draw.
        count: Most presses of every indenter of every other draw, evenly spread.
        seed: Seed of other presses than the protocol's.

    Raises:
        UserError: There is no such protocol, file or draw, or a draw is not NAME or NAME=N.
    """
    chosen = dict(map(_draw_and_count, draws))
    press_plan = plan_presses(source, settings.sensor, seed=seed)
    presses = list(press_plan)
    names = list(dict.fromkeys(press.draw for press in presses))
    for name in chosen:
        if name not in names:
            raise UserError(
                f"{source} has no draw {name!r}; it has {', '.join(filter(None, names)) or 'none'}."
            )
    if chosen:
        presses = [press for press in presses if press.draw in chosen]
    presses = _limit_presses(presses, {name: chosen.get(name) or count for name in names})
    ordered = [press for group in by_indenter(presses).values() for press in group]
    ids = {press.id for press in ordered}
    splits = {
        name: {part: [i for i in numbers if i in ids] for part, numbers in parts.items()}
        for name, parts in press_plan.splits.items()
    }
    return CollectionPlan(source, tuple(ordered), splits)


def _draw_and_count(text: str) -> tuple[str, int | None]:
    """Return name and count of a text NAME or NAME=N."""
    name, equals, number = text.partition("=")
    if equals and not (number.isdecimal() and int(number) > 0):
        raise UserError(f"--draw {text} is not understood; write {name}=N, N from 1 on.")
    return name, int(number) if equals else None


def _limit_presses(presses: list[Press], counts: Mapping[str, int | None]) -> list[Press]:
    """Return at most counts[draw] presses of every indenter of every draw, in the same order."""
    groups: dict[tuple[str, Indenter], list[Press]] = {}
    for press in presses:
        groups.setdefault((press.draw, press.scene.indenter), []).append(press)
    ids: set[int] = set()
    for (draw, _), group in groups.items():
        ids |= {press.id for press in spread(group, counts.get(draw))}
    return [press for press in presses if press.id in ids]


def by_indenter(presses: Iterable[Press]) -> dict[Indenter, list[Press]]:
    """Return presses grouped by the indenter that they need, in the order of its first press."""
    groups: dict[Indenter, list[Press]] = {}
    for press in presses:
        groups.setdefault(press.scene.indenter, []).append(press)
    return groups


def with_smallest_turn(scene: Scene) -> Scene:
    """Return the same contacts with the smallest turn of the tool.

    One tip needs no turn; two tips of one height look the same after half a turn, three after a
    third.
    """
    indenter, pose = scene.indenter, scene.pose
    heights = {offset[2] for offset in indenter.offsets}
    tips = len(indenter.offsets)
    if indenter.is_plate:
        return scene
    if tips == 1:
        return replace(scene, pose=replace(pose, yaw=0.0))
    period = 360.0 / tips if tips in (2, 3) and len(heights) == 1 else 360.0
    return replace(scene, pose=replace(pose, yaw=pose.yaw - period * round(pose.yaw / period)))


def check_plan(
    plan: CollectionPlan, settings: Settings, geometry: PressGeometry, *, turns: bool
) -> None:
    """Raise UserError where presses may not be made; it names the first and their number.

    Args:
        plan: The presses.
        settings: Configuration of the setup.
        geometry: Geometry of presses, with its first touch.
        turns: Whether the robot can turn the tool.
    """
    refused: list[tuple[Press, str]] = []
    for press in plan.presses:
        reason = _refusal(with_smallest_turn(press.scene), settings, geometry, turns)
        if reason:
            refused.append((press, reason))
    if refused:
        press, reason = refused[0]
        raise UserError(
            f"{len(refused):,} of {len(plan):,} presses of {plan.source} are refused before any "
            f"motion: {press.name} needs {reason}."
        )


def _refusal(scene: Scene, settings: Settings, geometry: PressGeometry, turns: bool) -> str:
    deepest = settings.sensor.deepest_mm
    if scene.pose.depth > deepest:
        return f"a depth of {scene.pose.depth:.2f} mm, sensor.deepest_mm allows {deepest:g} mm"
    path = geometry.path(scene)
    for pose in (path.above, path.near, path.down):
        violation = envelope_violation(settings.envelope, pose)
        if violation:
            return violation
    turn = angle_between(path.down, (0.0,) * 6)
    if not turns and turn > TURN_DEG:
        return (
            f"a turn of {turn:.1f} deg, which driver {settings.robot.driver!r} cannot make; choose "
            "draws of single presses with --draw"
        )
    return ""


def estimate_seconds(presses: Iterable[Press], settings: Settings) -> float:
    """Return the time that presses take, s, searches for first touch included."""
    geometry = geometry_of(settings)
    paths = [geometry.path(with_smallest_turn(press.scene)) for press in presses]
    searches, camera = 1 + len(paths) // settings.contact.every_presses, settings.camera
    # The frames of a press, and one after it; both wait until no frame is from before.
    frames_s = 2.0 * camera.lag_s + (camera.burst + 3.0) / camera.fps
    return sum(path_seconds(path, settings) + frames_s for path in paths) + SEARCH_S * searches


def path_seconds(path: PressPath, settings: Settings) -> float:
    """Return the time that a press takes, s, without its frames."""
    robot = settings.robot
    a = robot.acceleration_mm_s2
    x, y, z, *turn = path.above
    before: Pose6 = (x + SIDEWAYS_MM, y, z, *turn)  # type: ignore[assignment]
    steps = steps_in_touch(path.near, path.down, robot.press_mm_s, robot)
    return (
        move_seconds(before, path.above, robot.approach_mm_s, a)
        + move_seconds(path.above, path.near, robot.approach_mm_s, a)
        + sum(move_seconds(*step, robot.press_mm_s, a) for step in pairwise((path.near, *steps)))
        + LOOK_S * (len(steps) - 1)
        + settings.timing.settle_s
        + move_seconds(path.down, path.above, robot.retract_mm_s, a)
    )


def is_mounted(mounted: Indenter, indenter: Indenter) -> bool:
    """Return whether the mounted indenter is the one that a press needs."""
    if mounted.is_plate or indenter.is_plate:
        return mounted.is_plate and indenter.is_plate
    tips, others = ([i.radius, *np.ravel(i.offsets)] for i in (mounted, indenter))
    return len(tips) == len(others) and np.allclose(tips, others, rtol=0.0, atol=SAME_MM)


def describe_indenter(indenter: Indenter) -> str:
    """Return a description of an indenter, for the person who mounts it."""
    offsets = indenter.offsets
    if indenter.is_plate:
        return "the plate"
    tips = f"of radius {indenter.radius:g} mm"
    if len(offsets) == 1:
        return f"one tip {tips}"
    if len(offsets) == 2:
        return f"two tips {tips}, {offsets[1][0] - offsets[0][0]:g} mm apart"
    heights = ", ".join(f"{offset[2]:g}" for offset in offsets)
    return f"{len(offsets)} tips {tips}, inserts {heights} mm"
