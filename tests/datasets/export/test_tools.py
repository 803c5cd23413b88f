"""Hugging Face ``datasets`` opens what is written.

Offline, with caches in a temporary folder, in a process of its own: caches and settings are read
when it is imported.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_data_sets import write_taps

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import Dataset, Header, Writer, export_dataset, open_dataset
from tactibench.datasets.splits import write_split

Run = Callable[..., Any]
pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Package, code that sets ``found``, the folder it sees as FOLDER -> found, through JSON."""

    def ran(package: str, code: str, folder: Path) -> Any:
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
        offline = {
            "HF_HUB_OFFLINE": "1",
            "HF_DATASETS_OFFLINE": "1",
            "HF_HOME": str(tmp_path / "hf"),
            "PYTHONWARNINGS": "ignore",
        }
        program = f"FOLDER = {str(folder)!r}\n{code}\nimport json; print(json.dumps(found))"
        done = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, **offline},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return ran


LOADED = """
import numpy, datasets
data = {call}
found = {{part: [{{**row, "image": numpy.asarray(row["image"]).tolist()}} for row in rows]
         for part, rows in data.items()}}
"""


def check(rows: list[dict[str, Any]], dataset: Dataset, samples: Any) -> None:
    """Rows as ``datasets`` gives them against the samples."""
    for row, sample in zip(rows, samples, strict=True):
        assert row["id"] == sample.id
        assert row["image"] == dataset.image(sample).tolist()
        contacts = dataset.contacts(sample)
        assert contacts is not None
        assert row["contacts_xy_mm"] == contacts.xy.tolist()
        assert row["contacts_depth_mm"] == contacts.depth.tolist()
        assert row["labels"] == sample.labels
        assert row["press"] == sample.press
        assert row["t_frame_ns"] == sample.t_frame_ns


@pytest.mark.parametrize(
    "call",
    [
        'datasets.load_dataset("imagefolder", data_dir=FOLDER)',
        "datasets.load_dataset(FOLDER)",
    ],
)
def test_a_data_set_is_an_image_folder(run: Run, tmp_path: Path, call: str) -> None:
    dataset = write_taps(tmp_path / "v1")
    dataset.images(dataset.samples)  # a cache beside the images
    export_dataset(dataset, dataset.folder, "card")
    found = run("datasets", LOADED.format(call=call), dataset.folder)
    assert list(found) == ["train"]
    check(found["train"], dataset, dataset.samples)


def mixed(folder: Path) -> Dataset:
    """A plate, pairs, singles and none that touches; labels, scenes and extra that some lack."""
    scenes = [
        None,
        Scene(Indenter.plate(), Pose(tilt=3.0, depth=1.0)),
        Scene(Indenter.dual(7.0), Pose(depth=2.0)),
        Scene(Indenter.single(), Pose(depth=-1.0)),
    ]
    with Writer(folder, Header("mixed", {"name": "s"}, (4, 4), dome_radius_mm=20.0)) as writer:
        for number in range(8):
            writer.add(
                np.full((4, 4), 10 * number, np.uint8),
                id=number,
                scene=scenes[number % 4],
                labels={"Kraft µN": 1.0 * number} if number % 3 else {},
                extra={"force": [0.5, 1.5]} if number % 2 else {},
            )
    return open_dataset(folder)


def test_what_some_samples_lack_is_no_obstacle(run: Run, tmp_path: Path) -> None:
    dataset = mixed(tmp_path / "v1")
    call = 'datasets.load_dataset("imagefolder", data_dir=FOLDER)'
    found = run("datasets", LOADED.format(call=call), dataset.folder)["train"]
    for row, sample in zip(found, dataset.samples, strict=True):
        assert row["image"] == dataset.image(sample).tolist()
        assert (row["labels"] or {}).get("Kraft µN") == sample.labels.get("Kraft µN")
        contacts = dataset.contacts(sample)
        assert row["n_contacts"] == (None if contacts is None else len(contacts))


@pytest.mark.parametrize(
    "call",
    [
        'datasets.load_dataset("parquet", data_dir=FOLDER)',
        "datasets.load_dataset(FOLDER)",
    ],
)
def test_parquet_files_show_images(run: Run, tmp_path: Path, call: str) -> None:
    if importlib.util.find_spec("pyarrow") is None:
        pytest.skip("pyarrow is not installed")
    dataset = write_taps(tmp_path / "v1")
    export = export_dataset(dataset, tmp_path / "out", "hf-parquet")
    found = run("datasets", LOADED.format(call=call), export.path)
    assert list(found) == ["test", "unassigned"]
    check(found["test"], dataset, dataset.samples[:2])
    check(found["unassigned"], dataset, dataset.samples[2:])


FOUND = """
import datasets, pathlib
def loaded(folder):
    try:
        return len(datasets.load_dataset("imagefolder", data_dir=str(folder), split="train"))
    except Exception as error:
        return str(error)
found = {folder.name: loaded(folder) for folder in pathlib.Path(FOLDER).iterdir()}
"""


def test_names_of_splits_that_would_hide_the_images_are_refused(run: Run, tmp_path: Path) -> None:
    """And for a reason: such a file alone is taken for the data."""
    names = ("my-test", "val_2", "train", "2test")
    for name in names:
        dataset = write_taps(tmp_path / "all" / name)
        with pytest.raises(UserError, match="a split cannot be called"):
            write_split(dataset.folder, name, dataset.splits["mine"], dataset.samples)
        (dataset.folder / "splits" / f"{name}.json").write_text("{}")
    free = write_taps(tmp_path / "all" / "free")
    for name in ("by-press", "published", "contest", "random.0", "Retrained"):
        write_split(free.folder, name, free.splits["mine"], free.samples)
    found = run("datasets", FOUND, tmp_path / "all")
    assert found.pop("free") == 5
    assert sorted(found) == sorted(names)
    assert 5 not in found.values()
