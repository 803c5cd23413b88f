"""Parquet files hold the same samples, typed as Hugging Face's ``datasets`` reads them."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_data_sets import good, scene_of, smalls, write_taps

from tactibench import UserError
from tactibench.datasets import export_dataset
from tactibench.datasets.export.exporter import select_samples
from tactibench.datasets.export.parquet import write_parquet


def read_parquet(folder: Path) -> list[dict[str, Any]]:
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    files = sorted((folder / "data").iterdir())
    rows = [row for path in files for row in pq.read_table(path).to_pylist()]
    return sorted(rows, key=lambda row: row["id"])


@settings(max_examples=12)
@given(st.data())
def test_the_files_hold_the_same_samples(
    data: st.DataObject,
) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    small = data.draw(smalls())
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
