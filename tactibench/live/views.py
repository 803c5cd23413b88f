"""One frame with the answers of models to it, as bytes for the page: a JSON head, then pictures.

Pictures are neither compressed nor drawn here. A frame of 128 x 128 px has 16 KiB, which loopback
carries in less time than a JPEG takes to encode.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.errors import UserError
from tactibench.markers import Tracker
from tactibench.metrics import match
from tactibench.plugins import Model

Maps = npt.NDArray[np.float32]


def ask(model: Model, frame: Frame) -> tuple[Answer | None, Maps | None]:
    """Return a model's answer to one frame, and the (C, H, W) maps behind it, if it has any.

    It is computed as in a run: a model that has maps makes them once, and the answer is read from
    them.
    """
    maps: Any = model.maps([frame])
    if maps is None:
        return model.predict([frame])[0], None
    return model.read_maps(maps)[0], maps[0]


def describe_prediction(prediction: Answer | None) -> str:
    """Return a prediction in words."""
    if isinstance(prediction, PlatePose):
        return f"plate {prediction.depth:.2f} mm deep, tilted {prediction.tilt:.1f} deg"
    if not isinstance(prediction, Contacts) or not len(prediction):
        return "no contact"
    contacts = zip(prediction.xy.tolist(), prediction.depth.tolist(), strict=True)
    return "; ".join(f"({x:+.2f}, {y:+.2f}) {depth:.2f} mm" for (x, y), depth in contacts)


Image = npt.NDArray[np.uint8]
Line = tuple[float, float, float, float, bool]
"""x, y at rest and x, y now, px; whether the pin is seen."""


class PinLines:
    """The pins of one sensor.

    A sensor without pins has no lines.
    """

    def __init__(self, rest: Image) -> None:
        """Find the pins in the (H, W) uint8 frame of the untouched sensor."""
        self._tracker: Tracker | None
        try:
            # Centroids take 0.05 ms, and nobody sees an error of a tenth of a pixel on the page.
            self._tracker = Tracker(rest, refine=False)
        except UserError:
            self._tracker = None

    def __call__(self, image: Image) -> list[Line]:
        """Return the line of every pin in an (H, W) uint8 frame."""
        if self._tracker is None:
            return []
        tracks = self._tracker.track(image[None])
        rows = np.column_stack([self._tracker.rest, tracks.xy[0]]).tolist()
        return [
            (x0, y0, x, y, bool(seen))
            for (x0, y0, x, y), seen in zip(rows, tracks.seen[0], strict=True)
        ]


LENGTH = struct.Struct("<I")
"""Number of bytes of the head, which stands before the head."""
BYTES, FLOATS = np.dtype("u1"), np.dtype("<f4")


@dataclass(frozen=True)
class AnswerView:
    """The answer of one model to a frame.

    Attributes:
        prediction: Contacts or a plate pose; None: nothing could be read.
        ms: Time from the frame to the prediction.
        maps: (C, H, W) in 0..1, the first of which is shown; None: the model has none.
        drawn: Whether ``maps`` were drawn from the contacts, because the model has none.
    """

    prediction: Answer | None
    ms: float
    maps: npt.NDArray[Any] | None = None
    drawn: bool = False

    def head(self, truth: Contacts | None, gate_mm: float) -> dict[str, Any]:
        """Return the answer as JSON values, with its error where the truth is known."""
        contacts = self.prediction if isinstance(self.prediction, Contacts) else Contacts.none()
        error = None if truth is None else contact_errors(truth, contacts, gate_mm)
        return {
            "ms": round(self.ms, 3),
            "words": describe_prediction(self.prediction),
            "contacts": _rows(contacts),
            "error": error,
            "drawn": self.drawn,
        }


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame as the page shows it.

    Attributes:
        image: (H, W) uint8.
        pins: Lines of its pins, px.
        answers: One answer a model.
        truth: True contacts, where they are known.
        gate_mm: Distance in the plane from which a contact is missed.
        skin: (H, W) mm by which the skin is pressed in, on the grid of the maps.
    """

    image: npt.NDArray[np.uint8]
    pins: Sequence[Line]
    answers: Sequence[AnswerView]
    truth: Contacts | None = None
    gate_mm: float = 0.0
    skin: npt.NDArray[np.float64] | None = field(default=None, repr=False)

    def message(self, number: int) -> bytes:
        """Return the bytes that the page reads (``readMessage`` in page.js)."""
        pictures: dict[str, npt.NDArray[Any]] = {"frame": self.image}
        if self.skin is not None:
            pictures["skin"] = self.skin.astype(FLOATS)
        for k, answer in enumerate(self.answers):
            if answer.maps is not None:
                levels = np.clip(255.0 * answer.maps[0], 0, 255)
                pictures[f"map{k}"] = levels.astype(BYTES)
        head = {
            "number": number,
            "pins": [[*(round(v, 1) for v in line[:4]), int(line[4])] for line in self.pins],
            "truth": None if self.truth is None else _rows(self.truth),
            "answers": [answer.head(self.truth, self.gate_mm) for answer in self.answers],
        }
        return pack(head, pictures)


def pack(head: Mapping[str, Any], pictures: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return a message: length of the head, head with the places of the pictures, pictures.

    Args:
        head: JSON values.
        pictures: (H, W) arrays of uint8 or float32, by name.
    """
    places, start = {}, 0
    for name, picture in pictures.items():
        kind = "u1" if picture.dtype == BYTES else "f4"
        places[name] = [kind, *picture.shape, start]
        start += picture.nbytes
    text = json.dumps({**head, "pictures": places}, allow_nan=False).encode()
    parts = (np.ascontiguousarray(picture).tobytes() for picture in pictures.values())
    return b"".join([LENGTH.pack(len(text)), text, *parts])


def contact_errors(truth: Contacts, said: Contacts, gate_mm: float) -> dict[str, Any]:
    """Return the errors of the contacts of one frame.

    Args:
        truth: True contacts.
        said: Predicted contacts.
        gate_mm: Distance in the plane from which a contact is missed.

    Returns:
        "mm" is the mean distance in the plane of matched contacts, "depth_mm" their mean error of
        depth; both are None without a match. "missed" and "false" count the contacts without a
        partner within the gate.
    """
    rows, columns, distance = match(truth.xy, said.xy, gate_mm)
    depth = np.abs(truth.depth[rows] - said.depth[columns])
    return {
        "mm": round(float(distance.mean()), 5) if len(rows) else None,
        "depth_mm": round(float(depth.mean()), 5) if len(rows) else None,
        "missed": len(truth) - len(rows),
        "false": len(said) - len(rows),
    }


def _rows(contacts: Contacts) -> list[list[float]]:
    """Return (x, y, depth, score) of every contact."""
    columns = np.column_stack([contacts.xy, contacts.depth, contacts.score])
    return [[round(value, 4) for value in row] for row in columns.tolist()]
