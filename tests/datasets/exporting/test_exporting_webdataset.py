"""Tar files: sample by sample the same, and two exports the same bytes."""

from __future__ import annotations

import json
import tarfile
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Scene
from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting import export
from tactibench.datasets.exporting.chosen import choose
from tactibench.datasets.exporting.cut import cut
from tactibench.datasets.exporting.webdataset import write_webdataset

Make = Callable[..., Dataset]


def read_tars(folder: Path) -> dict[str, dict[str, bytes]]:
    """Key of a sample -> ending -> content, of all tar files."""
    found: dict[str, dict[str, bytes]] = defaultdict(dict)
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as tar:
            for member in tar:
                assert (member.mtime, member.uid, member.gid, member.uname) == (0, 0, 0, "")
                key, _, ending = member.name.partition(".")
                stream = tar.extractfile(member)
                assert stream is not None
                assert ending not in found[key]
                found[key][ending] = stream.read()
    return dict(found)


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.*")}


@settings(max_examples=12)
@given(st.data())
def test_the_tars_hold_the_same_samples(
    small_datasets: st.SearchStrategy[Any],
    good_of: Callable[[Dataset], list[Sample]],
    scene_from: Callable[[Mapping[str, Any]], Scene | None],
    data: st.DataObject,
) -> None:
    small = data.draw(small_datasets)
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        made = export(dataset, Path(place) / "tars", "webdataset")
        found = read_tars(made.path)
        samples = good_of(dataset)
        assert sorted(found) == sorted(f"{sample.id:06d}" for sample in samples)
        for sample in samples:
            entry = found[f"{sample.id:06d}"]
            assert entry["png"] == (dataset.folder / sample.file_name).read_bytes()
            row = json.loads(entry["json"])
            assert row["id"] == sample.id
            assert row.get("labels", {}) == sample.labels
            assert row.get("extra", {}) == sample.extra
            assert row.get("t_frame_ns") == sample.t_frame_ns
            assert scene_from(row) == sample.scene
            contacts = dataset.contacts(sample)
            if contacts is not None:
                assert row["contacts_xy_mm"] == contacts.xy.tolist()
        assert (made.path / "rest.png").is_file() == (small.rest is not None)
        again = export(dataset, Path(place) / "again", "webdataset")
        assert contents(made.path) == contents(again.path)


def test_shards_are_cut_by_size_and_named_by_part(make: Make, tmp_path: Path) -> None:
    dataset = make(tmp_path / "v1", count=9)
    (tmp_path / "out").mkdir()
    done: list[int] = []
    write_webdataset(
        dataset, tmp_path / "out", choose(dataset, "mine"), done.append, shard_bytes=6_000
    )
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["test-000000.tar", *(f"unassigned-{i:06d}.tar" for i in range(4))]
    assert len(read_tars(tmp_path / "out")) == sum(done) == 9


@given(st.lists(st.integers(0, 50), min_size=1, max_size=30), st.integers(1, 60))
def test_a_cut_keeps_order_and_limit(sizes: list[int], limit: int) -> None:
    shards = cut(sizes, limit)
    assert [item for shard in shards for item in shard] == list(range(len(sizes)))
    for shard, after in zip(shards, [*shards[1:], None], strict=True):
        total = sum(sizes[item] for item in shard)
        assert total <= limit or len(shard) == 1
        assert after is None or total + sizes[after.start] > limit


def test_a_changed_image_is_not_copied(make: Make, tmp_path: Path) -> None:
    from tactibench import UserError

    dataset = make(tmp_path / "v1")
    path = dataset.folder / dataset.samples[3].file_name
    path.write_bytes((dataset.folder / dataset.samples[2].file_name).read_bytes())
    with pytest.raises(UserError, match=r"000003.png is not the file that sample 3 had"):
        export(dataset, tmp_path / "out", "webdataset")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["v1"]
