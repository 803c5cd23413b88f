"""One sample: an image and what is known about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, Scene
from tactibench.errors import UserError
from tactibench.geometry import true_contacts

Status = Literal["ok", "bad"]


@dataclass(frozen=True)
class Sample:
    """A finished sample.

    id: unique in the data set, 0 or more. file_name: of the image, inside the folder. sha256: of
    the image's file. scene: what was pressed, with the pose reached; None where only labels are
    known. labels: as they were recorded, original names, mm and deg. press: samples of one press
    share it; it is the unit of intervals and splits. attempt: 1 for the first. t_frame_ns: when the
    frame was taken, on a clock that only rises. extra: whatever else was recorded, as JSON.
    """

    id: int
    file_name: str
    sha256: str
    status: Status = "ok"
    scene: Scene | None = None
    labels: Mapping[str, float] = field(default_factory=dict)
    press: str = ""
    session: str = ""
    attempt: int = 1
    t_frame_ns: int | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Draft:
    """A sample that is yet to be written.

    image: (H, W) gray or (H, W, 3) RGB uint8, or the bytes of such a PNG file, which are kept as
    they are. press: the id as text when nothing is said.
    """

    image: npt.NDArray[np.uint8] | bytes
    id: int
    scene: Scene | None = None
    labels: Mapping[str, float] = field(default_factory=dict)
    press: str = ""
    session: str = ""
    t_frame_ns: int | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    status: Status = "ok"
    attempt: int = 1


def contacts_of(scene: Scene | None, dome_radius_mm: float | None) -> Contacts | None:
    """The contacts of a scene on a dome; None where the scene, the dome or a point is not known."""
    if scene is None or dome_radius_mm is None:
        return None
    try:
        return true_contacts(scene, dome_radius_mm)
    except UserError:  # a plate on a flat pad touches everywhere
        return None
