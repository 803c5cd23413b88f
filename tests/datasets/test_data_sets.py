"""Data sets of images and of channels: what was acknowledged comes back, and damage is found."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from folder_files import files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_data_sets import Small, draft, header, image, smalls

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    Draft,
    Header,
    Writer,
    is_dataset,
    open_dataset,
    verify,
)
from tactibench.geometry import true_contacts

PLAN = [{"id": number, "depth_mm": 0.5 * number} for number in range(5)]


def flip(path: Path, at: int = -20) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def png(pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", pixels)[1])


def skin_header(shape: tuple[int, ...] = (15,)) -> Header:
    return Header("skin", {"name": "skin"}, signal=shape, dome_radius_mm=math.inf)


def skin_draft(number: int, shape: tuple[int, ...] = (15,)) -> Draft:
    values = np.random.default_rng(number).normal(0, 1e3, shape).astype(np.float32)
    return Draft(values, number, Scene(Indenter.single(), Pose(0.5 * number, depth=2.0)))


@pytest.fixture
def skin(tmp_path: Path) -> Path:
    """An open data set of two rows of 15 channels."""
    writer = Writer(tmp_path / "skin", skin_header())
    writer.reference(np.zeros(15, np.float32))
    writer.add_many([skin_draft(0), skin_draft(1)])
    writer.leave_open()
    return writer.folder


@settings(max_examples=10, suppress_health_check=list(HealthCheck))
@given(smalls())
def test_samples_come_back(tmp_path_factory: pytest.TempPathFactory, small: Small) -> None:
    dataset = small.write(tmp_path_factory.mktemp("v1") / "set")
    for sample, written in zip(dataset.samples, small.drafts, strict=True):
        assert sample.press == (written.press or str(written.id))
        for key in ("id", "scene", "labels", "session", "t_frame_ns", "extra", "status", "attempt"):
            assert getattr(sample, key) == getattr(written, key)
        assert np.array_equal(dataset.signal(sample), written.signal)
        outside = cv2.imread(str(dataset.folder / sample.file_name), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(outside if outside.ndim == 2 else outside[..., ::-1], written.signal)
    assert verify(dataset.folder) == []


@pytest.mark.parametrize("shape", [(15,), (4, 3)])
def test_channels_come_back_to_the_last_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    with Writer(tmp_path / "set", skin_header(shape)) as writer:
        writer.reference(np.zeros(shape, np.float32))
        writer.add_many([skin_draft(number, shape) for number in range(5)])
    dataset = open_dataset(tmp_path / "set")
    plain = np.fromfile(dataset.folder / "channels.f32", "<f4").reshape(-1, *shape)
    for sample in dataset.samples:
        signal = dataset.signal(sample)
        assert signal.dtype == np.float32
        assert signal.tobytes() == skin_draft(sample.id, shape).signal.tobytes()
        assert np.array_equal(plain[sample.id], signal)
    assert dataset.rest is not None
    assert dataset.rest.shape == shape
    assert verify(dataset.folder) == []


def test_the_journal_says_what_a_reader_of_it_alone_needs(closed_set: Path) -> None:
    text = (closed_set / "metadata.jsonl").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in text.splitlines()]
    contacts = true_contacts(draft(3).scene)
    assert rows[3]["file_name"] == "images/000000/000003.png"
    indenter = [rows[3][key] for key in ("indenter", "indenter_radius_mm", "n_contacts")]
    assert indenter == ["dual", 3.0, 2]
    assert rows[3]["contacts_xy_mm"] == contacts.xy.tolist()
    assert rows[3]["contacts_depth_mm"] == contacts.depth.tolist()
    assert len({json.dumps({k: type(v).__name__ for k, v in row.items()}) for row in rows}) == 1


def test_a_thousand_images_in_a_folder_and_png_files_as_they_are(tmp_path: Path) -> None:
    _, data = cv2.imencode(".png", image(5), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    with Writer(tmp_path / "set", header()) as writer:
        names = [writer.add(Draft(data.tobytes(), n)).file_name for n in (999, 1000, 1_234_567)]
    assert names == [f"images/{name}.png" for name in ("000000/000999", "000001/001000")] + [
        "images/001234/1234567.png"
    ]
    assert (tmp_path / "set" / names[2]).read_bytes() == data.tobytes()


def test_the_rest_frame_and_later_references(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header()) as writer:
        assert open_dataset(folder).rest is None
        for number in (1, 1, 2, 2, 1):
            writer.reference(image(number))
        writer.event("warning", text="bright", level=2)
    dataset = open_dataset(folder)
    assert np.array_equal(dataset.rest, image(1))
    assert [event["kind"] for event in dataset.events] == ["reference"] * 3 + ["warning"]
    names = sorted(path.name for path in (folder / "images/reference").iterdir())
    assert names == ["000001.png", "000002.png", "rest.png"]
    assert verify(folder) == []


def test_closing_writes_counts_and_the_journals_hash(closed_set: Path) -> None:
    header = json.loads((closed_set / "dataset.json").read_text())
    journal = (closed_set / "metadata.jsonl").read_bytes()
    assert (header["status"], header["counts"]) == ("closed", {"samples": 4, "ok": 4, "presses": 2})
    assert header["journal_sha256"] == hashlib.sha256(journal).hexdigest()
    assert open_dataset(closed_set).sha256 == header["journal_sha256"]


def test_writing_goes_on_where_it_was(open_set: Path) -> None:
    with Writer(open_set, header()) as writer:
        for number in (-1, 1.5, "a", True):
            with pytest.raises(UserError, match="must be a whole number from 0"):
                writer.add(Draft(image(0), number))
        for wrong in ([draft(4), draft(2)], [draft(5), draft(5)]):
            with pytest.raises(UserError, match=f"has a sample {wrong[1].id} already"):
                writer.add_many(wrong)
        assert writer.done == {0, 1, 2, 3}
        writer.add_many([draft(5), draft(4)])
    assert [sample.id for sample in open_dataset(open_set).samples] == [0, 1, 2, 3, 5, 4]
    assert verify(open_set) == []


def test_it_stays_open_until_the_plan_is_done(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header(), PLAN) as writer:
        writer.add_many([draft(0), draft(3)])
        with pytest.raises(UserError, match="no id 7 in its plan"):
            writer.add(draft(7))
    assert open_dataset(folder).header.status == "open"
    with Writer(folder, header(), PLAN) as writer:
        writer.add_many([draft(number) for number in (1, 2, 4)])
    dataset = open_dataset(folder)
    assert dataset.header.status == "closed"
    assert list(dataset.plan()) == PLAN


@pytest.mark.parametrize("plan", [[], [*PLAN[:-1], {"id": 4, "depth_mm": 9.0}]])
def test_another_plan_is_refused(tmp_path: Path, plan: Any) -> None:
    Writer(tmp_path / "set", header(), PLAN).leave_open()
    with pytest.raises(UserError, match="begun with plan_sha256"):
        Writer(tmp_path / "set", header(), plan)
    (tmp_path / "set/plan.jsonl").write_text('{"id": 0}\n')
    with pytest.raises(UserError, match=r"plan\.jsonl is not the plan"):
        Writer(tmp_path / "set", header(), PLAN)


@pytest.mark.parametrize("row", [{"id": "0"}, {}, {"id": True}, {"id": 1, "x": {1}}])
def test_a_plan_that_is_none_is_refused(tmp_path: Path, row: Any) -> None:
    with pytest.raises(UserError, match=r"row 2 of the plan"):
        Writer(tmp_path / "set", header(), [{"id": 3}, row])
    assert not is_dataset(tmp_path / "set")


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"name": "other"}, 'begun with name "some", now it is "other"'),
        ({"image": (7, 9)}, r"begun with image \[9, 7\], now it is \[7, 9\]"),
        ({"dome_radius_mm": None}, "begun with dome_radius_mm 20.0, now it is null"),
        ({"sensor": {"name": "noise", "gain": 2}}, "begun with sensor.gain null, now it is 2"),
    ],
)
def test_other_settings_are_refused(open_set: Path, keys: Any, says: str) -> None:
    with pytest.raises(UserError, match=says):
        Writer(open_set, header(**keys))
    Writer(open_set, header()).leave_open()


def test_folders_that_take_no_writer(closed_set: Path, open_set: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is closed: it holds 4 samples"):
        Writer(closed_set, header())
    with (
        Writer(open_set, header()),
        pytest.raises(UserError, match="is being written by another process"),
    ):
        Writer(open_set, header())
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    with pytest.raises(UserError, match=r"not empty \(notes.txt is there\)"):
        Writer(tmp_path / "mine", header())


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"id": -1}, "id is -1"),
        ({"extra": {"a": {1, 2}}}, "sample 8 cannot be written"),
        ({"scene": Scene(Indenter.single(), Pose(math.nan))}, "sample 8"),
        ({"signal": np.zeros((9, 8), np.uint8)}, r"sample 8 .*shape \(9, 8\) and type uint8"),
        ({"signal": np.zeros((9, 7), np.float32)}, "type float32"),
        ({"signal": b"no picture"}, "not a PNG"),
        ({"signal": png(np.zeros((9, 7), np.uint16))}, "not an 8-bit 9x7 gray PNG without alpha"),
        ({"signal": png(np.zeros((9, 8), np.uint8))}, "not an 8-bit 9x7 gray PNG without alpha"),
    ],
)
def test_what_cannot_come_back_is_refused_and_leaves_nothing(
    tmp_path: Path, keys: dict[str, Any], says: str
) -> None:
    with Writer(tmp_path / "set", header()) as writer:
        with pytest.raises(UserError, match=says):
            writer.add_many([draft(0), Draft(**{"signal": image(0), "id": 8, **keys})])
        assert writer.done == set()
        writer.add(draft(0))
    assert verify(tmp_path / "set") == []


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        (np.zeros(14, np.float32), r"shape \(14,\)"),
        (np.full(15, 1e300), "no finite number"),
        (np.array(["a"] * 15), "type <U1"),
    ],
)
def test_channels_unlike_the_others_are_refused(skin: Path, signal: Any, says: str) -> None:
    with Writer(skin, skin_header()) as writer, pytest.raises(UserError, match=says):
        writer.add_many([skin_draft(2), Draft(signal, 3)])
    assert [sample.id for sample in open_dataset(skin).samples] == [0, 1]
    assert verify(skin) == []


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"dome_radius_mm": -1.0}, "'dome_radius_mm' is -1.0"),
        ({"sensor": {"gain": float("nan")}}, "cannot be written"),
        ({"image": None}, "exactly one of 'image' and 'signal'"),
    ],
)
def test_a_header_that_could_not_be_read_again_is_refused(
    tmp_path: Path, keys: dict[str, Any], says: str
) -> None:
    with pytest.raises(UserError, match=f"the header of the data set.*{says}"):
        Writer(tmp_path / "set", header(**keys))
    assert not is_dataset(tmp_path / "set")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"schema_version": 1', '"schema_version": 0', "e6a49ac9 reads data sets of an older form"),
        ('"image"', '"picture"', "unknown key 'picture'"),
        ('"status": "closed"', '"status": "done"', "key 'status' is 'done'"),
        ('"dome_radius_mm": 20.0', '"dome_radius_mm": 0.0', "'dome_radius_mm' is 0.0"),
        ("{", "[", "cannot be read as JSON"),
    ],
)
def test_a_damaged_header_is_named(closed_set: Path, old: str, new: str, says: str) -> None:
    path = closed_set / "dataset.json"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        open_dataset(closed_set)
    assert f"{path}" in str(caught.value)
    assert says in str(caught.value)


def test_no_data_set(tmp_path: Path) -> None:
    for work in (open_dataset, verify):
        with pytest.raises(UserError, match=r"is no data set: it holds no dataset\.json"):
            work(tmp_path)


def test_truncation_at_every_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole lines are read, reading changes nothing, and writing goes on to the same files."""
    monkeypatch.setattr(os, "fsync", lambda _: None)  # some thousand of them, on any disk
    folder = tmp_path / "set"
    drafts = [Draft(image(number), number, press="ü€𝄞") for number in range(2)]
    writer = Writer(folder, header())
    writer.add_many(drafts)
    writer.leave_open()
    whole = files(folder)
    journal = (folder / "metadata.jsonl").read_bytes()
    assert any(byte > 127 for byte in journal)  # some cuts fall inside a character
    ends = [i + 1 for i, byte in enumerate(journal) if byte == ord("\n")]
    for size in range(len(journal) + 1):
        (folder / "metadata.jsonl").write_bytes(journal[:size])
        kept = sum(end <= size for end in ends)
        assert [sample.id for sample in open_dataset(folder).samples] == list(range(kept))
        assert (folder / "metadata.jsonl").stat().st_size == size
        if size % 41 == 0:
            with Writer(folder, header()) as writer:
                assert writer.done == set(range(kept))
                assert len(list((folder / "images").rglob("*.png"))) == kept
                writer.add_many(drafts[kept:])
                writer.leave_open()
            assert files(folder) == whole


