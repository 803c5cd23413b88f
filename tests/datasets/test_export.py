"""Parquet files hold the same samples, whole or not at all; ``datasets`` opens them."""

from __future__ import annotations

import importlib.util
import json
import math
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

from tactibench import UserError
from tactibench.datasets import (
    Dataset,
    Draft,
    Header,
    Writer,
    export_dataset,
    is_dataset,
    new_folder,
    open_dataset,
)

pytest.importorskip("pyarrow", reason="pyarrow is not installed")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_taps(tmp_path_factory.mktemp("place") / "v1")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def read_parquet(folder: Path) -> list[dict[str, Any]]:
    import pyarrow.parquet as pq

    files = sorted((folder / "data").iterdir())
    rows = [row for path in files for row in pq.read_table(path).to_pylist()]
    return sorted(rows, key=lambda row: row["id"])


@settings(max_examples=6)
@given(smalls())
def test_the_files_hold_the_same_samples(small: Small) -> None:
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        export = export_dataset(dataset, Path(place) / "out")
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
    import pyarrow.parquet as pq

    export_dataset(write_taps(tmp_path / "v1"), tmp_path / "out")
    schema = pq.read_schema(tmp_path / "out/data/test-00000-of-00001.parquet")
    features = json.loads(schema.metadata[b"huggingface"])["info"]["features"]
    assert list(features) == schema.names
    assert features["image"] == {"_type": "Image"}
    number = {"_type": "Value", "dtype": "float64"}
    assert features["contacts_xy_mm"] == [[number]]
    assert features["labels"] == {"force_z": number}


def test_channels_are_lists_of_numbers(tmp_path: Path) -> None:
    header = Header("skin", {"name": "skin"}, signal=(15,), dome_radius_mm=math.inf)
    signals = np.random.default_rng(0).normal(size=(3, 15)).astype(np.float32)
    with Writer(tmp_path / "v1", header) as writer:
        writer.reference(np.zeros(15, np.float32))
        writer.add_many([Draft(signal, number) for number, signal in enumerate(signals)])
    export_dataset(open_dataset(tmp_path / "v1"), tmp_path / "out")
    rows = read_parquet(tmp_path / "out")
    assert np.array_equal([row["channels"] for row in rows], signals)
    assert np.array_equal(np.load(tmp_path / "out/rest.npy"), np.zeros(15))


@pytest.mark.parametrize("kind", ["file", "link", "orphan", "inside"])
def test_a_place_where_no_folder_can_be_is_refused(
    dataset: Dataset, tmp_path: Path, kind: str
) -> None:
    target = tmp_path / "out"
    if kind == "file":
        target.write_text("mine")
    elif kind == "link":
        target.symlink_to(tmp_path / "elsewhere")
    elif kind == "orphan":
        target = target / "deeper"
    else:
        target = dataset.folder / "out"
    sentence = {"orphan": r"out is not there; make it first", "inside": r"lies in the data set"}
    with pytest.raises(UserError, match=sentence.get(kind, "is there already")):
        export_dataset(dataset, target)
    assert names(tmp_path) == ([] if kind in {"orphan", "inside"} else ["out"])


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_interrupted_export_leaves_nothing(
    dataset: Dataset, tmp_path: Path, error: type[BaseException]
) -> None:
    done = 0

    def advance(number: int) -> None:
        nonlocal done
        done += number
        assert names(tmp_path)[0].startswith(".out."), "written beside its place"
        if done >= 2:
            raise error("stop")

    with pytest.raises(error):
        export_dataset(dataset, tmp_path / "out", advance=advance)
    assert names(tmp_path) == []


def test_a_place_that_was_taken_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    target = tmp_path / "out"

    def meanwhile() -> None:
        with new_folder(target, tmp_path / "source") as folder:
            (folder / "ours").write_text("ours")
            target.mkdir()
            (target / "theirs").write_text("theirs")

    with pytest.raises(OSError, match="not empty"):
        meanwhile()
    assert names(tmp_path) == ["out", "source"]
    assert names(target) == ["theirs"]


def test_an_empty_folder_is_taken_and_splits_are_files_of_their_own(tmp_path: Path) -> None:
    folder = write_taps(tmp_path / "v1").folder
    (folder / "splits/other.json").write_text('{"train": [0], "validation": [], "test": []}')
    (folder / "splits/mine.json").write_text('{"train": [0, 1], "validation": [4], "test": [2]}')
    (tmp_path / "out").mkdir()
    dataset = open_dataset(folder)
    with pytest.raises(UserError, match=r"several splits \(mine, other\); choose one"):
        export_dataset(dataset, tmp_path / "out")
    with pytest.raises(UserError, match=r"has no split 'mien'; did you mean 'mine'\?"):
        export_dataset(dataset, tmp_path / "out", split="mien")
    export = export_dataset(dataset, tmp_path / "out", split="mine")
    assert export.subsets == {"train": 2, "validation": 1, "test": 1, "unassigned": 1}
    assert names(export.path) == ["data", "header.json", "rest.png"]
    assert export.size_bytes == sum(p.stat().st_size for p in export.path.rglob("*.*"))
    assert not is_dataset(export.path)


def test_without_pyarrow_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = write_taps(tmp_path / "v1")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(UserError, match=r"pip install 'tactibench\[hf\]'"):
        export_dataset(dataset, tmp_path / "out")
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
found = {part: [{**row, "image": numpy.asarray(row["image"]).tolist()} for row in rows]
         for part, rows in datasets.load_dataset(FOLDER).items()}
"""


def check(rows: list[dict[str, Any]], dataset: Dataset, samples: Any) -> None:
    """Rows as ``datasets`` gives them against the samples."""
    for row, sample in zip(rows, samples, strict=True):
        assert row["id"] == sample.id
        assert row["image"] == dataset.signal(sample).tolist()
        contacts = dataset.contacts(sample)
        assert contacts is not None
        assert row["contacts_xy_mm"] == contacts.xy.tolist()
        assert row["contacts_depth_mm"] == contacts.depth.tolist()
        assert row["labels"] == sample.labels
        assert row["press"] == sample.press
        assert row["t_frame_ns"] == sample.t_frame_ns


@pytest.mark.slow
def test_a_data_set_is_an_image_folder(run: Run, tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    found = run("datasets", LOADED, dataset.folder)
    assert list(found) == ["train"]
    check(found["train"], dataset, dataset.samples)


@pytest.mark.slow
def test_parquet_files_show_images(run: Run, tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    export = export_dataset(dataset, tmp_path / "out")
    found = run("datasets", LOADED, export.path)
    assert list(found) == ["test", "unassigned"]
    check(found["test"], dataset, dataset.samples[:2])
    check(found["unassigned"], dataset, dataset.samples[2:])
