"""Going on with a data set, and what is refused."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_data_sets import draft, header, image

from tactibench import UserError
from tactibench.datasets import Draft, Header, Journal, Writer, is_dataset, open_dataset, verify

PLAN = [{"id": number, "depth_mm": 0.5 * number} for number in range(5)]


def test_writing_goes_on_where_it_was(open_set: Path) -> None:
    with Writer(open_set, header()) as writer:
        assert writer.done == {0, 1, 2, 3}
        with pytest.raises(UserError, match="has a sample 2 already"):
            writer.add_many([draft(4), draft(2)])
        with pytest.raises(UserError, match="has a sample 5 already"):
            writer.add_many([draft(5), draft(5)])
        assert writer.done == {0, 1, 2, 3}
        writer.add_many([draft(5), draft(4)])
    assert [sample.id for sample in open_dataset(open_set).samples] == [0, 1, 2, 3, 5, 4]
    assert verify(open_set) == []


def test_a_type_stays_the_same_after_an_interruption(open_set: Path) -> None:
    with Writer(open_set, header()) as writer, pytest.raises(UserError, match=r"extra\.n holds"):
        writer.add(Draft(image(9), id=9, extra={"n": 1.5}))


def test_an_exception_leaves_the_data_set_open(tmp_path: Path) -> None:
    def stopped(writer: Writer) -> None:
        with writer:
            writer.add_many([draft(0)])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped(Writer(tmp_path / "set", header()))
    dataset = open_dataset(tmp_path / "set")
    assert (dataset.header.status, len(dataset.samples)) == ("open", 1)
    assert not (tmp_path / "set/.lock").exists()


def test_it_stays_open_until_the_plan_is_done(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header(), PLAN) as writer:
        writer.add_many([draft(0), draft(3)])
        with pytest.raises(UserError, match="no id 7 in its plan"):
            writer.add_many([draft(7)])
    assert open_dataset(folder).header.status == "open"
    with Writer(folder, header(), PLAN) as writer:
        writer.add_many([draft(number) for number in (1, 2, 4)])
    dataset = open_dataset(folder)
    assert dataset.header.status == "closed"
    assert list(dataset.plan()) == PLAN
    assert verify(folder) == []


@pytest.mark.parametrize("plan", [[], PLAN[:-1], [*PLAN[:-1], {"id": 4, "depth_mm": 9.0}]])
def test_another_plan_is_refused(tmp_path: Path, plan: Any) -> None:
    Writer(tmp_path / "set", header(), PLAN).leave_open()
    with pytest.raises(UserError, match="begun with plan_sha256"):
        Writer(tmp_path / "set", header(), plan)


def test_a_changed_plan_file_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    Writer(folder, header(), PLAN).leave_open()
    (folder / "plan.jsonl").write_text('{"id": 0}\n')
    with pytest.raises(UserError, match=r"plan\.jsonl is not the plan"):
        Writer(folder, header(), PLAN)
    assert any("plan.jsonl is not the plan" in finding for finding in verify(folder))


@pytest.mark.parametrize(
    "plan",
    [
        [{"id": "0"}],
        [{}],
        [{"id": True}],
        [{"id": 1}, {"id": 1}],
        [{"id": 0, "x": {1}}],
        [{"id": 0, "x": float("nan")}],
    ],
)
def test_a_plan_that_is_none_is_refused(tmp_path: Path, plan: Any) -> None:
    with pytest.raises(UserError, match=r"row [12] of the plan"):
        Writer(tmp_path / "set", header(), plan)
    assert not is_dataset(tmp_path / "set")


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"name": "other"}, 'begun with name "some", now it is "other"'),
        ({"image": (7, 9)}, r"begun with image \[9, 7\], now it is \[7, 9\]"),
        ({"channels": 3}, "begun with channels 1, now it is 3"),
        ({"dome_radius_mm": None}, "begun with dome_radius_mm 20.0, now it is null"),
        ({"sensor": {"name": "noise", "gain": 2}}, "begun with sensor.gain null, now it is 2"),
    ],
)
def test_other_settings_are_refused(open_set: Path, keys: Any, says: str) -> None:
    with pytest.raises(UserError, match=says):
        Writer(open_set, header(**keys))
    Writer(open_set, header()).leave_open()


def test_a_closed_data_set_takes_no_more(closed_set: Path) -> None:
    with pytest.raises(UserError, match="is closed: it holds 4 samples"):
        Writer(closed_set, header())


def test_a_folder_with_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UserError, match=r"not empty \(notes.txt is there\)"):
        Writer(tmp_path, header())
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("number", [-1, 0.0, "0", True, np.int64(3)])
def test_an_id_is_a_whole_number_from_0(tmp_path: Path, number: Any) -> None:
    with Writer(tmp_path / "set", header()) as writer:
        if isinstance(number, np.integer):
            assert type(writer.add(Draft(image(0), id=number)).id) is int
        else:
            with pytest.raises(UserError, match="id is"):
                writer.add(Draft(image(0), id=number))


def test_a_closed_writer_takes_nothing(tmp_path: Path) -> None:
    writer = Writer(tmp_path / "set", header())
    writer.close()
    writer.close()
    for work in (
        lambda: writer.add(Draft(image(0), id=0)),
        lambda: writer.event("stop"),
        lambda: writer.reference(image(0)),
        lambda: writer.split("a"),
    ):
        with pytest.raises(UserError, match="is closed"):
            work()


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (np.zeros((9, 8), np.uint8), r"shape \(9, 8\) and type uint8"),
        (np.zeros((9, 7, 3), np.uint8), r"shape \(9, 7, 3\)"),
        (np.zeros((9, 7), np.float32), "type float32"),
        (np.zeros((9, 7), bool), "type bool"),
        (b"no picture", "not a PNG"),
    ],
)
def test_an_image_that_is_not_like_the_others_is_refused(
    tmp_path: Path, array: Any, says: str
) -> None:
    folder = tmp_path / "set"
    with Writer(folder, header()) as writer:
        for group in ([Draft(array, 8)], [draft(0), Draft(array, 8), draft(1)]):
            with pytest.raises(UserError, match=f"the frame of sample 8 .*{says}"):
                writer.add_many(group)
        with pytest.raises(UserError, match="the reference frame"):
            writer.reference(array)
        assert writer.done == set()
    assert [path for path in (folder / "images").rglob("*") if path.is_file()] == []
    assert verify(folder) == []


def test_a_full_disk_loses_nothing_that_was_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second line does not fit: it is taken back, and the first one stays."""
    folder, write = tmp_path / "set", os.write
    with Writer(folder, header()) as writer:
        writer.add_many([draft(0)])
        monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:10]))
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            writer.add_many([draft(1)])
        monkeypatch.undo()
        with pytest.raises(UserError, match="is closed"):
            writer.add_many([draft(2)])
    dataset = open_dataset(folder)
    assert [sample.id for sample in dataset.samples] == [0]
    assert dataset.repaired == ("moved 1 image that no line names to .trash/",)
    assert verify(folder) == []


