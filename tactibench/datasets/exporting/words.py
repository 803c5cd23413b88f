"""A data set in plain words, for cards and catalogues."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting.licence import named, sentence


def one_line(text: str) -> str:
    """Without line breaks, tabs and runs of spaces."""
    return " ".join(text.split())


def title(dataset: Dataset) -> str:
    """The name of the data set, on one line."""
    return one_line(dataset.header.name) or "data set"


def description(dataset: Dataset) -> str:
    """A few sentences: what was pressed on what, how it is measured, who may use it."""
    header = dataset.header
    parts = [
        sensor_line(dataset),
        *presses(dataset.samples),
        units_line(header.units, header.axes),
        *frames_of_reference(header.frames),
        sentence(named(header.licence)),
    ]
    return " ".join(parts)


def sensor_line(dataset: Dataset) -> str:
    """The sensor, its images and its dome."""
    header = dataset.header
    height, width = header.image
    colours = "RGB" if header.channels == 3 else "gray"
    rest = "with" if dataset.rest is not None else "without"
    radius = header.dome_radius_mm
    if radius is None:
        dome = "Nobody noted the radius of its dome."
    elif math.isinf(radius):
        dome = "It is flat."
    else:
        dome = f"Its dome has a radius of {radius:g} mm."
    return (
        f"Frames of the tactile sensor {one_line(str(header.sensor.get('name', 'unknown')))!r}, "
        f"{height} x {width} pixels, 8-bit {colours}, {rest} a frame of the sensor at rest. {dome}"
    )


def presses(samples: Sequence[Sample]) -> list[str]:
    """How many there are, of what, and how deep."""
    count = len({sample.press for sample in samples})
    bad = sum(sample.status != "ok" for sample in samples)
    said = [
        f"{counted(len(samples), 'sample')} of {counted(count, 'press', 'presses')}"
        f"{f', {bad:,} of them marked bad' if bad else ''}."
    ]
    scenes = [sample.scene for sample in samples if sample.scene is not None]
    if scenes:
        kinds = Counter(one_line(scene.indenter.name) for scene in scenes)
        what = ", ".join(f"{name} ({number:,})" for name, number in kinds.items())
        depth = _range(scene.pose.depth for scene in scenes)
        tilt = _range(scene.pose.tilt for scene in scenes)
        said.append(f"Pressed by: {what}; depth {depth} mm, tilt {tilt} deg.")
    if len(scenes) < len(samples):
        number = len(samples) - len(scenes)
        said.append(f"{counted(number, 'sample')} with pose labels alone, as they were recorded.")
    return said


def units_line(units: Mapping[str, str], axes: str) -> str:
    """Units of everything, and the convention of angles."""
    listed = ", ".join(f"{quantity} in {unit}" for quantity, unit in units.items())
    return f"Units: {listed}; angles are rotations about the axes {axes!r}."


def frames_of_reference(frames: Mapping[str, str]) -> list[str]:
    """One sentence a frame of reference."""
    return [f"Frame of reference '{name}': {one_line(text)}." for name, text in frames.items()]


def ranges(samples: Sequence[Sample]) -> dict[str, str]:
    """Label -> smallest to largest value."""
    names = dict.fromkeys(name for sample in samples for name in sample.labels)
    return {
        name: _range(sample.labels[name] for sample in samples if name in sample.labels)
        for name in names
    }


def counted(number: int, one: str, many: str = "") -> str:
    """``1 sample``, ``5,000 samples``."""
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def plain(value: Any) -> str:
    """JSON on one line."""
    return json.dumps(value, ensure_ascii=False)


def _range(values: Iterable[float]) -> str:
    numbers = list(values)
    low, high = min(numbers), max(numbers)
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
