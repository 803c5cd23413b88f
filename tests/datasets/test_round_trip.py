"""Samples come back as they were written, to the last bit."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from small_data_sets import Small, draft, header, image, smalls

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import Draft, Writer, open_dataset, verify
from tactibench.geometry import true_contacts


@settings(max_examples=25, suppress_health_check=list(HealthCheck))
@given(smalls())
def test_samples_come_back(tmp_path_factory: pytest.TempPathFactory, small: Small) -> None:
    dataset = small.write(tmp_path_factory.mktemp("v1") / "set")
    for sample, written in zip(dataset.samples, small.drafts, strict=True):
        assert sample.press == (written.press or str(written.id))
        for key in ("id", "scene", "labels", "session", "t_frame_ns", "extra", "status", "attempt"):
            assert getattr(sample, key) == getattr(written, key)
        assert np.array_equal(dataset.image(sample), written.signal)
        outside = cv2.imread(str(dataset.folder / sample.file_name), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(outside if outside.ndim == 2 else outside[..., ::-1], written.signal)
    assert verify(dataset.folder) == []


def test_the_journal_says_what_a_reader_of_it_alone_needs(closed_set: Path) -> None:
    text = (closed_set / "metadata.jsonl").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in text.splitlines()]
    row = rows[3]
    contacts = true_contacts(draft(3).scene)
    assert row["file_name"] == "images/000000/000003.png"
    assert (row["indenter"], row["indenter_radius_mm"], row["n_contacts"]) == ("dual", 3.0, 2)
    assert row["contacts_xy_mm"] == contacts.xy.tolist()
    assert row["contacts_depth_mm"] == contacts.depth.tolist()
    assert len({json.dumps({k: type(v).__name__ for k, v in row.items()}) for row in rows}) == 1


def test_a_thousand_images_in_a_folder(tmp_path: Path) -> None:
    with Writer(tmp_path / "set", header()) as writer:
        names = [writer.add(Draft(image(n), id=n)).file_name for n in (999, 1000, 1_234_567)]
    assert names == [
        "images/000000/000999.png",
        "images/000001/001000.png",
        "images/001234/1234567.png",
    ]
    assert len(open_dataset(tmp_path / "set").samples) == 3


def test_the_rest_frame_and_later_references(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header()) as writer:
        assert open_dataset(folder).rest is None
        for number in (1, 1, 2, 2, 1):
            writer.reference(image(number))
        writer.event("warning", text="bright", level=2)
    dataset = open_dataset(folder)
    assert dataset.rest is not None
    assert np.array_equal(dataset.rest, image(1))
    assert [event["kind"] for event in dataset.events] == ["reference"] * 3 + ["warning"]
    assert sorted(p.name for p in (folder / "images/reference").iterdir()) == [
        "000001.png",
        "000002.png",
        "rest.png",
    ]
    assert verify(folder) == []


def test_closing_seals_counts_and_journal(closed_set: Path) -> None:
    import hashlib

    header = json.loads((closed_set / "dataset.json").read_text())
    assert header["status"] == "closed"
    assert header["counts"] == {"samples": 4, "ok": 4, "presses": 2}
    journal = (closed_set / "metadata.jsonl").read_bytes()
    assert header["journal_sha256"] == hashlib.sha256(journal).hexdigest()
    assert open_dataset(closed_set).sha256 == header["journal_sha256"]
    assert not (closed_set / ".lock").exists()


def test_a_png_file_is_kept_byte_for_byte(tmp_path: Path) -> None:
    _, data = cv2.imencode(".png", image(5), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    with Writer(tmp_path / "set", header()) as writer:
        sample = writer.add(Draft(data.tobytes(), id=0))
    assert (tmp_path / "set" / sample.file_name).read_bytes() == data.tobytes()


def test_bulk_and_synced_writing_make_the_same_files(tmp_path: Path) -> None:
    for name, fsync in (("bulk", False), ("synced", True)):
        with Writer(tmp_path / name, header(uuid="0"), fsync=fsync) as writer:
            writer.add_many([draft(n) for n in range(40)])
    files = sorted(p.relative_to(tmp_path / "bulk") for p in (tmp_path / "bulk").rglob("*.*"))
    assert len(files) > 40
    for file in files:
        a, b = tmp_path / "bulk" / file, tmp_path / "synced" / file
        assert a.is_dir() or a.read_bytes() == b.read_bytes()


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"labels": {"a": math.nan}}, "sample 1 cannot be written"),
        ({"labels": {"a": math.inf}}, "sample 1 cannot be written"),
        ({"extra": {"a": {1, 2}}}, "is no JSON value"),
        ({"extra": {"a": 1}}, "extra.a holds int after float"),
        ({"extra": {"d": [1.0, "x"]}}, r"extra.d.\[\] holds str after float"),
        ({"extra": {"b": {"c": "x"}}}, "extra.b.c holds str after a list"),
        ({"scene": Scene(Indenter.single(), Pose(math.nan))}, "sample 1"),
    ],
)
def test_what_cannot_come_back_is_refused_and_leaves_nothing(
    tmp_path: Path, keys: dict[str, Any], says: str
) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header()) as writer:
        writer.add(Draft(image(0), id=0, extra={"a": 0.5, "b": {"c": [1]}}))
        with pytest.raises(UserError, match=says):
            writer.add(Draft(image(1), id=1, **keys))
        assert writer.done == {0}
        writer.add(Draft(image(1), id=1, extra={"a": None}))
    assert verify(folder) == []
