"""Folders as labs leave them: what is read is right, and what cannot be known is one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from messy_labs import Lab, Skin, hovering, imported, press_image

from tactibench import UserError
from tactibench.datasets import (
    ImportOptions,
    check_labels,
    guess_mapping,
    open_recording,
    read_mapping,
    write_mapping,
)


def drawn(lab: Lab, x: Any, y: Any, depth: Any) -> dict[str, Any]:
    """Frames of other presses than the lab drew, and their columns."""
    columns = {n: np.round(v, 3) for n, v in (("x", x), ("y", y), ("depth", depth))}
    lab.x, lab.y, lab.rows = columns["x"], columns["y"], len(x)
    lab.depth = np.maximum(columns["depth"], 0)
    lab.draw(lab.folder)
    return columns


def split_presses(folder: Path, tmp_path: Path, press: Any) -> int:
    """Return how many presses of a folder have frames under several names."""
    guess = guess_mapping(folder)
    path = tmp_path / "map.toml"
    path.unlink(missing_ok=True)
    write_mapping(path, guess)
    names: dict[Any, set[str]] = {}
    for number, name in zip(press, open_recording(folder, read_mapping(path)).presses, strict=True):
        names.setdefault(number, set()).add(name)
    return sum(len(each) > 1 for each in names.values())


def slides(count: int, rows: int, step: float) -> tuple[np.ndarray, ...]:
    """Rows of slides in any direction: number of the slide, x, y and depth."""
    rng = np.random.default_rng(4)
    at, along = np.repeat(np.arange(count), rows), np.tile(np.arange(rows), count) * step
    (x, y), turn = rng.uniform(-4, 4, (2, count)), rng.uniform(0, 6.28, count)
    depth = rng.uniform(0.5, 3, count)[at]
    return at, x[at] + along * np.cos(turn[at]), y[at] + along * np.sin(turn[at]), depth


@pytest.mark.parametrize("name", ["trial", "press"])
def test_a_press_may_be_a_slide_over_the_sensor_and_rows_in_any_order(
    tmp_path: Path, name: str
) -> None:
    lab = Lab(tmp_path / "lab", 1)
    order = np.random.default_rng(0).permutation(240)
    press, *columns = (column[order] for column in slides(24, 10, 0.45))
    lab.table(drawn(lab, *columns) | {name: press})
    assert split_presses(lab.folder, tmp_path, press) == 0


def test_a_few_long_presses_beside_many_short_ones_are_presses(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 1)
    long, short = slides(6, 40, 0.2), slides(40, 3, 0.0)
    order = np.random.default_rng(0).permutation(360)
    press, *columns = (np.concatenate(pair)[order] for pair in zip(long, short, strict=True))
    press[order >= 240] += 6
    lab.table(drawn(lab, *columns) | {"touch": press})
    assert split_presses(lab.folder, tmp_path, press) == 0


def test_notes_on_single_rows_number_no_presses(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 120)
    note = ["ok" if row % 5 < 3 else f"see page {row}" for row in range(120)]
    guess = guess_mapping(lab.table({"x": lab.x, "y": lab.y, "depth": lab.depth, "note": note}))
    assert "press" not in guess.options


def test_seconds_of_a_clock_number_no_presses(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 1)
    press, *columns = slides(12, 8, 0.3)
    secs = 1700000000 + np.arange(96) // 5
    names = drawn(lab, *columns) | {"header.stamp.secs": secs, "swipe": press}
    assert guess_mapping(lab.table(names)).options["press"] == "swipe"


def test_the_folder_of_a_frame_may_be_its_press(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 1)
    press, *columns = slides(12, 6, 0.3)
    names = drawn(lab, *columns)
    for row, number in enumerate(press):
        (lab.folder / f"p{number}").mkdir(exist_ok=True)
        (lab.folder / f"f{row}.png").rename(lab.folder / f"p{number}" / f"{row}.png")
    lab.table({"file": [f"p{number}/{row}.png" for row, number in enumerate(press)]} | names)
    assert guess_mapping(lab.folder).options["press"] == "file start"
    assert split_presses(lab.folder, tmp_path, press) == 0


@pytest.mark.parametrize("lifts", [True, False])
def test_slides_without_a_number_are_those_between_lifts_or_named(
    tmp_path: Path, lifts: bool
) -> None:
    lab = Lab(tmp_path / "lab", 1)
    press, x, y, depth = slides(20, 8, 0.25)
    if lifts:
        depth = np.where(np.arange(160) % 8 < 2, -2.0, depth)
    guess, _ = imported(lab, drawn(lab, x, y, depth), tmp_path)
    recording = open_recording(lab.folder, read_mapping(tmp_path / "guess.toml"))
    touching = depth > 0
    pairs = {*zip(press[touching], np.array(recording.presses)[touching], strict=True)}
    assert "press" not in guess.options
    if lifts:
        assert len(pairs) == 20
    else:
        assert any("--param press=COLUMN" in note for note in recording.notes)


@pytest.mark.parametrize("beside", [{}, {"operator_id": np.arange(60) % 12}], ids=["", "other"])
def test_the_same_place_again_is_that_of_all_tips(tmp_path: Path, beside: dict[str, Any]) -> None:
    """Also where the tips press to other depths the second time."""
    lab = Lab(tmp_path / "lab", 60)
    press = np.tile(np.arange(15), 4)
    rng = np.random.default_rng(5)
    (x1, x2, y1, y2), (d1, d2) = rng.uniform(-5, 5, (4, 15))[:, press], rng.uniform(0.5, 3, (2, 60))
    x1, x2 = x1 / 3 - 4, x2 / 3 + 4
    for row in range(60):
        two = press_image(x1[row], y1[row], d1[row], 6).astype(int)
        two += press_image(x2[row], y2[row], d2[row], 6)
        assert cv2.imwrite(str(lab.folder / f"f{row}.png"), np.clip(two - 20, 0, 255))
    columns = dict(zip(("x1", "y1", "depth1"), (x1, y1, d1), strict=True))
    columns |= dict(zip(("x2", "y2", "depth2"), (x2, y2, d2), strict=True))
    lab.table({name: np.round(values, 4) for name, values in columns.items()} | beside)
    assert "press" not in guess_mapping(lab.folder).options
    assert split_presses(lab.folder, tmp_path, press) == 0
    same_first = np.round(np.repeat(x1[:1], 60), 4), np.round(np.repeat(y1[:1], 60), 4)
    lab.table(columns | dict(zip(("x1", "y1"), same_first, strict=True)))
    write_mapping(tmp_path / "first.toml", guess_mapping(lab.folder, ["indenter=tips"]))
    presses = open_recording(lab.folder, read_mapping(tmp_path / "first.toml")).presses
    assert len(set(presses)) == 15  # although the first tip stays where it is


@pytest.mark.parametrize("share", [0.05, 0.94])
def test_first_touch_does_not_depend_on_how_many_rows_hover(tmp_path: Path, share: float) -> None:
    lab = Lab(tmp_path / "lab", 300)
    lab.rng.shuffle(up := np.arange(300) < share * 300)
    lab.depth = np.where(up, -lab.rng.uniform(0.5, 8, 300), lab.rng.uniform(0.5, 3, 300)).round(3)
    for row in range(300):
        image = press_image(lab.x[row], lab.y[row], max(lab.depth[row], 0), 6)
        assert cv2.imwrite(str(lab.folder / f"f{row}.png"), image)
    guess, poses = imported(lab, {"x": lab.x, "y": lab.y, "z": 120 - lab.depth}, tmp_path)
    assert guess.options["depth"] == "-z"
    assert float(guess.options["offset_mm"]) == pytest.approx(120, abs=0.6)
    assert max(pose.depth for pose, hovers in zip(poses, up, strict=True) if hovers) < 0.3


def test_a_depth_may_count_upward_though_most_rows_hover(tmp_path: Path) -> None:
    lab = hovering(tmp_path / "lab", 0.7)
    guess, poses = imported(lab, {"x": lab.x, "y": lab.y, "depth": -lab.depth}, tmp_path)
    assert guess.options["depth"] == "-depth"
    assert np.allclose([pose.depth for pose in poses], lab.depth)


def test_a_height_that_no_signal_follows_is_asked_for(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 60)
    guess = guess_mapping(lab.table({"x": lab.x, "y": lab.y, "z": lab.depth[::-1]}))
    assert 'depth = "z" or depth = "-z"' in guess.unused["z"]
    crossing = (lab.depth[::-1] - 1.5).round(3)
    guess = guess_mapping(lab.table({"x": lab.x, "y": lab.y, "depth": crossing}))
    assert 'depth = "depth" or depth = "-depth"' in guess.unused["depth"]


@pytest.mark.parametrize(
    ("x", "y", "per_mm"),
    [
        ("x [mm] (sensor 1 frame)", "y [mm] (sensor 1 frame)", 1.0),
        ("x [cm]", "y (sensor 1 frame)", 0.1),
        ("x_cm (filtered)", "y_cm (filtered)", 0.1),
        ('"x (in cm, tool frame)"', '"y (in cm, tool frame)"', 0.1),
        ("x_cm_raw", "y_cm_raw", 0.1),
        ("X\u5750\u6807(\u5398\u7c73)", "Y\u5750\u6807(\u5398\u7c73)", 0.1),
        ("X-Koordinate (Zoll)", "Y-Koordinate (Zoll)", 1 / 25.4),
    ],
)
def test_a_unit_holds_beside_a_remark(tmp_path: Path, x: str, y: str, per_mm: float) -> None:
    lab = Lab(tmp_path / "lab")
    columns = {x: lab.x * per_mm, y: lab.y * per_mm, "depth [mm] (2 mm tip)": lab.depth}
    _, poses = imported(lab, columns, tmp_path)
    assert np.allclose([pose.x for pose in poses], lab.x)
    assert np.allclose([pose.depth for pose in poses], lab.depth)


@pytest.mark.parametrize("name", ["x [m/s]", "x [10 um]", "x (mm^2)"])
def test_another_quantity_or_scale_is_no_length(tmp_path: Path, name: str) -> None:
    lab = Lab(tmp_path / "lab")
    with pytest.raises(UserError, match="no column that is surely x"):
        guess_mapping(lab.table({name: lab.x, name.replace("x", "y"): lab.y, "depth": lab.depth}))


@pytest.mark.parametrize(
    ("depth", "force"), [("Eindringtiefe [mm]", "Kraft [N]"), ("\u6df1\u5ea6", "\u529b(N)")]
)
def test_columns_in_other_languages(tmp_path: Path, depth: str, force: str) -> None:
    lab = Lab(tmp_path / "lab")
    guess = guess_mapping(
        lab.table({"x": lab.x, "y": lab.y, depth: lab.depth, force: lab.depth * 2})
    )
    assert (guess.options["depth"], guess.options["force"]) == (depth, force)


def test_too_few_rows_that_touch_contradict_nothing(tmp_path: Path) -> None:
    """Of four hundred rows ten touch; another ten that are wrong would look the same."""
    skin = Skin(tmp_path / "skin", 400)
    depth = np.where(np.arange(400) % 40 == 0, skin.depth, -skin.depth - 1).round(3)
    taxels = np.where(depth[:, None] > 0, skin.taxels, 0) + skin.rng.normal(0, 0.05, (400, 16))
    header = ",".join(["x", "y", "depth", *(f"s{n}" for n in range(16))])
    skin.write("all.csv", [skin.x, skin.y, depth, taxels.round(4)], header)
    write_mapping(tmp_path / "map.toml", guess_mapping(skin.folder))
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    report = check_labels(recording, recording.scenes, ImportOptions())
    assert (report.presses, report.contradictions) == (0, ())


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("share", [0.05, 0.12, 0.3, 0.8])
def test_first_touch_is_found_however_many_rows_hover(
    tmp_path: Path, share: float, noise: float
) -> None:
    """The signals grow evenly with the depth, to about 1; rows hover up to .3 mm."""
    skin = Skin(tmp_path / "skin", 400)
    hovers = skin.rng.uniform(size=400) < share
    height = 55 - np.where(hovers, -0.1 * skin.depth, skin.depth)
    taxels = skin.taxels * ~hovers[:, None] + skin.rng.normal(0, noise, skin.taxels.shape)
    header = ",".join(["x", "y", "z", *(f"s{n}" for n in range(16))])
    skin.write("all.csv", [skin.x, skin.y, height, taxels], header)
    guess = guess_mapping(skin.folder)
    assert float(guess.options["offset_mm"]) == pytest.approx(55.0, abs=0.25)
    assert "check it" in guess.remarks["offset_mm"]


@pytest.mark.parametrize("form", ["1,234", "1'234", "1.234,5", "1.234"])
def test_separators_of_thousands_are_named(tmp_path: Path, form: str) -> None:
    lab = Lab(tmp_path / "lab")
    um = [f"{value * 1000:,.0f}".replace(",", form[1]) + form[5:] for value in lab.x]
    lab.table({"x [um]": um, "y [um]": um[::-1], "depth [um]": lab.depth * 1000}, ";")
    with pytest.raises(UserError, match=r"row \d+.*(must be a finite number|decimal comma)"):
        guess_mapping(lab.folder)


def test_a_last_number_that_was_cut_off_is_named(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 60)
    depth = [f"{value:.4f}" for value in lab.depth]
    path = lab.table({"x": lab.x, "y": lab.y, "depth": depth}) / "log.csv"
    path.write_text(path.read_text()[:-3])
    with pytest.raises(UserError, match=r"last line has no end.*fewer than 4 decimals"):
        guess_mapping(lab.folder)
    path.write_text(path.read_text() + "\n")
    assert guess_mapping(lab.folder).options["depth"] == "depth"


def test_cells_that_say_that_there_is_nothing(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 60)
    there = np.arange(60) % 4 > 0
    columns = {"x": lab.x, "y": lab.y, "depth": lab.depth}
    for text in ("N/A", "-", "null"):
        for path in tmp_path.glob("*.toml"):
            path.unlink()
        cells = {n: np.where(there, v.astype(str), text) for n, v in columns.items()}
        _, poses = imported(lab, cells, tmp_path)
        assert [pose.depth for pose in poses] == np.where(there, lab.depth, 0).tolist()


@pytest.mark.parametrize("ragged", [False, True])
def test_groups_of_trials_stand_one_behind_the_other(tmp_path: Path, ragged: bool) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    skin = Skin(tmp_path / "skin", 40)
    count = [20 + row * ragged for row in range(40)]
    with h5py.File(skin.folder / "trials.h5", "w") as file:
        for row, rows in enumerate(count):
            group = file.create_group(f"trial_{row:02d}")
            press = np.linspace(0, 1, rows)
            group["taxels"] = press[:, None] * skin.taxels[row]
            group["x"], group["y"] = (np.repeat(v[row], rows) for v in (skin.x, skin.y))
            group["depth"] = press * skin.depth[row]
    guess = guess_mapping(skin.folder)
    assert [guess.options[role] for role in ("x", "depth", "press")] == ["x", "depth", "group"]
    write_mapping(tmp_path / "map.toml", guess)
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    assert len(recording) == sum(count)
    assert len({*zip(np.repeat(range(40), count), recording.presses, strict=True)}) == 40


@pytest.mark.parametrize(("unit", "per_s"), [("ns", 1e9), ("ms", 1e3), ("", 1e9)])
def test_times_of_two_logs_may_be_in_ns(tmp_path: Path, unit: str, per_s: float) -> None:
    skin = Skin(tmp_path / "skin", 120)
    epoch = 0 if unit else 1_690_000_000
    name = f"time_{unit}".rstrip("_")
    time = [f"{(epoch + 0.1 * row) * per_s:.0f}" for row in range(120)]
    header = ",".join([name, *(f"s{n}" for n in range(16))])
    skin.write("skin.csv", [time, skin.taxels.round(6)], header)
    skin.write(
        "pose.csv", [time[::2], skin.x[::2], skin.y[::2], skin.depth[::2]], f"{name},x,y,depth"
    )
    write_mapping(tmp_path / "map.toml", guess_mapping(skin.folder))
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    assert np.allclose([recording.signal(row) for row in range(60)], skin.taxels[::2], atol=1e-5)


def test_a_number_may_name_the_frames_as_well(tmp_path: Path) -> None:
    """A column of numbers fits the names 0.png, 1.png by chance."""
    lab = Lab(tmp_path / "lab", 60)
    for row in range(60):
        (lab.folder / f"f{row}.png").rename(lab.folder / f"{row}.png")
    columns = {"file": [f"{row}.png" for row in range(60)], "swipe": np.arange(60) // 5}
    lab.table(columns | {"x": lab.x, "y": lab.y, "depth": lab.depth})
    assert guess_mapping(lab.folder).options["column"] == "file"


def test_pixels_beside_places_are_no_places(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab")
    pixels = {"cx": (16 + 2 * lab.x).round(1), "cy": (16 + 2 * lab.y).round(1)}
    mm = {"x_mm": lab.x, "y_mm": lab.y, "depth_mm": lab.depth}
    assert guess_mapping(lab.table(mm | pixels)).options["x"] == "x_mm"
    with pytest.raises(UserError, match="x, y or cx, cy may be the places"):
        guess_mapping(lab.table({"x": lab.x, "y": lab.y} | pixels))


def test_the_name_of_a_frame_may_hold_its_press(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 1)
    order = np.random.default_rng(2).permutation(72)
    press, *columns = (column[order] for column in slides(12, 6, 0.3))
    names = drawn(lab, *columns)
    files = [f"press{number:02d}_{row}.png" for row, number in enumerate(press)]
    for row, file in enumerate(files):
        (lab.folder / f"f{row}.png").rename(lab.folder / file)
    lab.table({"file": files} | names)
    assert split_presses(lab.folder, tmp_path, press) == 0


def test_passes_over_all_places_are_no_presses(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 1)
    rng = np.random.default_rng(3)
    place = np.tile(np.arange(12), 10)
    (x, y), depth = rng.uniform(-6, 6, (2, 12))[:, place], rng.uniform(0.5, 3, 120)
    lab.table(drawn(lab, x, y, depth) | {"rep": np.repeat(np.arange(10), 12)})
    assert "session" in guess_mapping(lab.folder).unused["rep"]
    assert split_presses(lab.folder, tmp_path, place) == 0
    path = lab.folder / "log.csv"
    path.write_text(path.read_text() + ",,,,\n,,,,\n")  # as a spreadsheet leaves them
    assert split_presses(lab.folder, tmp_path, place) == 0


def test_a_depth_may_be_counted_from_far_above(tmp_path: Path) -> None:
    lab = hovering(tmp_path / "lab", 0.3)
    guess, poses = imported(lab, {"x": lab.x, "y": lab.y, "depth": 10 + lab.depth}, tmp_path)
    assert float(guess.options["offset_mm"]) == pytest.approx(-10, abs=0.4)
    assert "check it" in guess.remarks["offset_mm"]
    assert max(p.depth for p, d in zip(poses, lab.depth, strict=True) if d < 0) < 0.3


def test_a_second_tip_may_seldom_press(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 60)
    one = {"x1": lab.x, "y1": lab.y, "depth1": lab.depth}
    two = {"x2": -lab.x, "y2": lab.y[::-1], "depth2": lab.depth[::-1]}
    seldom = {n: np.where(np.arange(60) % 3 > 0, "", v.astype(str)) for n, v in two.items()}
    guess = guess_mapping(lab.table(one | seldom))
    assert (guess.options["indenter"], guess.options["x"]) == ("tips", "x1,x2")
