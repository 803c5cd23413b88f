"""Preparation of camera frames: pins cut out of raw pictures, and an estimate of the rest frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactibench.contacts import Scene
from tactibench.datasets.readers.options import AS_IS, AUTO
from tactibench.datasets.readers.recording import Recording
from tactibench.errors import UserError
from tactibench.markers import find_pin_view, is_raw

_PROBES = 5
"""Frames that are tested for raw pictures where there is no rest frame."""
_LIGHT_MM = 0.3
"""Depth to which a tip counts as hardly pressed: pins move by less than a tenth of it."""
_FEWEST, _MOST = 9, 25
"""Numbers of hardly pressed frames from which the rest frame is estimated: in the median of nine at
different places, the two or three in which a pin was moved do not count."""


def prepare_frames(recording: Recording, light: str) -> Recording:
    """Return the recording with a view of its pins where frames are raw, and a rest frame.

    Args:
        recording: A recording of images.
        light: "even" cuts pins out of pictures, "as_is" does not, "auto" does where they are raw.

    Raises:
        UserError: Pins are to be cut out, and none are found.
    """
    probes = np.linspace(0, len(recording) - 1, min(_PROBES, len(recording))).round().astype(int)
    try:
        rest = recording.rest_image()
        images = [recording.image(row) for row in probes.tolist()] if rest is None else [rest]
    except UserError:  # reported where the frame is needed; the labels can be read
        return recording
    notes = list(recording.notes)
    if light != AS_IS and (light != AUTO or 2 * sum(map(is_raw, images)) > len(images)):
        view = find_pin_view(images[0])
        recording = replace(recording, view=view)
        notes.append(
            f"raw camera frames: pins are cut out ({view}), evenly lit and gray; --param "
            "light=as_is leaves frames as they are."
        )
    rows = _hardly_pressed(recording.scenes) if rest is None else []
    if rows:
        median = np.median([recording.image(row) for row in rows], axis=0)
        recording = replace(recording, estimated_rest=np.rint(median).astype(np.uint8))
        notes.append(
            f"no frame of the undeformed sensor in {recording.frames.name}: it is estimated, the "
            f"median of the {len(rows)} least pressed frames (add one as init_0.png)."
        )
    elif rest is None:
        notes.append(
            f"no frame of the undeformed sensor in {recording.frames.name}: models that follow "
            "pins from the rest layout cannot be run on it (add one as init_0.png)."
        )
    return replace(recording, notes=tuple(notes))


def _hardly_pressed(scenes: tuple[Scene | None, ...]) -> list[int]:
    """Return the rows of the least pressed frames; [] where too few are hardly pressed.

    A plate moves most pins at once, so that it must not touch.
    """
    depth = np.array([np.inf if s is None else s.pose.depth for s in scenes])
    limit = np.array([0.0 if s is None or s.indenter.is_plate else _LIGHT_MM for s in scenes])
    rows = np.flatnonzero(depth <= limit)
    if len(rows) < _FEWEST:
        return []
    least: list[int] = rows[np.argsort(depth[rows], kind="stable")][:_MOST].tolist()
    return least
