"""Journals that end in the middle of a line, and the repair of what a writer left."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from folder_files import files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_data_sets import draft, header, image

from tactibench import UserError
from tactibench.datasets import Draft, Writer, open_dataset, verify


def test_truncation_at_every_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole lines are kept, the rest is moved aside, and writing goes on to the same data set."""
    monkeypatch.setattr(os, "fsync", lambda _: None)  # some thousand of them, on any disk
    folder, kept_images = tmp_path / "set", tmp_path / "images"
    with Writer(folder, header()) as writer:
        writer.add_many([short(number) for number in range(2)])
        writer.leave_open()
    shutil.copytree(folder / "images", kept_images)
    journal = (folder / "metadata.jsonl").read_bytes()
    assert any(byte > 127 for byte in journal)  # some cuts fall inside a character
    ends = [0, *(i + 1 for i, byte in enumerate(journal) if byte == ord("\n"))]
    for size in range(len(journal) + 1):
        for name in (".trash", "images"):
            shutil.rmtree(folder / name, ignore_errors=True)
        shutil.copytree(kept_images, folder / "images", copy_function=_link)
        (folder / "metadata.jsonl").write_bytes(journal[:size])

        kept = sum(end <= size for end in ends[1:])
        torn = journal[ends[kept] : size]
        dataset = open_dataset(folder)
        assert [sample.id for sample in dataset.samples] == list(range(kept))
        assert len(dataset.repaired) == bool(torn) + (kept < 2)
        assert (folder / "metadata.jsonl").read_bytes() == journal[: ends[kept]]
        assert len(list((folder / ".trash").rglob("*.png"))) == 2 - kept
        aside = folder / ".trash/metadata.jsonl.torn"
        assert (aside.read_bytes() if torn else b"") == torn

        if size % 25 == 0:
            with Writer(folder, header()) as writer:
                assert writer.done == set(range(kept))
                assert writer.repaired == ()
                writer.add_many([short(number) for number in range(kept, 2)])
                writer.leave_open()
            assert (folder / "metadata.jsonl").read_bytes() == journal
            assert verify(folder) == []


def short(number: int) -> Draft:
    return Draft(image(number), number, press="ü€𝄞")


def _link(source: str, target: str) -> None:
    Path(target).hardlink_to(source)


@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_any_last_bytes_are_cut_off(open_set: Path, data: st.DataObject) -> None:
    journal = open_set / "metadata.jsonl"
    before = journal.read_bytes()
    junk = data.draw(st.binary(min_size=1, max_size=20).filter(lambda junk: b"\n" not in junk))
    end = data.draw(st.sampled_from([b"", b"\n"]))
    if junk.strip() == b"":
        end = b""
    journal.write_bytes(before + junk + end)
    dataset = open_dataset(open_set)
    assert len(dataset.samples) == 4
    assert dataset.repaired == (
        f"cut an unfinished line of {len(junk + end)} bytes off metadata.jsonl",
    )
    assert journal.read_bytes() == before


def test_a_torn_event_is_cut_off(open_set: Path) -> None:
    events = open_set / "events.jsonl"
    before = events.read_bytes()
    events.write_bytes(before + '{"kind": "stop", "text": "ü'.encode()[:-1])
    assert len(open_dataset(open_set).repaired) == 1
    assert events.read_bytes() == before


@pytest.mark.parametrize("line", [0, 1, 2])
@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b'{"file_name"', b'"file_name"', "line {}: "),
        (b'"depth_mm": 1.5', b'"depth_mm": NaN', "line {}: "),
        (b'"depth_mm": 1.5', b'"depth_mm": "1.5"', "line {}: key 'depth_mm' is '1.5'"),
        (b'"depth_mm": 1.5', b'"depht_mm": 1.5', "line {}: unknown key 'depht_mm'"),
        (b'"sha256": ', b'"sha255": ', "line {}: unknown key 'sha255'"),
        (b'"depth_mm": 1.5, ', b"", "line {}: the key 'depth_mm' is missing"),
        (b'"status": "ok"', b'"status": "fine"', "line {}: key 'status' is 'fine'"),
        (b"images/000000/00", b"images/../../00", "line {}: file_name is 'images/../../00"),
        (b'"indenter": "dual", ', b"", "line {}: a pose needs the key 'indenter'"),
        (b'"indenter_radius_mm": 3.0', b'"indenter_radius_mm": -3.0', "line {}: an indenter's"),
    ],
)
def test_a_garbled_line_is_named_and_refused(
    open_set: Path, line: int, old: bytes, new: bytes, says: str
) -> None:
    path = open_set / "metadata.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    assert old in lines[line]
    lines[line] = lines[line].replace(old, new)
    path.write_bytes(b"".join(lines))
    for work in (lambda: open_dataset(open_set), lambda: Writer(open_set, header())):
        with pytest.raises(UserError) as caught:
            work()
        assert f"{path} {says.format(line + 1)}" in str(caught.value)
    assert path.read_bytes() == b"".join(lines)  # nothing was mended
    assert any(says.format(line + 1) in finding for finding in verify(open_set))
    assert not (open_set / ".lock").exists()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"n_contacts": 2', b'"n_contacts": 1'),
        (b'"n_contacts": 2, ', b""),
        (b'"contacts_depth_mm": [1.5', b'"contacts_depth_mm": [1.6'),
        (b'"depth_mm": 1.5', b'"depth_mm": 1.6'),
    ],
)
def test_contacts_that_are_not_the_scenes_are_found(open_set: Path, old: bytes, new: bytes) -> None:
    path = open_set / "metadata.jsonl"
    text = path.read_bytes()
    assert old in text
    path.write_bytes(text.replace(old, new, 1))
    assert len(open_dataset(open_set).samples) == 4  # they are derived; nothing is read from them
    (finding,) = verify(open_set)
    assert re.search(r"metadata\.jsonl line \d: the contacts are not those of the", finding)


def test_an_id_on_two_lines_is_refused(open_set: Path) -> None:
    path = open_set / "metadata.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines, lines[1]]))
    with pytest.raises(UserError, match=r"metadata\.jsonl lines 2 and 5 are both of id 1"):
        open_dataset(open_set)
    assert any("lines 2 and 5" in finding for finding in verify(open_set))


def test_a_closed_journal_is_never_cut(closed_set: Path) -> None:
    path = closed_set / "metadata.jsonl"
    whole = path.read_bytes()
    for text in (whole[:-5], whole + b"{", whole.replace(b'"depth_mm": 1.5', b'"depth_mm": 2.5')):
        path.write_bytes(text)
        with pytest.raises(UserError, match="not what it was when the data set was closed"):
            open_dataset(closed_set)
        assert path.read_bytes() == text
        assert "was closed (checksum)" in " ".join(verify(closed_set))


def test_a_sample_that_was_cut_off_can_be_written_again(open_set: Path) -> None:
    path = open_set / "metadata.jsonl"
    path.write_bytes(path.read_bytes()[:-1])
    with Writer(open_set, header()) as writer:
        assert writer.done == {0, 1, 2}
        assert len(writer.repaired) == 2
        writer.add_many([draft(3)])
    dataset = open_dataset(open_set)
    assert np.array_equal(dataset.image(dataset.samples[3]), draft(3).signal)
    assert (open_set / ".trash/images/000000/000003.png").is_file()


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
def test_a_read_only_folder_is_read_without_repair(
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
