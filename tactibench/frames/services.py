"""Which protocols a recording can serve, and why not the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tactibench.contacts import Scene
from tactibench.datasets import ImportOptions, Recording, plate_scenes
from tactibench.errors import UserError
from tactibench.frames.matching import match, needs
from tactibench.protocols.loader import load_protocol, protocol_files
from tactibench.protocols.schema import Protocol

SURFACE_HINT = "--param sensor.depth=COLUMN --param sensor.tilt=COLUMN name the labels"


@dataclass(frozen=True)
class Service:
    """reason: what is there, or what is lacking."""

    protocol: str
    title: str
    served: bool
    reason: str


def services(recording: Recording) -> list[Service]:
    """Of every protocol that ships with tactibench, whether `run --data` can take the folder."""
    found = []
    for name in sorted(protocol_files()):
        keys = load_protocol(name).keys
        scenes = [
            (scene, press)
            for scene, press in zip(recording.scenes, recording.presses, strict=True)
            if scene
        ]
        known, presses = [s for s, _ in scenes], [p for _, p in scenes]
        if keys.recorded is not None:
            served, reason = _own(recording, known)
        else:
            served, reason = _drawn(keys, known, presses)
        found.append(Service(name, keys.title, served, reason))
    return found


def _own(recording: Recording, known: Sequence[Scene]) -> tuple[bool, str]:
    """A protocol of plate presses takes them as they were recorded."""
    plates = [scene for scene in known if scene.indenter.is_plate]
    if plates:
        return True, f"{len(plates):,} frames of a plate with depth and tilt"
    if known:
        return False, f"its frames are of {_kinds(known)}, not of a plate"
    try:
        _, roles = plate_scenes(recording, ImportOptions())
    except UserError as error:
        return False, f"no labels of a plate ({str(error).rstrip('.')}); {SURFACE_HINT}"
    return True, (
        f"depth from {roles['depth']}, tilt from {roles['tilt']}, if a plate pressed; "
        "`tactibench data fit` finds its offset and pivot"
    )


def _drawn(keys: Protocol, known: Sequence[Scene], presses: Sequence[str]) -> tuple[bool, str]:
    """A protocol of spherical tips needs presses that it could have drawn."""
    if not known:
        return False, (
            "only labels are known: import with --param indenter=single and the columns of x, y "
            "and depth, if a spherical tip pressed"
        )
    if keys.families:
        return False, "its hard cases need a sensor that presses them"
    assert keys.split is not None  # noqa: S101 - a protocol that draws divides its draws
    regime = next(iter(keys.regimes))
    found = match(keys, keys.split, regime, known, presses)
    if found.lacking:
        space = keys.workspace
        lacks = "; ".join(f"{name}: {needs(keys.draw(name))}" for name in found.lacking)
        return False, (
            f"lacks {lacks}, x and y within {space.half_width_mm:g} mm, "
            f"{space.depth_min_mm:g} to {space.depth_max_mm:g} mm deep (there: {_kinds(known)})"
        )
    counts = [sum(map(len, part.values())) for part in (found.fit, found.validation, found.test)]
    text = f"{counts[0]:,} frames train, {counts[1]:,} validate, {counts[2]:,} test"
    return True, text + (f"; {found.left_out:,} outside of it" if found.left_out else "")


def _kinds(scenes: Sequence[Scene]) -> str:
    kinds = Counter(scene.indenter.name for scene in scenes)
    return ", ".join(f"{count:,} {name}" for name, count in sorted(kinds.items()))