def test_the_order_of_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Image synced, renamed, its folder synced, line written, journal synced."""
    steps: list[str] = []
    fsync, replace, append = os.fsync, os.replace, Journal.append

    def named(file: int) -> str:
        return Path(f"/proc/self/fd/{file}").readlink().name

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("this system does not say what a file's name is")
    with Writer(tmp_path / "set", header()) as writer:
        writer.add_many([draft(0)])
        monkeypatch.setattr(os, "fsync", lambda f: (steps.append(f"sync {named(f)}"), fsync(f))[1])
        monkeypatch.setattr(os, "replace", lambda *p: (steps.append("rename"), replace(*p))[1])
        monkeypatch.setattr(
            Journal, "append", lambda self, lines: (steps.append("line"), append(self, lines))[1]
        )
        writer.add_many([draft(1)])
        monkeypatch.undo()
    assert steps == [
        "sync .000001.png.part",
        "rename",
        "sync 000000",
        "line",
        "sync metadata.jsonl",
    ]


def test_a_header_that_could_not_be_read_again_is_refused(tmp_path: Path) -> None:
    for keys, says in (
        ({"image": (0, 7)}, "key 'image.1' is 0"),
        ({"channels": 2}, "key 'channels' is 2"),
        ({"dome_radius_mm": -1.0}, "dome_radius_mm is -1.0"),
        ({"sensor": {"gain": float("nan")}}, "cannot be written"),
        ({"source": {"a": {1}}}, "cannot be written"),
    ):
        base: dict[str, Any] = {"name": "x", "sensor": {}, "image": (9, 7)}
        with pytest.raises(UserError, match=f"the header of the data set.*{says}"):
            Writer(tmp_path / "set", Header(**{**base, **keys}))
    assert not is_dataset(tmp_path / "set")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"schema_version": 1', '"schema_version": 2', "schema_version 2, this tactibench reads 1"),
        ('"image"', '"picture"', "unknown key 'picture'"),
        ('"channels": 1', '"channels": "1"', "key 'channels' is '1'"),
        ('"status": "closed"', '"status": "done"', "key 'status' is 'done'"),
        ('"dome_radius_mm": 20.0', '"dome_radius_mm": 0.0', "dome_radius_mm is 0.0"),
        ("{", "[", "not valid JSON"),
    ],
)
def test_a_damaged_header_is_named(closed_set: Path, old: str, new: str, says: str) -> None:
    path = closed_set / "dataset.json"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        open_dataset(closed_set)
    assert f"{path}" in str(caught.value)
    assert says in str(caught.value)


def test_no_data_set(tmp_path: Path) -> None:
    for work in (open_dataset, verify):
        with pytest.raises(UserError, match=r"is no data set: it holds no dataset\.json"):
            work(tmp_path)
    assert not is_dataset(tmp_path)
