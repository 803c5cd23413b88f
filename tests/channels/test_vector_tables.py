"""A folder with one file of labels and one of channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench.datasets import (
    ChannelKind,
    ImportOptions,
    guess_mapping,
    import_folder,
    open_recording,
    read_mapping,
    verify,
    write_mapping,
)

LABELS = np.array([[10.0, 274.0, 5.0, 143.5], [10.5, 274.00003, 5.0, 142.0], [11, 276, 7, 141]])
TIPS = {
    "indenter": "single",
    "surface": "flat",
    "x": "x",
    "y": "-y",
    "depth": "-z",
    "x_zero_mm": 275.0,
    "y_zero_mm": 6.0,
    "offset_mm": 145.0,
}


def write(path: Path, rows: np.ndarray, names: str = "") -> None:
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([*([names] if names else []), *lines]) + "\n")


def folder_of(tmp_path: Path, times: list[float] | None = None) -> Path:
    """Labels t, x, y, z and channels t, a, b, c; of every row a is 100 times its number."""
    folder = tmp_path / "recording"
    folder.mkdir()
    times = [10.001, 10.499, 11.0] if times is None else times
    channels = [[t, 100.0 * k, k + 0.5, 7.0] for k, t in enumerate(times)]
    write(folder / "labels.csv", LABELS, "t,x,y,z")
    write(folder / "field.csv", np.array(channels), "t,a,b,c")
    return folder


def options(**given: object) -> ImportOptions:
    return ImportOptions(**{"channels": "field.csv", "join": "t", **TIPS, **given})  # type: ignore[arg-type]


def test_labels_and_channels_become_presses(tmp_path: Path) -> None:
    recording = open_recording(folder_of(tmp_path), options(press="x,y"))
    assert recording.kind == ChannelKind((3,))
    assert recording.signal_names == ("a", "b", "c")
    poses = [scene.pose for scene in recording.scenes if scene is not None]
    assert [(p.x, p.y, p.depth) for p in poses] == [
        (-1.0, 1.0, 1.5),
        (pytest.approx(-1.0, abs=1e-4), 1.0, 3.0),
        (1.0, -1.0, 4.0),
    ]
    assert recording.presses[0] == recording.presses[1] != recording.presses[2]
    assert recording.dome_radius_mm == np.inf
    assert [note for note in recording.notes if "1 of 3 channels never change: c." in note]
    dataset = import_folder(recording, tmp_path / "set", options())
    assert verify(dataset.folder) == []
    assert [float(dataset.signal(sample)[0]) for sample in dataset.samples] == [0.0, 100.0, 200.0]


def test_rows_in_another_order_are_joined_by_time(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, [11.0, 10.0, 99.0, 10.5])
    recording = open_recording(folder, options())
    assert [float(recording.signal(row)[0]) for row in range(3)] == [100.0, 300.0, 0.0]


@pytest.mark.parametrize(
    ("times", "given", "says"),
    [
        ([10.0, 10.5, 11.2], {}, "row 3: the nearest row of .* is 200 ms away"),
        ([10.0, 10.5], {"join": ""}, "has 3 rows, but .* 2; join them by a time"),
        ([10.0, 10.5, 11.0], {"join": "when"}, "has no column 'when'"),
        ([10.0, 10.5, 11.0], {"channels": "gone.csv"}, "holds no gone.csv; there is field.csv"),
        ([10.0, 10.5, 11.0], {"channels": "../field.csv"}, "lies outside"),
        ([10.0, 10.5, 11.0], {"depth": "depth"}, "has no column 'depth'"),
        ([10.0, 10.5, 11.0], {"channel_columns": "a,d"}, "has no column 'd'"),
        ([10.0, 10.5, 11.0], {"channels": "times.csv"}, "holds no channels"),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    tmp_path: Path, times: list[float], given: dict[str, object], says: str
) -> None:
    folder = folder_of(tmp_path, times)
    (tmp_path / "field.csv").write_text("a\n1\n")
    (folder / "times.csv").write_text("t\n10\n")
    with pytest.raises(UserError, match=says):
        import_folder(folder, tmp_path / "set", options(table="labels.csv", **given))
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("bad", ["nan", "", "x"])
def test_a_channel_that_is_no_number_is_named(tmp_path: Path, bad: str) -> None:
    folder = folder_of(tmp_path)
    text = (folder / "field.csv").read_text().replace("100.000000", bad)
    (folder / "field.csv").write_text(text)
    with pytest.raises(UserError, match=r"field\.csv row 2: a is"):
        open_recording(folder, options())


def test_a_channel_at_its_limit_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "many"
    folder.mkdir()
    rng = np.random.default_rng(3)
    values = rng.normal(size=(400, 2))
    values[:, 1] = np.minimum(values[:, 1], 1.0)
    write(folder / "labels.csv", rng.uniform(1, 4, (400, 3)), "x,y,z")
    write(folder / "field.csv", values, "good,clipped")
    recording = open_recording(folder, options(join=""))
    (note,) = [note for note in recording.notes if "limit" in note]
    assert note.startswith("1 of 2 channels stand at a limit in up to 1")
    assert note.endswith(": clipped.")


def test_a_file_without_a_header_has_numbered_columns(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    write(folder / "labels.csv", LABELS)
    names = {"x": "column_2", "y": "-column_3", "depth": "-column_4"}
    recording = open_recording(folder, options(join="column_1", channels_time="t", **names))
    assert len(recording) == 3
    assert "labels.csv has no header line; its columns are column_1 to column_4." in recording.notes


def test_archives_of_numpy(tmp_path: Path) -> None:
    folder = tmp_path / "archives"
    folder.mkdir()
    taxels = np.arange(3 * 8, dtype=np.float32).reshape(3, 4, 2)
    np.savez(folder / "labels.npz", **dict(zip("txyz", LABELS.T, strict=True)))
    np.savez(folder / "taxels.npz", t=LABELS[::-1, 0], force=taxels)
    given = options(table="labels.npz", channels="taxels.npz")
    recording = open_recording(folder, given)
    assert recording.kind == ChannelKind((4, 2))
    assert np.array_equal(recording.signal(0), taxels[2])
    dataset = import_folder(recording, tmp_path / "set", given)
    assert np.array_equal(dataset.signal(dataset.samples[0]), taxels[2])
    guess = guess_mapping(folder, ["channels=taxels.npz", "table=labels.npz", "depth=-z"])
    assert (guess.options["x"], guess.options["offset_mm"]) == ("x", "143.5")


@pytest.mark.parametrize(
    ("arrays", "join", "says"),
    [
        ({"t": np.array([object()])}, "t", "holds no arrays of numbers"),
        ({}, "t", "holds no arrays of numbers"),
        ({"t": LABELS[:, 0]}, "t", "holds no channels"),
        ({"t": np.arange(5.0), "v": np.ones((3, 2))}, "t", r"no channels.*left out.*v \(3, 2\)"),
        ({"t": np.array([10.0, np.nan, 11]), "v": np.ones((3, 2))}, "t", "finite number"),
    ],
)
def test_archives_that_hold_no_channels(
    tmp_path: Path, arrays: dict[str, np.ndarray], join: str, says: str
) -> None:
    folder = folder_of(tmp_path)
    np.savez(folder / "taxels.npz", **arrays)
    with pytest.raises(UserError, match=says):
        open_recording(folder, options(table="labels.csv", channels="taxels.npz", join=join))


def places(tmp_path: Path, points: np.ndarray) -> tuple[str, ...]:
    """Return the press of every point, of a folder whose presses are places."""
    folder = tmp_path / "places"
    folder.mkdir(exist_ok=True)
    write(folder / "labels.csv", np.column_stack([points, np.full(len(points), 143.0)]), "x,y,z")
    write(folder / "field.csv", np.random.default_rng(2).normal(size=(len(points), 2)), "a,b")
    return open_recording(folder, options(join="", press="x,y")).presses


def test_places_are_told_apart_however_many_there_are(tmp_path: Path) -> None:
    """Thousands of random places have near neighbours along x and along y, but not along both."""
    points = np.random.default_rng(5).uniform(-6, 6, (800, 2))
    presses = places(tmp_path, points)
    gap = np.abs(points[:, None] - points[None]).max(axis=2)
    np.fill_diagonal(gap, np.inf)
    alone = gap.min(axis=1) > 0.0101
    assert alone.mean() > 0.95
    names = np.array(presses)[alone]
    assert len(set(names)) == len(names)


def test_a_place_that_is_come_back_to_is_one_press(tmp_path: Path) -> None:
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0)), axis=2).reshape(-1, 2)
    jitter = np.random.default_rng(6).uniform(-0.002, 0.002, (5, *grid.shape))
    presses = np.array(places(tmp_path, (grid + jitter).reshape(-1, 2))).reshape(5, -1)
    assert (presses == presses[0]).all()
    assert len(set(presses[0])) == len(grid)


def test_columns_beside_channels_are_guessed(tmp_path: Path) -> None:
    folder = tmp_path / "skin"
    folder.mkdir()
    labels = np.column_stack([np.random.default_rng(1).uniform(-5, 5, (9, 2)), np.arange(9.0)])
    write(folder / "poses.csv", labels, "stage_x,stage_y,indentation")
    write(folder / "field.csv", labels, "a,b,c")
    guess = guess_mapping(folder, ["channels=field.csv"])
    expected = {"x": "stage_x", "y": "stage_y", "depth": "indentation", "surface": "flat"}
    assert expected.items() <= guess.options.items()
    mapping = tmp_path / "skin.toml"
    write_mapping(mapping, guess)
    assert len(open_recording(folder, read_mapping(mapping))) == 9
    assert guess_mapping(folder).options == {**guess.options, "channels": "field.csv"}
    write(folder / "more.csv", labels, "a,b,c")
    with pytest.raises(UserError, match=r"--param channels=FILE \(channels=field.csv, more.csv\)"):
        guess_mapping(folder)
