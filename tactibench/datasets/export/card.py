"""The card of a data set: README.md with the YAML front matter that the Hugging Face Hub reads."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

from tactibench.datasets.dataset import Dataset
from tactibench.datasets.schema import Sample
from tactibench.datasets.splits import SUBSETS
from tactibench.png import ImageKind

_LONGEST = 120
"""Most characters of a fact on the card; longer ones stand in the header only."""
_TAGS = ("tactile", "tactile-sensing", "robotics", "tactibench")
_SIZES = (
    (1_000, "n<1K"),
    (10_000, "1K<n<10K"),
    (100_000, "10K<n<100K"),
    (1_000_000, "100K<n<1M"),
    (10_000_000, "1M<n<10M"),
)
"""The Hub's classes of size, each with its limit."""

UNKNOWN = "unknown"
"""Name for a licence that nobody stated, as on the Hub:
https://huggingface.co/docs/hub/repositories-licenses."""
_SPDX = (
    *("Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "MPL-2.0", "Unlicense", "AGPL-3.0-only"),
    *("GPL-2.0-only", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-2.1-only", "LGPL-3.0-only"),
    *("CC0-1.0", "CC-BY-2.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0"),
    *("CC-BY-NC-3.0", "CC-BY-NC-4.0", "CC-BY-ND-4.0", "CC-BY-NC-ND-4.0", "CC-BY-NC-SA-4.0"),
    *("CDLA-Permissive-1.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0"),
    *("ODbL-1.0", "ODC-By-1.0", "PDDL-1.0"),
)
_SPDX_NAMES = {name.lower(): name for name in _SPDX}
_HUB_NAMES = {"ODbL-1.0": "odbl", "ODC-By-1.0": "odc-by", "PDDL-1.0": "pddl"}


def write_card(
    dataset: Dataset,
    samples: Sequence[Sample],
    format: str = "",  # noqa: A002 - what the option is called
    subsets: Collection[str] = (),
) -> str:
    """Return the text of README.md.

    Args:
        dataset: The data set.
        samples: The samples that the files beside the card hold.
        format: "bristol" or "hf-parquet"; "" for the data set itself.
        subsets: Subsets that have files of their own.
    """
    header = dataset.header
    paragraphs = [
        _front_matter(dataset, samples, _file_patterns(format, subsets)),
        f"# {_title(dataset)}",
        _licence_sentence(licence_name(header.licence)),
        "## Sensor and presses",
        _describe_sensor(dataset),
        " ".join(_describe_presses(samples)),
        *_settings(dataset),
        *_label_table(samples),
        "## Units and frames of reference",
        f"Units: {', '.join(f'{quantity} in {unit}' for quantity, unit in header.units.items())}; "
        f"angles are rotations about the axes {header.axes!r}.",
        *(
            f"Frame of reference '{name}': {_one_line(text)}."
            for name, text in header.frames.items()
        ),
        "Depth is the travel past first touch. Contacts follow from the pose that was reached and "
        "from the dome; x and y are the axis of a tip.",
        "## Splits",
        *_describe_splits(dataset),
        "## Loading",
        *_loading(dataset, format),
    ]
    return "\n\n".join(paragraphs) + "\n"


def licence_name(licence: str | None) -> str | None:
    """Return the licence as SPDX writes it, None where nobody stated it."""
    text = _one_line(licence or "")
    if text.lower() in {"", UNKNOWN, "none"}:
        return None
    return _SPDX_NAMES.get(text.lower(), text)


def hub_licence(licence: str | None) -> dict[str, str]:
    """Return the keys of the front matter for a licence that ``licence_name`` returned."""
    if licence is None:
        return {"license": UNKNOWN}
    if licence not in _SPDX:
        return {"license": "other", "license_name": licence}
    plain = licence.removesuffix("-only").removesuffix("-or-later")
    return {"license": _HUB_NAMES.get(licence, plain.lower())}


def _licence_sentence(licence: str | None) -> str:
    if licence is None:
        return "The licence of this data set is unknown: ask whoever recorded it before using it."
    return f"Licence: {licence}."


def _front_matter(
    dataset: Dataset, samples: Sequence[Sample], patterns: Mapping[str, Sequence[str]]
) -> str:
    """Return the YAML block; ``patterns`` names the files of every subset."""
    size = next((name for limit, name in _SIZES if len(samples) < limit), "n>10M")
    licence = hub_licence(licence_name(dataset.header.licence))
    lines = [
        "---",
        f"pretty_name: {_yaml(_title(dataset))}",
        *(f"{key}: {_yaml(text)}" for key, text in licence.items()),
        *("tags:", *(f"- {tag}" for tag in _TAGS)),
        *("size_categories:", f"- {size}"),
    ]
    if patterns:
        lines += ["configs:", "- config_name: default", "  data_files:"]
    for subset, files in patterns.items():
        lines += [f"  - split: {subset}", "    path:", *(f"    - {_yaml(file)}" for file in files)]
    return "\n".join([*lines, "---"])


def _file_patterns(format: str, subsets: Collection[str]) -> dict[str, tuple[str, ...]]:  # noqa: A002
    """Return subset -> patterns of its files, for ``datasets.load_dataset``."""
    if format == "bristol":
        return {}  # that library has no reader
    if format == "hf-parquet":
        return {subset: (f"data/{subset}-*.parquet",) for subset in subsets}
    return {"train": ("metadata.jsonl", "images/[0-9]*/*.png")}


def _title(dataset: Dataset) -> str:
    return _one_line(dataset.header.name) or "data set"


def _describe_sensor(dataset: Dataset) -> str:
    header = dataset.header
    kind = header.kind
    signal = f"{kind} (float32)"
    if isinstance(kind, ImageKind):
        colours = "RGB" if kind.colour else "gray"
        signal = f"{kind.height} x {kind.width} pixels, 8-bit {colours}"
    rest = "with" if dataset.rest is not None else "without"
    radius = header.dome_radius_mm
    if radius is None:
        dome = "Nobody noted the radius of its dome."
    elif math.isinf(radius):
        dome = "It is flat."
    else:
        dome = f"Its dome has a radius of {radius:g} mm."
    return (
        f"Frames of the tactile sensor {_one_line(str(header.sensor.get('name', 'unknown')))!r}, "
        f"{signal}, {rest} a frame of the sensor at rest. {dome}"
    )


def _describe_presses(samples: Sequence[Sample]) -> list[str]:
    """Return sentences on the numbers of samples and presses, the indenters, depths and tilts."""
    presses = len({sample.press for sample in samples})
    bad = sum(sample.status != "ok" for sample in samples)
    marked = f", {bad:,} of them marked bad" if bad else ""
    sentences = [
        f"{_count(len(samples), 'sample')} of {_count(presses, 'press', 'presses')}{marked}."
    ]
    scenes = [sample.scene for sample in samples if sample.scene is not None]
    if scenes:
        kinds = Counter(_one_line(scene.indenter.name) for scene in scenes)
        indenters = ", ".join(f"{name} ({number:,})" for name, number in kinds.items())
        depth = _range(scene.pose.depth for scene in scenes)
        tilt = _range(scene.pose.tilt for scene in scenes)
        sentences.append(f"Pressed by: {indenters}; depth {depth} mm, tilt {tilt} deg.")
    if len(scenes) < len(samples):
        number = _count(len(samples) - len(scenes), "sample")
        sentences.append(f"{number} with pose labels alone, as they were recorded.")
    return sentences


def _settings(dataset: Dataset) -> list[str]:
    """Return the short facts about sensor and source as a list, one per line."""
    facts = {
        **{f"sensor {key}": value for key, value in dataset.header.sensor.items()},
        **{f"source {key}": value for key, value in dataset.header.source.items()},
    }
    texts = {
        _one_line(key): json.dumps(value, ensure_ascii=False)
        for key, value in facts.items()
        if value
    }
    lines = [f"- {key}: `{text}`" for key, text in texts.items() if len(text) <= _LONGEST]
    return ["\n".join(lines)] if lines else []


def _label_table(samples: Sequence[Sample]) -> list[str]:
    names = dict.fromkeys(name for sample in samples for name in sample.labels)
    if not names:
        return []
    rows = []
    for name in names:
        values = _range(sample.labels[name] for sample in samples if name in sample.labels)
        cell = _one_line(name).replace("\\", "\\\\").replace("|", "\\|")
        rows.append(f"| {cell} | {values} |")
    return ["Labels as they were recorded:", "\n".join(["| label | range |", "|---|---|", *rows])]


def _describe_splits(dataset: Dataset) -> list[str]:
    if not dataset.splits:
        return ["There is no split. Samples of one press are alike: divide by `press`."]
    lines = []
    for name, split in dataset.splits.items():
        counts = (f"{subset} {_count(len(getattr(split, subset)), 'id')}" for subset in SUBSETS)
        lines.append(f"- `{name}`: {', '.join(counts)}")
    return ["No press lies in two parts of a split.", "\n".join(lines)]


def _loading(dataset: Dataset, format: str) -> tuple[str, ...]:  # noqa: A002
    """Return paragraphs on how the files are loaded."""
    if format == "bristol":
        return (_BRISTOL,)
    if format == "hf-parquet":
        return (_PARQUET, _BESIDE_PARQUET)
    if dataset.header.signal:
        return (_CHANNELS.format(shape=", ".join(map(str, dataset.header.signal))),)
    return (_DATA_SET, _SPLIT) if dataset.splits else (_DATA_SET,)


def _one_line(text: str) -> str:
    """Return a text without line breaks, tabs and runs of spaces."""
    return " ".join(text.split())


def _count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 sample``, ``5,000 samples``."""
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def _range(values: Iterable[float]) -> str:
    numbers = list(values)
    low, high = min(numbers), max(numbers)
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _yaml(text: str) -> str:
    """Return a double-quoted YAML scalar (YAML 1.2, 5.7): JSON's, odd characters escaped."""
    return "".join(
        c if c.isprintable() else f"\\U{ord(c):08X}" for c in json.dumps(text, ensure_ascii=False)
    )


_DATA_SET = """\
```python
from pathlib import Path
from tactibench.datasets import open_dataset

data = open_dataset(Path("FOLDER"))
images = data.images(data.samples)  # (N, H, W) uint8, mapped from the disk
```

```python
from datasets import load_dataset

data = load_dataset("imagefolder", data_dir="FOLDER", split="train")  # every sample
```"""

_CHANNELS = """\
```python
import json
import numpy as np

channels = np.fromfile("FOLDER/channels.f32", "<f4").reshape(-1, {shape})
samples = [json.loads(line) for line in open("FOLDER/metadata.jsonl")]  # a line a row of them
```"""

_SPLIT = """\
`splits/NAME.json` lists the ids of a split's parts:

```python
import json

ids = set(json.load(open("FOLDER/splits/NAME.json"))["test"])
test = data.filter(lambda sample: sample["id"] in ids)
```"""

_BRISTOL = """\
`targets.csv` names the frames of `sensor_images/` in the column `sensor_image`; `image_0.png` is
the sensor at rest, if it was recorded. `collect_params.json` says which column is which label and
which hold the pose of the scene; `env_params.json` what `object_label` stands for.
`tactibench data import FOLDER TARGET` makes the data set again."""

_PARQUET = """\
```python
from datasets import load_dataset

data = load_dataset("parquet", data_dir="FOLDER")
data["train"][0]["image"]  # a PIL image
```"""

_BESIDE_PARQUET = (
    "`rest.png`: the sensor at rest, if it was recorded. `header.json`: facts about all samples."
)
