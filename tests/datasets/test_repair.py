"""What opening mends, and what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from folder_files import files
from small_data_sets import header

from tactibench import UserError
from tactibench.datasets import Writer, open_dataset, verify


def test_orphans_go_to_the_trash_and_unfinished_files_go(open_set: Path) -> None:
    shard = open_set / "images/000000"
    before = files(open_set)
    (shard / "000009.png").write_bytes(b"orphan")
    (open_set / "images/000007").mkdir()
    (open_set / "images/000007/007123.png").write_bytes(b"far")
    for name in (
        ".000008.png.part",
        "../reference/.rest.png.part",
        "../../.dataset.json.x1y2",
        "../../.plan.jsonl.x1y2",
    ):
        (shard / name).write_bytes(b"half")
    dataset = open_dataset(open_set)
    assert dataset.repaired == (
        "moved 2 images that no line names to .trash/",
        "removed 4 unfinished files",
    )
    moved = {
        ".trash/images/000000/000009.png": b"orphan",
        ".trash/images/000007/007123.png": b"far",
    }
    assert files(open_set) == {**before, **moved}
    assert open_dataset(open_set).repaired == ()


def test_the_trash_keeps_everything(open_set: Path) -> None:
    for text in (b"first", b"second", b"third"):
        (open_set / "images/000000/000009.png").write_bytes(text)
        open_dataset(open_set)
    kept = sorted((open_set / ".trash/images/000000").iterdir())
    assert [path.read_bytes() for path in kept] == [b"first", b"second", b"third"]


def test_other_peoples_files_stay(open_set: Path) -> None:
    for name in ("images/Thumbs.db", "images/000000/photo.png", "images/000000/9.png", "notes.md"):
        (open_set / name).write_bytes(b"mine")
    before = files(open_set)
    assert open_dataset(open_set).repaired == ()
    assert files(open_set) == before


def test_a_closed_data_set_is_left_alone(closed_set: Path) -> None:
    (closed_set / "images/000000/000009.png").write_bytes(b"orphan")
    before = files(closed_set)
    assert open_dataset(closed_set).repaired == ()
    assert files(closed_set) == before
    assert any("000009.png is named by no line" in finding for finding in verify(closed_set))


def test_reading_does_not_disturb_a_writer(open_set: Path) -> None:
    with Writer(open_set, header()) as writer:
        (open_set / "images/000000/000004.png").write_bytes(b"about to be named")
        with (open_set / "metadata.jsonl").open("ab") as stream:
            stream.write(b'{"file_na')
        before = files(open_set)
        dataset = open_dataset(open_set)
        assert len(dataset.samples) == 4
        assert dataset.repaired == ()
        assert files(open_set) == before
        writer.leave_open()
    assert len(open_dataset(open_set).repaired) == 2


def test_without_repair_nothing_is_touched(open_set: Path) -> None:
    journal = open_set / "metadata.jsonl"
    journal.write_bytes(journal.read_bytes()[:-3])
    before = files(open_set)
    dataset = open_dataset(open_set, repair=False)
    assert [sample.id for sample in dataset.samples] == [0, 1, 2]
    assert files(open_set) == before


@pytest.mark.parametrize("how", ["no lock can be made", "no permission"])
def test_a_read_only_folder_is_read_without_mending(
    open_set: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    journal = open_set / "metadata.jsonl"
    journal.write_bytes(journal.read_bytes()[:-3])
    if how == "no permission":  # a superuser has every permission, so it is taken from the answer
        monkeypatch.setattr("os.access", lambda *_: False)
    else:
        (open_set / ".lock").mkdir()
    before = files(open_set)
    dataset = open_dataset(open_set)
    assert [sample.id for sample in dataset.samples] == [0, 1, 2]
    assert dataset.repaired == ()
    assert files(open_set) == before
    assert len(dataset.images(dataset.samples)) == 3


def test_an_acknowledged_image_that_is_gone_is_named(open_set: Path) -> None:
    (open_set / "images/000000/000002.png").unlink()
    dataset = open_dataset(open_set)
    assert len(dataset.samples) == 4
    with pytest.raises(UserError, match=r"000002\.png cannot be read"):
        dataset.images(dataset.samples)
