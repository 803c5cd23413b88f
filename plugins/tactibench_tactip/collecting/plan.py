"""The presses of a collection: ordered by what has to be mounted, and checked before any motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tactibench import Indenter, Scene, UserError
from tactibench.lab import Press, plan_presses, press_rows
from tactibench_tactip.geometry.envelope import outside
from tactibench_tactip.geometry.frames import matrix, pose_of, turned_by
from tactibench_tactip.geometry.press import PressGeometry
from tactibench_tactip.motion.press_moves import seconds, way
from tactibench_tactip.settings import IndenterKeys, Settings

SAME_MM = 1e-6
CAPTURE_S = 0.3
"""Of the frames of a press and of the look after it."""
TURNLESS_DEG = 0.05


@dataclass(frozen=True)
class Plan:
    """presses: in the order in which they are made. what: protocol or file. splits: as of the
    protocol, name -> part -> ids."""

    what: str
    presses: tuple[Press, ...]
    splits: dict[str, dict[str, list[int]]]

    def __len__(self) -> int:
        return len(self.presses)

    def rows(self) -> list[dict[str, Any]]:
        """The rows of plan.jsonl."""
        return press_rows(self.presses)

    def mounts(self) -> list[tuple[Indenter, tuple[Press, ...]]]:
        """What has to be mounted in turn, and what is pressed with it."""
        found: dict[Indenter, list[Press]] = {}
        for press in self.presses:
            found.setdefault(press.scene.indenter, []).append(press)
        return [(indenter, tuple(presses)) for indenter, presses in found.items()]


class _Dome:
    """What a protocol has to know of the surface."""

    def __init__(self, settings: Settings) -> None:
        self.dome_radius_mm = settings.sensor.dome_radius_mm
        self.deepest_mm = settings.sensor.deepest_mm


def plan_of(
    what: str,
    settings: Settings,
    *,
    draws: Sequence[str] = (),
    count: int | None = None,
    seed: int | None = None,
) -> Plan:
    """The presses of a protocol or of a plan.jsonl, those of one indenter together.

    draws: of the protocol, all by default. count: at most, of every indenter of every draw, evenly
    spread. Raises UserError.
    """
    pressing = plan_presses(what, _Dome(settings), seed=seed)
    presses = list(pressing)
    known = list(dict.fromkeys(press.draw for press in presses))
    for name in draws:
        if name not in known:
            raise UserError(
                f"{what} has no draw {name!r}; it has {', '.join(filter(None, known)) or 'none'}."
            )
    if draws:
        presses = [press for press in presses if press.draw in draws]
    presses = _thinned(presses, count)
    order = list(dict.fromkeys(press.scene.indenter for press in presses))
    ordered = sorted(presses, key=lambda press: order.index(press.scene.indenter))
    kept = {press.id for press in ordered}
    splits = {
        name: {part: [i for i in ids if i in kept] for part, ids in parts.items()}
        for name, parts in pressing.splits.items()
    }
    return Plan(what, tuple(ordered), splits)


def _thinned(presses: list[Press], count: int | None) -> list[Press]:
    groups: dict[tuple[str, Indenter], list[Press]] = {}
    for press in presses:
        groups.setdefault((press.draw, press.scene.indenter), []).append(press)
    kept: set[int] = set()
    for group in groups.values():
        few = len(group) if count is None else min(count, len(group))
        kept.update(group[(2 * k + 1) * len(group) // (2 * few)].id for k in range(few))
    return [press for press in presses if press.id in kept]


def eased(scene: Scene) -> Scene:
    """The same contacts with the smallest turn of the tool: one tip needs none, two of one height
    look the same after half a turn, three after a third."""
    indenter, pose = scene.indenter, scene.pose
    heights = {offset[2] for offset in indenter.offsets}
    tips = len(indenter.offsets)
    if indenter.is_plate:
        return scene
    if tips == 1:
        return replace(scene, pose=replace(pose, yaw=0.0))
    period = 360.0 / tips if tips in (2, 3) and len(heights) == 1 else 360.0
    return replace(scene, pose=replace(pose, yaw=pose.yaw - period * round(pose.yaw / period)))


def check(plan: Plan, settings: Settings, geometry: PressGeometry, *, turns: bool) -> None:
    """Raises UserError for the first press that may not be made, and how many there are of them.

    turns: whether the robot can turn the tool.
    """
    bad: list[tuple[Press, str]] = []
    for press in plan.presses:
        reason = _wrong(eased(press.scene), settings, geometry, turns)
        if reason:
            bad.append((press, reason))
    if bad:
        press, reason = bad[0]
        raise UserError(
            f"{len(bad):,} of {len(plan):,} presses of {plan.what} are refused before any motion: "
            f"{press.name} needs {reason}."
        )


def check_scenes(
    what: str, scenes: Iterable[Scene], settings: Settings, geometry: PressGeometry, *, turns: bool
) -> None:
    """The same for presses of no protocol."""
    presses = tuple(Press(k, f"press {k + 1}", scene) for k, scene in enumerate(scenes))
    check(Plan(what, presses, {}), settings, geometry, turns=turns)


def _wrong(scene: Scene, settings: Settings, geometry: PressGeometry, turns: bool) -> str:
    deepest = settings.sensor.deepest_mm
    if scene.pose.depth > deepest:
        return f"a depth of {scene.pose.depth:.2f} mm, sensor.deepest_mm allows {deepest:g} mm"
    trip = way(scene, geometry, settings)
    for pose in trip.poses:
        reason = outside(settings.envelope, pose)
        if reason:
            return reason
    turn = turned_by(trip.down, pose_of(matrix((0.0, 0.0, 0.0, 0.0, 0.0, 0.0))))
    if not turns and turn > TURNLESS_DEG:
        return (
            f"a turn of {turn:.1f} deg, which driver {settings.robot.driver!r} cannot make; choose "
            "draws of single presses with --draw"
        )
    return ""


def fits(mounted: IndenterKeys, indenter: Indenter) -> bool:
    """Whether what is mounted is what a press needs."""
    have = mounted.indenter()
    if have.is_plate or indenter.is_plate:
        return have.is_plate and indenter.is_plate
    if len(have.offsets) != len(indenter.offsets):
        return False
    pairs = zip(have.offsets, indenter.offsets, strict=True)
    tips = [abs(a - b) for one, other in pairs for a, b in zip(one, other, strict=True)]
    return max(abs(have.radius - indenter.radius), *tips) < SAME_MM


def keys_of(indenter: Indenter) -> IndenterKeys | None:
    """What [indenter] has to say for it to be mounted; None: no holder of this program's."""
    offsets = indenter.offsets
    if indenter.is_plate:
        found = IndenterKeys(kind="plate")
    elif len(offsets) == 1:
        found = IndenterKeys(radius_mm=indenter.radius)
    elif len(offsets) == 2:
        apart = offsets[1][0] - offsets[0][0]
        if apart <= 0:
            return None
        found = IndenterKeys(kind="dual", radius_mm=indenter.radius, distance_mm=apart)
    elif len(offsets) == 3:
        side = abs(offsets[1][0] - offsets[2][0])
        if side <= 0 or min(offset[2] for offset in offsets) < 0:
            return None
        heights = (offsets[0][2], offsets[1][2], offsets[2][2])
        found = IndenterKeys(
            kind="triple", radius_mm=indenter.radius, side_mm=side, heights_mm=heights
        )
    else:
        return None
    return found if fits(found, indenter) else None


def words(indenter: Indenter) -> str:
    """What has to be mounted, for a person."""
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


def estimate_s(presses: Iterable[Press], settings: Settings) -> float:
    """What presses take, searches for first touch included, device seconds."""
    geometry = PressGeometry(settings.frames, settings.sensor.dome_radius_mm)
    count, total = 0, 0.0
    for press in presses:
        count += 1
        total += seconds(way(eased(press.scene), geometry, settings), settings) + CAPTURE_S
    searches = 1 + count // settings.contact.every_presses
    return total + 60.0 * searches


def draws_of(plan: Plan) -> dict[str, int]:
    """Draw -> how many presses."""
    return dict(Counter(press.draw or "presses" for press in plan.presses))
