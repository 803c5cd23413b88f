"""The protocols that a recording can serve, and the reasons why it cannot serve others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tactibench.contacts import Scene
from tactibench.datasets import ImportOptions, Recording, own_workspace
from tactibench.errors import UserError
from tactibench.frames.matching import describe_draw, describe_range, match
from tactibench.protocols import Protocol, in_range, load_protocol, protocol_files

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
    labelled = [
        (scene, press)
        for scene, press in zip(recording.scenes, recording.presses, strict=True)
        if scene
    ]
    scenes, presses = [scene for scene, _ in labelled], [press for _, press in labelled]
    workspace = own_workspace(scenes, recording.dome_radius_mm)
    answers = []
    for name in sorted(protocol_files()):
        protocol = load_protocol(name).spec
        if protocol.recorded is not None:
            served, reason = _plates(recording, scenes)
        else:
            pressed = protocol if workspace is None else in_range(protocol, workspace)
            served, reason = _tips(pressed, scenes, presses)
        if served and contradictions:
            served, reason = False, f"its frames contradict the labels: {contradictions[0]}"
        answers.append(Service(name, protocol.title, served, reason))
    return answers


def _plates(recording: Recording, scenes: Sequence[Scene]) -> tuple[bool, str]:
    """Return whether a recording serves a protocol of plate presses, and the reason.

    Such a protocol takes plate presses as they were recorded.
    """
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
        space = protocol.workspace
        draws = "; ".join(
            f"{name}: {describe_draw(protocol.draw(name))}" for name in matched.lacking
        )
        return False, (
            f"lacks {draws}, x and y within {space.half_width_mm:g} mm, "
            f"{space.depth_min_mm:g} to {space.depth_max_mm:g} mm deep (there: {_kinds(scenes)}, "
            f"{describe_range(scenes)})"
        )
    roles = (matched.fit, matched.validation, matched.test)
    counts = [sum(map(len, rows.values())) for rows in roles]
    text = f"{counts[0]:,} frames train, {counts[1]:,} validate, {counts[2]:,} test"
    return True, text + (f"; {matched.left_out:,} outside of it" if matched.left_out else "")


def _kinds(scenes: Sequence[Scene]) -> str:
    kinds = Counter(scene.indenter.name for scene in scenes)
    return ", ".join(f"{count:,} {name}" for name, count in sorted(kinds.items()))
