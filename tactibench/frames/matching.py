"""Recorded presses matched to the draws of a protocol, and the protocols that they can serve.

A recorded press belongs to a draw when the protocol could have drawn it. The presses of one kind of
indenter are divided by press: of those of the split's draw the same shares train, validate and test
as in the protocol, and other tested draws of that kind are taken from the tested share. A kind that
is both trained on and tested otherwise is halved. A recording with a split of its own is divided by
its own split instead.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactibench.contacts import Scene
from tactibench.errors import UserError
from tactibench.protocols import (
    SAME_MM,
    Draw,
    Protocol,
    Split,
    Workspace,
    fits,
    in_range,
    load_protocol,
    permutation,
    protocol_files,
)

if TYPE_CHECKING:
    from tactibench.datasets import Recording

Rows = dict[str, list[int]]
"""Draw -> rows of the recording."""


@dataclass(frozen=True)
class Match:
    """Rows of a recording by role and draw.

    Attributes:
        fit: Rows that train.
        validation: Rows that validate.
        test: Rows that test.
        lacking: Draws that the protocol needs and for which nothing was recorded.
        left_out: Number of rows that belong to no draw.
    """

    fit: Rows
    validation: Rows
    test: Rows
    lacking: tuple[str, ...]
    left_out: int


def could_be_drawn(scene: Scene, draw: Draw, workspace: Workspace) -> bool:
    """Return whether the protocol could have drawn this press."""
    tips = np.array(scene.indenter.offsets)
    count = draw.tips
    if len(tips) != count or abs(scene.indenter.radius - draw.radius_mm) > SAME_MM:
        return False
    if scene.pose.tilt or not fits(scene, workspace):
        return False
    if draw.indenter == "tips":
        return bool(np.abs(tips - np.array(draw.offsets_mm)).max() < SAME_MM)
    pairs = np.triu_indices(count, 1)
    distances = np.linalg.norm(tips[:, None, :2] - tips[None, :, :2], axis=2)[pairs]
    if draw.indenter == "scattered":
        return bool((distances > (draw.apart_mm or 0.0) - SAME_MM).all())
    if draw.indenter == "dual":
        flat = abs(float(tips[0, 2] - tips[1, 2])) < SAME_MM
        return flat and _is_among(float(distances[0]), draw.distances_mm)
    if not all(_is_among(float(distance), [draw.side_mm or 0.0]) for distance in distances):
        return False
    return draw.indenter == "single" or all(
        _is_among(float(height), draw.heights_mm) for height in tips[:, 2]
    )


def match(
    protocol: Protocol,
    split: Split,
    regime: str,
    scenes: Sequence[Scene],
    presses: Sequence[str],
    parts: Sequence[str] | None = None,
) -> Match:
    """Divide recorded presses between what a protocol trains on and tests.

    Args:
        protocol: Protocol whose draws are looked for, on the recorded sensor's surface.
        split: Split of the protocol.
        regime: Name of the training regime.
        scenes: Scene of every row.
        presses: Press that every row belongs to.
        parts: Part of every row in the recording's own split; None: it has no split.
    """
    extra, tested = protocol.regimes[regime], protocol.test.sets
    needed = list(dict.fromkeys([split.draw, *extra, *tested]))
    kinds = {name: protocol.draw(name).indenter for name in needed}
    pools = {
        name: [
            row
            for row, scene in enumerate(scenes)
            if could_be_drawn(scene, protocol.draw(name), protocol.workspace)
        ]
        for name in needed
    }
    names = sorted(set(presses))
    places = permutation(len(names), protocol.data_seed)
    order = dict(zip(names, places.tolist(), strict=True))

    def share(name: str, low: float, high: float, part: str) -> list[int]:
        """Return the rows whose press lies in a share of the pool's presses, or in a part.

        Args:
            name: Name of the draw.
            low: Beginning of the share, of all presses.
            high: End of the share, of all presses.
            part: Part of the recording's own split, where it has one.
        """
        if parts is not None:
            return [row for row in pools[name] if parts[row] == part]
        pool_presses = sorted({presses[row] for row in pools[name]}, key=order.__getitem__)
        first, last = (_edge(edge, len(pool_presses)) for edge in (low, high))
        chosen = set(pool_presses[first:last])
        return [row for row in pools[name] if presses[row] in chosen]

    total = protocol.draw(split.draw).count or 1
    end, start = split.test / total, (split.test + split.validation) / total
    fit = {split.draw: share(split.draw, start, 1.0, "train")}
    validation = {split.draw: share(split.draw, end, start, "validation")}
    test = {}
    for name in tested:
        also_trained = any(kinds[other] == kinds[name] for other in extra)
        high = end if kinds[name] == kinds[split.draw] else 0.5 if also_trained else 1.0
        test[name] = share(name, 0.0, high, "test")
    for name in extra:
        also_tested = any(kinds[other] == kinds[name] for other in tested)
        fit[name] = share(name, 0.5 if also_tested else 0.0, 1.0, "train")
    test_presses = {presses[row] for rows in test.values() for row in rows}
    for name in extra:  # pools of one kind need not be alike
        fit[name] = [row for row in fit[name] if presses[row] not in test_presses]
    lacking = [name for rows in (fit, validation, test) for name in rows if not rows[name]]
    used = {row for name in needed for row in pools[name]}
    return Match(fit, validation, test, tuple(dict.fromkeys(lacking)), len(scenes) - len(used))


def describe_range(scenes: Sequence[Scene]) -> str:
    """Return the range of presses in words, such as "x -3.1 to 2.9 mm, y 0 to 5 mm".

    A depth that is not known is left out.
    """
    ranges = []
    for name in ("x", "y", "depth"):
        values = [getattr(scene.pose, name) for scene in scenes]
        known = not any(map(math.isnan, values))
        ranges.append(f"{name} {min(values):.3g} to {max(values):.3g} mm" if known else "")
    return ", ".join(filter(None, ranges))


def describe_draw(draw: Draw) -> str:
    """Return the indenter of a draw in words: "two tips of radius 3 mm 6.5 to 12 mm apart"."""
    tips = {"single": "one spherical tip", "dual": "two tips", "triple": "three tips"}
    kind = tips.get(draw.indenter, f"{draw.tips} tips on the holder {draw.name!r}")
    text = f"{kind} of radius {draw.radius_mm:g} mm"
    if draw.distances_mm:
        text += f" {min(draw.distances_mm):g} to {max(draw.distances_mm):g} mm apart"
    if draw.side_mm is not None and not math.isclose(draw.side_mm, 0):
        text += f" {draw.side_mm:g} mm apart"
    return text


def describe_lacking(protocol: Protocol, names: Sequence[str]) -> str:
    """Return the draws of a protocol for which nothing was recorded, in words."""
    space = protocol.workspace
    draws = "; ".join(f"{name}: {describe_draw(protocol.draw(name))}" for name in names)
    return (
        f"{draws}; all with x and y within {space.half_width_mm:g} mm, {space.depth_min_mm:g} to "
        f"{space.depth_max_mm:g} mm deep"
    )


def _is_among(value: float, allowed: Sequence[float]) -> bool:
    return any(abs(value - other) < SAME_MM for other in allowed)


def _edge(share: float, count: int) -> int:
    """Return the number of presses before the edge at a share of ``count`` presses.

    An edge inside has at least one press on either side, where there are so many.
    """
    inside = 0 < share < 1
    return min(max(round(share * count), int(inside)), count)


SURFACE_HINT = "--param sensor.depth=COLUMN --param sensor.tilt=COLUMN name the labels"


@dataclass(frozen=True)
class Service:
    """The answer to whether a recording can serve a protocol.

    Attributes:
        protocol: Id of the protocol.
        title: Title of the protocol.
        served: Whether the recording can serve it.
        reason: The frames that it has for the protocol, or what it lacks.
    """

    protocol: str
    title: str
    served: bool
    reason: str


def served_protocols(recording: Recording, contradictions: Sequence[str] = ()) -> list[Service]:
    """Return, for every protocol that ships, whether ``run --data`` can take the recording.

    Args:
        recording: The recording.
        contradictions: Sentences on how its frames contradict the labels; where there are some, no
            run takes the recording.
    """
    from tactibench.datasets import own_workspace

    labelled = [
        (scene, press)
        for scene, press in zip(recording.scenes, recording.presses, strict=True)
        if scene
    ]
    scenes, presses = [scene for scene, _ in labelled], [press for _, press in labelled]
    workspace = own_workspace(scenes, recording.dome_radius_mm)
    services = []
    for name in sorted(protocol_files()):
        protocol = load_protocol(name).spec
        if protocol.sites is not None or recording.sites:
            served, reason = _places(protocol, recording)
        elif protocol.recorded is not None:
            served, reason = _plates(recording, scenes)
        else:
            pressed = protocol if workspace is None else in_range(protocol, workspace)
            served, reason = _tips(pressed, scenes, presses)
        if served and contradictions:
            served, reason = False, f"its frames contradict the labels: {contradictions[0]}"
        services.append(Service(name, protocol.title, served, reason))
    return services


def _places(protocol: Protocol, recording: Recording) -> tuple[bool, str]:
    """Return whether a recording serves a protocol where either is about named places, and why."""
    if not recording.sites:
        return False, "named places are not known: import with --param sites=COLUMNS"
    places = f"{len(recording):,} trials of {len(recording.sites)} named places"
    if protocol.sites is None:
        return False, f"{places}, which have no coordinates"
    return True, f"{places}, {max(1, len(set(recording.sessions)))} sessions"


def _plates(recording: Recording, scenes: Sequence[Scene]) -> tuple[bool, str]:
    """Return whether a recording serves a protocol of plate presses, and the reason.

    Such a protocol takes plate presses as they were recorded.
    """
    from tactibench.datasets import ImportOptions

    plates = [scene for scene in scenes if scene.indenter.is_plate]
    if plates:
        return True, f"{len(plates):,} frames of a plate with depth and tilt"
    if scenes:
        return False, f"its frames are of {_kinds(scenes)}, not of a plate"
    try:
        _, roles = recording.plate_scenes(ImportOptions())
    except UserError as error:
        return False, f"no labels of a plate ({str(error).rstrip('.')}); {SURFACE_HINT}"
    return True, (
        f"depth from {roles['depth']}, tilt from {roles['tilt']}, if a plate pressed; "
        "`tactibench data fit` finds its offset and pivot"
    )


def _tips(protocol: Protocol, scenes: Sequence[Scene], presses: Sequence[str]) -> tuple[bool, str]:
    """Return whether presses serve a protocol of spherical tips, and the reason.

    Such a protocol needs presses that it could have drawn.
    """
    if not scenes:
        return False, (
            "only labels are known: import with --param indenter=single and the columns of x, y "
            "and depth, if a spherical tip pressed"
        )
    if protocol.families:
        return False, "its hard cases need a sensor that presses them"
    assert protocol.split is not None  # noqa: S101 - a protocol that draws divides its draws
    regime = next(iter(protocol.regimes))
    matched = match(protocol, protocol.split, regime, scenes, presses)
    if matched.lacking:
        lacks = describe_lacking(protocol, matched.lacking)
        return False, f"lacks {lacks} (there: {_kinds(scenes)}, {describe_range(scenes)})"
    roles = (matched.fit, matched.validation, matched.test)
    counts = [sum(map(len, rows.values())) for rows in roles]
    text = f"{counts[0]:,} frames train, {counts[1]:,} validate, {counts[2]:,} test"
    return True, text + (f"; {matched.left_out:,} outside of it" if matched.left_out else "")


def _kinds(scenes: Sequence[Scene]) -> str:
    kinds = Counter(scene.indenter.name for scene in scenes)
    return ", ".join(f"{count:,} {name}" for name, count in sorted(kinds.items()))
