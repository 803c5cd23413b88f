"""Parquet files hold the same samples, whole or not at all; ``datasets`` opens them."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
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
    is_dataset,
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


def test_forces_are_a_column_where_they_are_known(tmp_path: Path) -> None:
    scene, force = Scene(Indenter.single(), Pose(depth=1.0)), ((0.1, 0.2, -0.9),)
    header = Header("set", {"name": "tactip"}, (6, 5), dome_radius_mm=20.0)
    with Writer(tmp_path / "v1", header) as writer:
        writer.add(Draft(np.zeros((6, 5), np.uint8), 0, scene, contacts_force_n=force))
        writer.add(Draft(np.zeros((6, 5), np.uint8), 1, Scene(scene.indenter, Pose())))
    export = export_dataset(open_dataset(tmp_path / "v1"), tmp_path / "out")
    rows = read_parquet(export.path)
    assert [row["contacts_force_n"] for row in rows] == [[[0.1, 0.2, -0.9]], None]


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


KILLED = """
import os, sys
from pathlib import Path
from tactibench.datasets import export_dataset, open_dataset

export_dataset(open_dataset(Path(sys.argv[1])), Path("out"), advance=lambda _: os._exit(9))
"""


def test_what_a_killed_export_left_is_removed_by_the_next(dataset: Dataset, tmp_path: Path) -> None:
    killed = [sys.executable, "-c", KILLED, str(dataset.folder)]
    assert subprocess.run(killed, cwd=tmp_path, timeout=100).returncode == 9
    assert len(names(tmp_path)) == 2, "a folder and its lock"

    def export_beside(_: int) -> None:  # what runs at the same time is left alone
        if not (tmp_path / "out").exists():
            export_dataset(dataset, tmp_path / "out")

    with pytest.raises(OSError, match="not empty"):
        export_dataset(dataset, tmp_path / "out", advance=export_beside)
    assert names(tmp_path) == ["out"]
    assert names(tmp_path / "out") == ["data", "header.json", "rest.png"]


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


LOADED = """
import json, sys
import numpy, datasets
found = {part: [{**row, "image": numpy.asarray(row["image"]).tolist()} for row in rows]
         for part, rows in datasets.load_dataset(sys.argv[1]).items()}
print(json.dumps(found))
"""


def loaded(folder: Path, home: Path) -> dict[str, list[dict[str, Any]]]:
    """The rows of a folder as the library ``datasets`` gives them, in a process of its own."""
    offline = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "HF_HOME": str(home)}
    command = [sys.executable, "-W", "ignore", "-c", LOADED, str(folder)]
    done = subprocess.run(
        command, env={**os.environ, **offline}, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    rows: dict[str, list[dict[str, Any]]] = json.loads(done.stdout.splitlines()[-1])
    return rows


@pytest.mark.slow
def test_hugging_face_reads_a_data_set_and_its_export(tmp_path: Path) -> None:
    pytest.importorskip("datasets", reason="datasets is not installed")
    dataset = write_taps(tmp_path / "v1")
    export = export_dataset(dataset, tmp_path / "out")
    folder = loaded(dataset.folder, tmp_path / "hf")
    parquet = loaded(export.path, tmp_path / "hf")
    assert (list(folder), list(parquet)) == (["train"], ["test", "unassigned"])
    for rows in (folder["train"], [*parquet["test"], *parquet["unassigned"]]):
        for row, sample in zip(rows, dataset.samples, strict=True):
            contacts = dataset.contacts(sample)
            assert contacts is not None
            assert row["image"] == dataset.signal(sample).tolist()
            assert row["contacts_xy_mm"] == contacts.xy.tolist()
            assert row["labels"] == sample.labels
            for key in ("id", "press", "t_frame_ns"):
                assert row[key] == getattr(sample, key)
