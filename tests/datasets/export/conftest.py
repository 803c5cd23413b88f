"""Small data sets of every kind: gray or RGB, with or without scenes, labels, a rest frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Dataset, Draft, Header, Sample, Writer, open_dataset

ODD_NAMES = ("pose_1", "pose_x", "pose_Rz", "sensor_image", "press", "scene_x", "Kraft in µN, ø")


@dataclass(frozen=True)
class Small:
    """What is written into a small data set."""

    header: Header
    drafts: tuple[Draft, ...]
    rest: npt.NDArray[np.uint8] | None
    split: bool

    def write(self, folder: Path) -> Dataset:
        """A closed data set in a new folder; a split by press when there are two presses."""
        with Writer(folder, self.header, fsync=False) as writer:
            if self.rest is not None:
                writer.reference(self.rest)
            writer.add_many(self.drafts)
            presses = dict.fromkeys(sample.press for sample in writer.samples)
            if self.split and len(presses) > 1:
                first = next(iter(presses))
                of = [s.id for s in writer.samples if s.press == first]
                writer.split("mine", train=[], validation=[], test=of)
        return open_dataset(folder)


def images(shape: Sequence[int], seed: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, tuple(shape), dtype=np.uint8)


_NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda value: value + 0.0)
_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=6)
_NAMES = _TEXT | st.sampled_from(ODD_NAMES)


def _indenters() -> st.SearchStrategy[Indenter]:
    return st.sampled_from(
        [
            Indenter.single(),
            Indenter.dual(7.0),
            Indenter.triple((0.0, 1.5, 3.0)),
            Indenter.plate(),
            Indenter(2.5, ((0.0, 0.0, 0.0),), 'Kugel ø5, "fein"\n'),
        ]
    )


def _scenes() -> st.SearchStrategy[Scene]:
    angle = st.floats(-30, 30)
    pose = st.builds(Pose, st.floats(-8, 8), st.floats(-8, 8), angle, angle, st.floats(-1, 6))
    return st.builds(Scene, _indenters(), pose)


@st.composite
def smalls(draw: Any) -> Small:
    """Data sets of 1 to 4 samples; 0 to 3 contacts each."""
    channels = draw(st.sampled_from([1, 3]))
    shape = (4, 5) if channels == 1 else (4, 5, 3)
    names = draw(st.lists(_NAMES, max_size=4, unique=True))
    ids = draw(st.lists(st.integers(0, 2500), min_size=1, max_size=4, unique=True))
    header = Header(
        draw(_TEXT),
        {"name": draw(_TEXT), "parameters": {"pins": 127}},
        (4, 5),
        channels,
        draw(st.sampled_from([None, 20.0, math.inf])),
        licence=draw(_TEXT | st.just("cc-by-4.0")),
    )
    with_scenes = draw(st.booleans())
    drafts = []
    for number in ids:
        labels = {name: draw(_NUMBERS) for name in names if draw(st.booleans())}
        drafts.append(
            Draft(
                images(shape, number),
                number,
                draw(st.none() | _scenes()) if with_scenes else None,
                labels,
                draw(_TEXT),
                draw(_TEXT),
                draw(st.none() | st.integers(0, 2**62)),
                draw(st.sampled_from([{}, {"force": [0.5, -1.0]}, {"who": "ø"}])),
                "ok" if number == ids[0] else draw(st.sampled_from(["ok", "ok", "bad"])),
            )
        )
    rest = draw(st.none() | st.just(images(shape, 9999)))
    return Small(header, tuple(drafts), rest, draw(st.booleans()))


def made(folder: Path, count: int = 5, **header: Any) -> Dataset:
    """An ordinary data set: single and dual tips, labels of a robot, a rest frame, one split."""
    tips = (Indenter.single(), Indenter.dual(7.0))
    drafts = tuple(
        Draft(
            images((16, 16), number),
            number,
            Scene(tips[number % 2], Pose(0.5 * number, depth=2)),
            {"force_z": 0.25 * number},
            f"press-{number // 2}",
            "day 1",
            10**18 + number,
        )
        for number in range(count)
    )
    settings = {"dome_radius_mm": 20.0, "licence": "CC-BY-4.0", **header}
    whole = Header("taps", {"name": "tactip-127"}, (16, 16), **settings)
    return Small(whole, drafts, images((16, 16), 99), True).write(folder)


def good(dataset: Dataset) -> list[Sample]:
    return sorted((s for s in dataset.samples if s.status == "ok"), key=lambda s: s.id)


def scene_of(row: Mapping[str, Any]) -> Scene | None:
    """Of a journal line, whatever it was read from."""
    if row.get("indenter") is None:
        return None
    radius = row.get("indenter_radius_mm")
    offsets = tuple(tuple(offset) for offset in row["indenter_offsets_mm"])
    pose = Pose(row["x_mm"], row["y_mm"], row["yaw_deg"], row["tilt_deg"], row["depth_mm"])
    return Scene(Indenter(math.inf if radius is None else radius, offsets, row["indenter"]), pose)  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def small_datasets() -> st.SearchStrategy[Small]:
    return smalls()


@pytest.fixture(scope="session")
def make() -> Callable[..., Dataset]:
    """See ``made``."""
    return made


@pytest.fixture(scope="session")
def good_of() -> Callable[[Dataset], list[Sample]]:
    """Samples with status ok, by id."""
    return good


@pytest.fixture(scope="session")
def scene_from() -> Callable[[Mapping[str, Any]], Scene | None]:
    """See ``scene_of``."""
    return scene_of
