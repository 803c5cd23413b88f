"""Channels in a data set: what was written comes back, a crash loses nothing, damage is found."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    CHANNEL_FILE,
    Draft,
    Header,
    Writer,
    export_dataset,
    open_dataset,
    verify,
)

SHAPES = [(15,), (1,), (4, 3)]
CHANNELS = CHANNEL_FILE


def header(shape: tuple[int, ...] = (15,)) -> Header:
    return Header("skin", {"name": "skin"}, signal=shape, dome_radius_mm=math.inf)


def draft(number: int, shape: tuple[int, ...] = (15,)) -> Draft:
    values = np.random.default_rng(number).normal(0, 1e3, shape).astype(np.float32)
    scene = Scene(Indenter.single(), Pose(0.5 * number, depth=2.0))
    return Draft(values, number, scene, {"z": float(number)}, f"place-{number // 2}")


def written(folder: Path, count: int = 5, shape: tuple[int, ...] = (15,)) -> Path:
    with Writer(folder, header(shape)) as writer:
        writer.reference(np.zeros(shape, np.float32))
        writer.add_many([draft(number, shape) for number in range(count)])
    return folder


@pytest.mark.parametrize("shape", SHAPES)
def test_samples_come_back_to_the_last_bit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    dataset = open_dataset(written(tmp_path / "set", shape=shape))
    for sample in dataset.samples:
        signal = dataset.signal(sample)
        assert signal.dtype == np.float32
        assert signal.tobytes() == np.asarray(draft(sample.id, shape).signal).tobytes()
    assert dataset.rest is not None
    assert dataset.rest.shape == shape
    assert verify(dataset.folder) == []
    plain = np.fromfile(dataset.folder / CHANNELS, "<f4").reshape(-1, *shape)
    assert np.array_equal(plain[3], dataset.signal(dataset.samples[3]))
    with pytest.raises(UserError, match="no images"):
        dataset.image(dataset.samples[0])


@pytest.mark.parametrize("kept", [0, 1, 30, 59, 60, 61])
def test_a_row_that_no_line_acknowledges_is_cut_off(tmp_path: Path, kept: int) -> None:
    """A crash between the channels and the journal leaves some of the new row's 60 bytes."""
    folder = tmp_path / "set"
    writer = Writer(folder, header())
    writer.add_many([draft(0), draft(1)])
    writer.leave_open()
    behind = np.asarray(draft(2).signal).tobytes() + b"\0"
    with (folder / CHANNELS).open("ab") as file:
        file.write(behind[:kept])
    assert (verify(folder) != []) == (kept > 0)
    dataset = open_dataset(folder)
    assert bool(dataset.repaired) == (kept > 0)
    assert (folder / CHANNELS).stat().st_size == 2 * 60
    with Writer(folder, header()) as writer:
        writer.add(draft(2))
    dataset = open_dataset(folder)
    assert [sample.id for sample in dataset.samples] == [0, 1, 2]
    assert np.array_equal(dataset.signal(dataset.samples[2]), draft(2).signal)
    assert verify(folder) == []


def test_a_torn_line_takes_its_row_along(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    writer = Writer(folder, header())
    writer.add_many([draft(0), draft(1)])
    writer.leave_open()
    journal = folder / "metadata.jsonl"
    journal.write_bytes(journal.read_bytes()[:-7])
    dataset = open_dataset(folder)
    assert [sample.id for sample in dataset.samples] == [0]
    assert (folder / CHANNELS).stat().st_size == 60
    assert verify(folder) == []


def test_every_changed_byte_is_found(tmp_path: Path) -> None:
    folder = written(tmp_path / "set", 2)
    whole = (folder / CHANNELS).read_bytes()
    for place in range(0, len(whole), 7):
        changed = bytearray(whole)
        changed[place] ^= 1
        (folder / CHANNELS).write_bytes(changed)
        (finding,) = verify(folder)
        assert f"row {place // 60 + 1} was changed" in finding
    (folder / CHANNELS).write_bytes(whole[:-1])
    (finding,) = verify(folder)
    assert "row 2 was changed" in finding


def test_the_rest_is_kept_with_its_hash(tmp_path: Path) -> None:
    folder = written(tmp_path / "set", 1)
    events = folder / "events.jsonl"
    event = json.loads(events.read_text())
    event["channels"][4] = 1.0
    events.write_text(json.dumps(event) + "\n")
    finding, changed = verify(folder)
    assert "does not hold the channels at rest" in finding
    assert "events.jsonl is not what it was when the data set was closed" in changed


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        (np.zeros(14, np.float32), r"shape \(14,\)"),
        (np.zeros((4, 4), np.uint8), r"shape \(4, 4\)"),
        (np.full(15, np.nan, np.float32), "no finite number"),
        (np.full(15, 1e300), "no finite number"),
        (np.array(["a"] * 15), "type <U1"),
    ],
)
def test_a_frame_unlike_the_others_is_refused_and_nothing_is_written(
    tmp_path: Path, signal: np.ndarray, says: str
) -> None:
    with Writer(tmp_path / "set", header()) as writer:
        writer.add(draft(0))
        with pytest.raises(UserError, match=says):
            writer.add_many([draft(1), Draft(signal, 2)])
    assert [sample.id for sample in open_dataset(tmp_path / "set").samples] == [0]
    assert verify(tmp_path / "set") == []


def test_a_header_says_what_its_samples_are(tmp_path: Path) -> None:
    for wrong in (Header("x", {}), Header("x", {}, (4, 4), signal=(3,))):
        with pytest.raises(UserError, match="exactly one of 'image' and 'signal'"):
            Writer(tmp_path / "set", wrong)


def test_data_sets_of_images_have_no_new_key(tmp_path: Path) -> None:
    with Writer(tmp_path / "set", Header("x", {}, (4, 4))):
        pass
    assert not {"signal", "signal_names"} & set(
        json.loads((tmp_path / "set" / "dataset.json").read_text())
    )


def test_exports(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    dataset = open_dataset(written(tmp_path / "set"))
    export_dataset(dataset, tmp_path / "parquet", "hf-parquet")
    (file,) = (tmp_path / "parquet" / "data").iterdir()
    table = pq.read_table(file).to_pydict()
    assert np.array_equal(table["channels"][2], np.asarray(draft(2).signal))
    assert np.array_equal(np.load(tmp_path / "parquet" / "rest.npy"), np.zeros(15))
    with pytest.raises(UserError, match="no images"):
        export_dataset(dataset, tmp_path / "bristol", "bristol")
    assert not (tmp_path / "bristol").exists()
    export_dataset(dataset, tmp_path / "README.md", "card")
    card = (tmp_path / "README.md").read_text()
    assert "15 channels (float32)" in card
    assert "reshape(-1, 15)" in card