@settings(max_examples=15, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_any_last_bytes_are_cut_off(open_set: Path, data: st.DataObject) -> None:
    journal = open_set / "metadata.jsonl"
    before = journal.read_bytes()
    junk = data.draw(st.binary(min_size=1, max_size=20).filter(lambda junk: b"\n" not in junk))
    end = data.draw(st.sampled_from([b"", b"\n"]))
    journal.write_bytes(before + junk + end)
    assert len(open_dataset(open_set).samples) == 4
    Writer(open_set, header()).leave_open()
    assert journal.read_bytes() == before


@pytest.mark.parametrize("kept", [0, 30, 60, 61])
def test_a_row_that_no_line_acknowledges_is_cut_off(skin: Path, kept: int) -> None:
    """A crash between the channels and the journal leaves some of the new row's 60 bytes."""
    with (skin / "channels.f32").open("ab") as file:
        file.write((np.asarray(skin_draft(2).signal).tobytes() + b"\0")[:kept])
    assert verify(skin) == []
    with Writer(skin, skin_header()) as writer:
        assert (skin / "channels.f32").stat().st_size == 2 * 60
        writer.add(skin_draft(2))
    dataset = open_dataset(skin)
    assert [sample.id for sample in dataset.samples] == [0, 1, 2]
    assert np.array_equal(dataset.signal(dataset.samples[2]), skin_draft(2).signal)
    assert verify(skin) == []


def test_what_an_interrupted_writer_left_is_removed_and_nothing_else(open_set: Path) -> None:
    (open_set / "images/000000/photo.png").write_bytes(b"mine")
    before = files(open_set)
    (open_set / "images/000000/000009.png").write_bytes(b"orphan")
    (open_set / "images/000000/.000008.png.part").write_bytes(b"half")
    Writer(open_set, header()).leave_open()
    assert files(open_set) == before


def test_a_full_disk_loses_nothing_that_was_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second line does not fit: it is taken back, and the first one stays."""
    folder, write = tmp_path / "set", os.write
    with Writer(folder, header()) as writer:
        writer.add(draft(0))
        monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:10]))
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            writer.add(draft(1))
        monkeypatch.undo()
        with pytest.raises(UserError, match="is closed"):
            writer.add(draft(2))
    with Writer(folder, header()) as writer:
        assert writer.done == {0}
        writer.add(draft(1))
    assert verify(folder) == []


def test_the_order_of_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Image synced, renamed, its folder synced, line written, journal synced."""
    if not Path("/proc/self/fd").is_dir():
        pytest.skip("this system does not say what a file's name is")
    steps: list[str] = []
    fsync, replace, write = os.fsync, Path.replace, os.write

    def named(file: int) -> str:
        return Path(f"/proc/self/fd/{file}").readlink().name

    with Writer(tmp_path / "set", header()) as writer:
        writer.add(draft(0))
        monkeypatch.setattr(os, "fsync", lambda f: (steps.append(f"sync {named(f)}"), fsync(f))[1])
        monkeypatch.setattr(Path, "replace", lambda *p: (steps.append("rename"), replace(*p))[1])
        monkeypatch.setattr(os, "write", lambda *a: (steps.append("line"), write(*a))[1])
        writer.add(draft(1))
        monkeypatch.undo()
    expected = ["sync .000001.png.part", "rename", "sync 000000", "line", "sync metadata.jsonl"]
    assert steps == expected


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b'{"file_name"', b'"file_name"', "line {}: "),
        (b'"depth_mm": 1.5', b'"depth_mm": NaN', "line {}: "),
        (b'"depth_mm": 1.5', b'"depht_mm": 1.5', "line {}: unknown key 'depht_mm'"),
        (b'"x_mm"', b'"dx_mm"', "line {}: the key 'x_mm' is missing"),
        (b"images/000000/00", b"images/../../00", "line {}: file_name is 'images/../../00"),
        (b'"indenter": "dual", ', b"", "line {}: a pose needs the key 'indenter'"),
        (b'"indenter_radius_mm": 3.0', b'"indenter_radius_mm": -3.0', "line {}: an indenter's"),
    ],
)
def test_a_garbled_line_is_named_and_refused(
    open_set: Path, old: bytes, new: bytes, says: str
) -> None:
    path = open_set / "metadata.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    for number in (1, 3):
        changed = list(lines)
        assert old in lines[number - 1]
        changed[number - 1] = changed[number - 1].replace(old, new)
        path.write_bytes(b"".join(changed))
        for work in (
            lambda: list(open_dataset(open_set).samples),
            lambda: Writer(open_set, header()),
        ):
            with pytest.raises(UserError) as caught:
                work()
            assert f"{path} {says.format(number)}" in str(caught.value)
        assert path.read_bytes() == b"".join(changed)  # nothing was repaired
        assert any(says.format(number) in finding for finding in verify(open_set))


