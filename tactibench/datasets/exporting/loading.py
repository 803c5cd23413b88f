"""How the files of a format are loaded, for cards."""

from __future__ import annotations

from collections.abc import Collection

from tactibench.datasets.exporting.card import Files

_REST = (
    "`rest.png`: the sensor at rest, if it was recorded. `header.json`: facts about all samples."
)


def native_files(splits: Collection[str]) -> Files:
    """Of the data set's own folder. splits: names of those there are."""
    how = (_NATIVE, _SPLIT) if splits else (_NATIVE,)
    return Files({"train": ("metadata.jsonl", "images/[0-9]*/*.png")}, how)


def files_of(format_: str, parts: Collection[str]) -> Files:
    """Of a format whose files are cut by part."""
    if format_ == "bristol":
        return Files(how=(_BRISTOL,))
    if format_ == "hf-parquet":
        return Files({part: (f"data/{part}-*.parquet",) for part in parts}, (_PARQUET, _REST))
    return Files({part: (f"{part}-*.tar",) for part in parts}, (_WEBDATASET, _REST))


_NATIVE = """\
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
which hold the pose of the scene; `env_params.json` what `object_label` stands for."""

_PARQUET = """\
```python
from datasets import load_dataset

data = load_dataset("parquet", data_dir="FOLDER")
data["train"][0]["image"]  # a PIL image
```"""

_WEBDATASET = """\
```python
import webdataset

data = webdataset.WebDataset("FOLDER/train-000000.tar", shardshuffle=False).decode("l8")
for sample in data:
    sample["png"], sample["json"]  # (H, W) uint8 (of RGB: "rgb8"), the journal line
```"""
