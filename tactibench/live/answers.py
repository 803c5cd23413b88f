"""The answer of a model to one frame, and its description in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
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


def has_contact(prediction: Answer | None) -> bool:
    """Return whether a model sees a contact."""
    return isinstance(prediction, PlatePose) or bool(prediction is not None and len(prediction))


def describe_prediction(prediction: Answer | None) -> str:
    """Return a prediction in words."""
    if isinstance(prediction, PlatePose):
        return f"plate {prediction.depth:.2f} mm deep, tilted {prediction.tilt:.1f} deg"
    if not isinstance(prediction, Contacts) or not len(prediction):
        return "no contact"
    contacts = zip(prediction.xy.tolist(), prediction.depth.tolist(), strict=True)
    return "; ".join(f"({x:+.2f}, {y:+.2f}) {depth:.2f} mm" for (x, y), depth in contacts)
