"""The card of a data set: README.md with the YAML front matter that the Hugging Face Hub reads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting.chosen import Chosen
from tactibench.datasets.exporting.licence import hub_keys, named, sentence
from tactibench.datasets.exporting.words import (
    counted,
    frames_of_reference,
    one_line,
    plain,
    presses,
    ranges,
    sensor_line,
    title,
    units_line,
)
from tactibench.datasets.splits import SUBSETS

_LONGEST = 120
"""Characters of a fact that are still short."""
_TAGS = ("tactile", "tactile-sensing", "robotics", "tactibench")


@dataclass(frozen=True)
class Files:
    """What a card says of the files beside it. parts: part -> patterns of its files, for
    ``datasets.load_dataset``; empty: that library has no reader. how: paragraphs on loading."""

    parts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    how: tuple[str, ...] = ()


def card(dataset: Dataset, samples: Sequence[Sample], files: Files) -> str:
    """The text of README.md; samples: those that the files hold."""
    header = dataset.header
    parts = [
        _front_matter(dataset, samples, files),
        f"# {title(dataset)}",
        sentence(named(header.licence)),
        "## Sensor and presses",
        sensor_line(dataset),
        " ".join(presses(samples)),
        *_settings(dataset),
        *_label_table(samples),
        "## Units and frames of reference",
        units_line(header.units, header.axes),
        *frames_of_reference(header.frames),
        "Depth is the travel past first touch. Contacts follow from the pose that was reached and "
        "from the dome; x and y are the axis of a tip.",
        "## Splits",
        *_splits(dataset),
        "## Loading",
        *files.how,
    ]
    return "\n\n".join(parts) + "\n"


def part_counts(chosen: Chosen) -> str:
    """``train 800, test 200``."""
    return ", ".join(f"{part} {len(samples):,}" for part, samples in chosen.parts.items())


def _front_matter(dataset: Dataset, samples: Sequence[Sample], files: Files) -> str:
    lines = [
        "---",
        f"pretty_name: {_yaml(title(dataset))}",
        *(f"{key}: {_yaml(text)}" for key, text in hub_keys(named(dataset.header.licence)).items()),
        *("tags:", *(f"- {tag}" for tag in _TAGS)),
        *("size_categories:", f"- {_size(len(samples))}"),
    ]
    if files.parts:
        lines += ["configs:", "- config_name: default", "  data_files:"]
    for part, patterns in files.parts.items():
        lines += [f"  - split: {part}", "    path:", *(f"    - {_yaml(p)}" for p in patterns)]
    return "\n".join([*lines, "---"])


def _settings(dataset: Dataset) -> list[str]:
    """Facts about sensor and source, one a line; long ones stand in the header only."""
    told = {
        **{f"sensor {key}": value for key, value in dataset.header.sensor.items()},
        **{f"source {key}": value for key, value in dataset.header.source.items()},
    }
    texts = {one_line(key): plain(value) for key, value in told.items() if value}
    lines = [f"- {key}: `{text}`" for key, text in texts.items() if len(text) <= _LONGEST]
    return ["\n".join(lines)] if lines else []


def _label_table(samples: Sequence[Sample]) -> list[str]:
    found = ranges(samples)
    if not found:
        return []
    rows = [f"| {_cell(name)} | {values} |" for name, values in found.items()]
    return ["Labels as they were recorded:", "\n".join(["| label | range |", "|---|---|", *rows])]


def _splits(dataset: Dataset) -> list[str]:
    if not dataset.splits:
        return ["There is no split. Samples of one press are alike: divide by `press`."]
    said = []
    for name, split in dataset.splits.items():
        counts = ", ".join(f"{part} {counted(len(getattr(split, part)), 'id')}" for part in SUBSETS)
        said.append(f"- `{name}`: {counts}")
    return ["No press lies in two parts of a split.", "\n".join(said)]


def _size(number: int) -> str:
    """The Hub's classes of size."""
    steps = (
        (1_000, "n<1K"),
        (10_000, "1K<n<10K"),
        (100_000, "10K<n<100K"),
        (1_000_000, "100K<n<1M"),
        (10_000_000, "1M<n<10M"),
    )
    return next((name for limit, name in steps if number < limit), "n>10M")


def _yaml(text: str) -> str:
    """A double-quoted YAML scalar (YAML 1.2, 5.7): JSON's, with every odd character escaped."""
    return "".join(
        c if c.isprintable() else f"\\U{ord(c):08X}" for c in json.dumps(text, ensure_ascii=False)
    )


def _cell(text: str) -> str:
    """In a table of Markdown."""
    return one_line(text).replace("\\", "\\\\").replace("|", "\\|")
