"""Small data sets: fixed ones with four samples, and random ones of every kind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Dataset, Draft, Header, Sample, Writer, open_dataset

SHAPE = (9, 7)


def image(number: int, shape: tuple[int, ...] = SHAPE) -> npt.NDArray[np.uint8]:
    """Return an image that only this number has."""
    return np.random.default_rng(number).integers(0, 256, shape, dtype=np.uint8)


def header(**keys: Any) -> Header:
    """Return the header of the fixed data sets, with some keys changed."""
    base: dict[str, Any] = {
        "name": "some",
        "sensor": {"name": "noise"},
        "image": SHAPE,
        "dome_radius_mm": 20.0,
    }
    return Header(**{**base, **keys})


def draft(number: int) -> Draft:
    """Return a sample of the fixed data sets: two a press, names that are not ASCII."""
    scene = Scene(Indenter.dual(7.0), Pose(0.1 * number, -0.25, 30.0, depth=1.5))
    return Draft(
        image(number),
        number,
        scene,
        {"pose_1": 0.5 * number},
        f"präß-{number // 2}",
        extra={"note": "µm", "n": number},
    )


@dataclass(frozen=True)
class Small:
    """The content of a small data set."""

    header: Header
    drafts: tuple[Draft, ...]
    rest: npt.NDArray[np.uint8] | None
    split: bool

    def write(self, folder: Path) -> Dataset:
        """Write a closed data set; with a split by press when there are two presses."""
        with Writer(folder, self.header, fsync=False) as writer:
            if self.rest is not None:
                writer.reference(self.rest)
            writer.add_many(self.drafts)
            presses = [sample.press for sample in writer.samples]
            if self.split and len(set(presses)) > 1:
                test = [s.id for s in writer.samples if s.press == presses[0]]
                writer.split("mine", test=test)
        return open_dataset(folder)


def write_taps(folder: Path, count: int = 5, **keys: Any) -> Dataset:
    """Write an ordinary data set: one and two tips, labels of a robot, a rest frame, one split."""
    tips = (Indenter.single(), Indenter.dual(7.0))
    drafts = tuple(
        Draft(
            image(number, (16, 16)),
            number,
            Scene(tips[number % 2], Pose(0.5 * number, depth=2)),
            {"force_z": 0.25 * number},
            f"press-{number // 2}",
            "day 1",
            10**18 + number,
        )
        for number in range(count)
    )
    keys = {"dome_radius_mm": 20.0, "licence": "CC-BY-4.0", **keys}
    whole = Header("taps", {"name": "tactip-127"}, (16, 16), **keys)
    return Small(whole, drafts, image(99, (16, 16)), split=True).write(folder)


def good(dataset: Dataset) -> list[Sample]:
    """Return the samples with status ok, by id."""
    return sorted((s for s in dataset.samples if s.status == "ok"), key=lambda s: s.id)


def scene_of(row: Mapping[str, Any]) -> Scene | None:
    """Return the scene of a journal's line, whatever it was read from."""
    if row.get("indenter") is None:
        return None
    radius = row.get("indenter_radius_mm")
    offsets: Any = tuple(tuple(offset) for offset in row["indenter_offsets_mm"])
    keys = ("x_mm", "y_mm", "yaw_deg", "tilt_deg", "depth_mm", "dx_mm", "dy_mm", "dyaw_deg")
    pose = Pose(*(row.get(key) or 0.0 for key in keys))
    return Scene(Indenter(math.inf if radius is None else radius, offsets, row["indenter"]), pose)


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
floats = st.floats(allow_nan=False, allow_infinity=False).map(lambda value: value + 0.0)
label_names = texts | st.sampled_from(
    ("pose_1", "pose_x", "pose_Rz", "sensor_image", "press", "scene_x", "Kraft in µN, ø")
)
"""Names that exports give to columns of their own are among them."""
_millimetres = st.floats(-8, 8)
_offsets = st.tuples(_millimetres, _millimetres, _millimetres)
indenters = st.one_of(
    st.just(Indenter.plate()),
    st.builds(Indenter.single, st.floats(0.5, 5)),
    st.builds(Indenter.dual, st.floats(1, 12)),
    st.just(Indenter.triple((0.0, 1.5, 3.0))),
    st.builds(
        Indenter, st.floats(0.1, 9), st.lists(_offsets, min_size=1, max_size=4).map(tuple), texts
    ),
)
scenes = st.builds(
    Scene,
    indenters,
    st.builds(
        Pose,
        *(_millimetres, _millimetres, st.floats(-360, 360), st.floats(-20, 20), st.floats(-1, 6)),
        *([st.just(0.0) | _millimetres] * 3),
    ),
)
extras = st.fixed_dictionaries(
    {},
    optional={
        "force_n": st.lists(floats, max_size=3),
        "z0_method": texts,
        "n_markers": st.integers(-(2**62), 2**62),
        "pose": st.fixed_dictionaries({"x": floats, "steady": st.booleans()}),
        "robot_timestamp": st.none() | floats,
    },
)


@st.composite
def smalls(draw: Any) -> Small:
    """Draw data sets of 0 to 4 samples, gray or RGB, with or without scenes and a rest frame."""
    channels = draw(st.sampled_from([1, 3]))
    shape = (4, 5) if channels == 1 else (4, 5, 3)
    names = draw(st.lists(label_names, max_size=4, unique=True))
    ids = draw(st.lists(st.integers(0, 3_000_000), min_size=1, max_size=4, unique=True))
    whole = Header(
        draw(texts),
        {"name": draw(texts), "parameters": {"pins": 127}},
        (4, 5),
        channels,
        draw(st.sampled_from([None, 20.0, math.inf])),
        licence=draw(texts | st.just("cc-by-4.0")),
    )
    pressed = st.none() | scenes if draw(st.booleans()) else st.none()
    drafts = tuple(
        Draft(
            image(number, shape),
            number,
            draw(pressed),
            {name: draw(floats) for name in names if draw(st.booleans())},
            draw(texts),
            draw(texts),
            draw(st.none() | st.integers(0, 2**62)),
            draw(extras),
            "ok" if number == ids[0] else draw(st.sampled_from(["ok", "ok", "bad"])),
            draw(st.integers(1, 5)),
        )
        for number in ids
    )
    rest = draw(st.none() | st.just(image(9999, shape)))
    return Small(whole, drafts, rest, draw(st.booleans()))
