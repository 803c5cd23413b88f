"""Small data sets of the project's own format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene
from tactibench.datasets import Draft, Header, Writer

SHAPE = (9, 7)


def picture(number: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """An image that only this number has."""
    return np.random.default_rng(number).integers(0, 256, shape, dtype=np.uint8)


def header_of(**keys: Any) -> Header:
    base: dict[str, Any] = {
        "name": "some",
        "sensor": {"name": "noise"},
        "image": SHAPE,
        "dome_radius_mm": 20.0,
    }
    return Header(**{**base, **keys})


def draft_of(number: int) -> Draft:
    """Two samples a press, names that are not ASCII."""
    scene = Scene(Indenter.dual(7.0), Pose(0.1 * number, -0.25, 30.0, depth=1.5))
    return Draft(
        picture(number),
        number,
        scene,
        {"pose_1": 0.5 * number},
        f"präß-{number // 2}",
        extra={"note": "µm", "n": number},
    )


def write(folder: Path, count: int = 4, **more: Any) -> None:
    """A closed data set with samples 0 ... count - 1 and a rest frame."""
    with Writer(folder, header_of(**more)) as writer:
        writer.reference(picture(-1 + 10**6))
        writer.add_many([draft_of(number) for number in range(count)])


def write_open(folder: Path, count: int = 4) -> None:
    writer = Writer(folder, header_of())
    writer.reference(picture(10**6))
    writer.add_many([draft_of(number) for number in range(count)])
    writer.leave_open()


@pytest.fixture
def image() -> Callable[..., np.ndarray]:
    return picture


@pytest.fixture
def header() -> Callable[..., Header]:
    return header_of


@pytest.fixture
def draft() -> Callable[[int], Draft]:
    return draft_of


@pytest.fixture
def closed_set(tmp_path: Path) -> Path:
    """Four samples and a rest frame, closed."""
    write(tmp_path / "closed")
    return tmp_path / "closed"


@pytest.fixture
def open_set(tmp_path: Path) -> Path:
    """Four samples and a rest frame, still open."""
    write_open(tmp_path / "open")
    return tmp_path / "open"