def test_an_id_on_two_lines_is_refused(open_set: Path) -> None:
    path = open_set / "metadata.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines, lines[1]]))
    with pytest.raises(UserError, match=r"metadata\.jsonl line 5 is a second one of id 1"):
        Writer(open_set, header())
    assert any("lines 2 and 5" in finding for finding in verify(open_set))


def test_a_changed_journal_of_a_closed_data_set_is_refused(closed_set: Path) -> None:
    path = closed_set / "metadata.jsonl"
    whole = path.read_bytes()
    for text in (whole[:-5], b"", whole.replace(b'"depth_mm": 1.5', b'"depth_mm": 2.5')):
        path.write_bytes(text)
        with pytest.raises(UserError, match="not what it was when the data set was closed"):
            open_dataset(closed_set)
        assert "was closed (checksum" in " ".join(verify(closed_set))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda f: flip(f / "images/000000/000001.png"), "000001.png"),
        (lambda f: (f / "images/000000/000001.png").unlink(), "000001.png cannot be read"),
        (lambda f: flip(f / "images/reference/rest.png"), "rest.png"),
        (lambda f: (f / "events.jsonl").write_text("?\n{}\n"), "events.jsonl line 1"),
        (lambda f: (f / "metadata.jsonl").unlink(), "metadata.jsonl"),
        (lambda f: (f / "plan.jsonl").write_text('{"id": 0}\n'), "not the plan"),
        (lambda f: (f / "splits").mkdir() or (f / "splits/a.json").write_text("{}"), "a.json"),
    ],
)
def test_damage_is_found(closed_set: Path, damage: Callable[[Path], None], says: str) -> None:
    damage(closed_set)
    before = files(closed_set)
    assert says in " ".join(verify(closed_set))
    assert files(closed_set) == before


def test_every_changed_byte_is_found(closed_set: Path, skin: Path) -> None:
    for path, step in ((closed_set / "images/000000/000003.png", 1), (skin / "channels.f32", 7)):
        for at in range(0, path.stat().st_size, step):
            flip(path, at)
            (finding,) = verify(closed_set if step == 1 else skin)
            row = "" if step == 1 else f" row {at // 60 + 1}"
            assert f"{path.name}{row} was changed" in finding
            flip(path, at)
    for number in (3, 1):
        flip(closed_set / f"images/000000/00000{number}.png")
    assert ["000001.png" in finding for finding in verify(closed_set)] == [True, False]


def test_the_channels_at_rest_are_kept_with_their_hash(skin: Path) -> None:
    events = skin / "events.jsonl"
    event = json.loads(events.read_text())
    event["channels"][4] = 1.0
    events.write_text(json.dumps(event) + "\n")
    (finding,) = verify(skin)
    assert "does not hold the channels at rest" in finding
