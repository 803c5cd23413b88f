"""Parquet files hold the same samples, and Hugging Face's ``datasets`` opens what is written."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from small_data_sets import Small, good, scene_of, smalls, write_taps

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    Dataset,
    Draft,
    Header,
    Writer,
    export_dataset,
    open_dataset,
    select_samples,
    write_parquet,
    write_split,
)


def read_parquet(folder: Path) -> list[dict[str, Any]]:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    files = sorted((folder / "data").iterdir())
    rows = [row for path in files for row in pq.read_table(path).to_pylist()]
    return sorted(rows, key=lambda row: row["id"])


@settings(max_examples=12)
@given(smalls())
def test_the_files_hold_the_same_samples(small: Small) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        export = export_dataset(dataset, Path(place) / "out", "hf-parquet")
        samples = good(dataset)
        for row, sample in zip(read_parquet(export.path), samples, strict=True):
            image = {
                "bytes": (dataset.folder / sample.file_name).read_bytes(),
                "path": f"{sample.id:06d}.png",
            }
            assert row["image"] == image
            labels = row.get("labels") or {}
            assert {k: v for k, v in labels.items() if v is not None} == sample.labels
            assert json.loads(row.get("extra") or "{}") == sample.extra
            assert row.get("t_frame_ns") == sample.t_frame_ns
            assert (row["press"], row["session"]) == (sample.press, sample.session)
            assert scene_of(row) == sample.scene
            contacts = dataset.contacts(sample)
            if contacts is not None:
                assert row["n_contacts"] == len(contacts)
                assert row["contacts_depth_mm"] == contacts.depth.tolist()


def test_the_schema_says_which_column_is_an_image(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    export_dataset(write_taps(tmp_path / "v1"), tmp_path / "out", "hf-parquet")
    schema = pq.read_schema(tmp_path / "out/data/test-00000-of-00001.parquet")
    features = json.loads(schema.metadata[b"huggingface"])["info"]["features"]
    assert list(features) == schema.names
    assert features["image"] == {"_type": "Image"}
    number = {"_type": "Value", "dtype": "float64"}
    assert features["contacts_xy_mm"] == [[number]]
    assert features["labels"] == {"force_z": number}


def test_shards_are_counted_in_their_names(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    dataset = write_taps(tmp_path / "v1", count=9)
    (tmp_path / "out").mkdir()
    write_parquet(
        dataset,
        tmp_path / "out",
        select_samples(dataset, "mine"),
        lambda _: None,
        shard_bytes=1_000,
    )
    names = sorted(path.name for path in (tmp_path / "out/data").iterdir())
    assert names == [
        "test-00000-of-00001.parquet",
        *(f"unassigned-{i:05d}-of-00004.parquet" for i in range(4)),
    ]
    assert [row["id"] for row in read_parquet(tmp_path / "out")] == list(range(9))


def test_without_pyarrow_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = write_taps(tmp_path / "v1")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(UserError, match=r"pip install 'tactibench\[hf\]'"):
        export_dataset(dataset, tmp_path / "out", "hf-parquet")
    assert [p.name for p in tmp_path.iterdir()] == ["v1"]


Run = Callable[..., Any]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Run code of a package on FOLDER in a process of its own; return what it sets as ``found``."""

    def run_code(package: str, code: str, folder: Path) -> Any:
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

    return run_code


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


@pytest.mark.slow
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
                Draft(
                    np.full((4, 4), 10 * number, np.uint8),
                    id=number,
                    scene=scenes[number % 4],
                    labels={"Kraft µN": 1.0 * number} if number % 3 else {},
                    extra={"force": [0.5, 1.5]} if number % 2 else {},
                )
            )
    return open_dataset(folder)


@pytest.mark.slow
def test_what_some_samples_lack_is_no_obstacle(run: Run, tmp_path: Path) -> None:
    dataset = mixed(tmp_path / "v1")
    call = 'datasets.load_dataset("imagefolder", data_dir=FOLDER)'
    found = run("datasets", LOADED.format(call=call), dataset.folder)["train"]
    for row, sample in zip(found, dataset.samples, strict=True):
        assert row["image"] == dataset.image(sample).tolist()
        assert (row["labels"] or {}).get("Kraft µN") == sample.labels.get("Kraft µN")
        contacts = dataset.contacts(sample)
        assert row["n_contacts"] == (None if contacts is None else len(contacts))


@pytest.mark.slow
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


@pytest.mark.slow
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
