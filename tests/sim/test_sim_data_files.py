"""Every data file of the simulator has a checksum: damage and other content are refused."""

from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench_sim import data_file, instances
from tactibench_sim.mechanics import drag_tables, tip_tables
from tactibench_sim.mechanics import tables as dome_tables
from tactibench_sim.planar import mechanics as planar
from tactibench_sim.real import plate
from tactibench_sim.reference_frames import scenes as reference

READERS = {
    "mechanics/dome.npz": dome_tables,
    "mechanics/tips.npz": tip_tables,
    "domes.npz": instances,
    "planar/pad.npz": planar,
    "reference_frames/scenes.npz": reference,
    "reference_frames/other_tips.npz": reference,
    "reference_frames/sideways.npz": reference,
    "mechanics/drag.npz": drag_tables,
    "real/plates.npz": plate,
}
PACKAGE = Path(str(files("tactibench_sim")))


@cache
def shipped(name):
    """Bytes and content of a file."""
    path = PACKAGE / name
    with np.load(path) as archive:
        return path.read_bytes(), dict(archive)


@pytest.fixture(params=READERS)
def made(request, tmp_path):
    """(reader, bytes of the shipped file, its content, a path to write to)."""
    return READERS[request.param].read, *shipped(request.param), tmp_path / "copy.npz"


def test_every_data_file_that_ships_is_here():
    assert set(PACKAGE.rglob("*.npz")) == {PACKAGE / name for name in READERS}


def test_a_copy_reads(made):
    read, whole, _, path = made
    path.write_bytes(whole)
    read(path)


def test_a_missing_file_is_refused(made):
    read, *_, path = made
    with pytest.raises(UserError, match=r"cannot be read \(FileNotFoundError\).*reinstall"):
        read(path)


@pytest.mark.parametrize("keep", [0.0, 1e-4, 0.5, 0.999])
def test_a_truncated_file_is_refused(made, keep):
    read, whole, _, path = made
    path.write_bytes(whole[: round(keep * len(whole))])
    with pytest.raises(UserError, match=r"cannot be read.*reinstall"):
        read(path)


def test_a_text_is_refused(made):
    read, *_, path = made
    path.write_bytes(b"no archive at all")
    with pytest.raises(UserError, match=r"cannot be read.*reinstall"):
        read(path)


@pytest.mark.parametrize("place", [0.1, 0.3, 0.6, 0.9])
def test_a_file_with_a_spoilt_stretch_is_refused(made, place):
    read, whole, _, path = made
    start = round(place * len(whole))
    spoilt = bytes(byte ^ 0xFF for byte in whole[start : start + 64])
    path.write_bytes(whole[:start] + spoilt + whole[start + 64 :])
    with pytest.raises(UserError, match=r"cannot be read.*reinstall"):
        read(path)


def test_a_changed_array_is_refused(made):
    read, _, content, path = made
    names = sorted(set(content) - {"parameters", "sha256"})
    for name in (names[0], names[len(names) // 2], names[-1]):
        array = content[name].copy()
        array.flat[0] += 1
        np.savez(path, **{**content, name: array})
        with pytest.raises(UserError, match=r"does not fit its own hash.*reinstall"):
            read(path)


@pytest.mark.parametrize("change", ["parameters", "sha256"])
def test_changed_parameters_or_another_digest_are_refused(made, change):
    read, _, content, path = made
    text = str(content[change])
    text = text.replace("{", '{"more": 1, ') if change == "parameters" else text[::-1]
    np.savez(path, **{**content, change: np.array(text)})
    with pytest.raises(UserError, match=r"does not fit its own hash.*reinstall"):
        read(path)


@pytest.mark.parametrize("without", ["parameters", "sha256"])
def test_a_file_without_a_checksum_is_refused(made, without):
    read, _, content, path = made
    np.savez(path, **{name: array for name, array in content.items() if name != without})
    with pytest.raises(UserError, match=r"cannot be read \(KeyError\).*reinstall"):
        read(path)


def test_a_file_of_another_version_is_refused(made):
    """One that fits its hash but holds something else."""
    read, *_, path = made
    data_file.write(path, {"depths": np.arange(3.0)}, {"made": "earlier"})
    with pytest.raises(UserError, match=r"cannot be read \(KeyError\).*reinstall"):
        read(path)


def test_nothing_pickled_is_loaded(made):
    read, _, content, path = made
    np.savez(path, **{**content, "more": np.array([{}], dtype=object)})
    with pytest.raises(UserError, match=r"cannot be read \(ValueError\)"):
        read(path)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("mechanics/dome.npz", "scripts/fem/tabulate_dome.py"),
        ("domes.npz", "scripts/fem/tabulate_instances.py"),
        ("planar/pad.npz", "scripts/fem/tabulate_pad.py"),
    ],
)
def test_a_refusal_says_how_to_make_the_file_again(tmp_path, name, remedy):
    with pytest.raises(UserError, match=remedy):
        READERS[name].read(tmp_path / "none.npz")


def test_writing_and_reading_agree(tmp_path):
    path, arrays = tmp_path / "some.npz", {"b": np.arange(6.0).reshape(2, 3), "a": np.zeros(0)}
    digest = data_file.write(path, arrays, {"two": 2, "one": [1.5, None]})
    made = data_file.DataFile("", "", "some", lambda *parts: parts)
    found, parameters, told = made.read(path)
    assert told == digest
    assert parameters == {"one": [1.5, None], "two": 2}
    assert set(found) == set(arrays)
    assert all(found[name].shape == arrays[name].shape for name in arrays)
    assert list(tmp_path.iterdir()) == [path]


def test_the_digest_tells_names_types_and_shapes_apart():
    one = np.arange(6.0)
    others = [{"b": one}, {"a": one.astype(np.float32)}, {"a": one.reshape(2, 3)}, {"a": -one}]
    digests = {data_file.digest_of(arrays, "{}") for arrays in ({"a": one}, *others)}
    digests.add(data_file.digest_of({"a": one}, "[]"))
    assert len(digests) == 6
    strided = np.stack([one, one], axis=1)[:, 0]
    assert data_file.digest_of({"a": strided}, "{}") == data_file.digest_of({"a": one}, "{}")
