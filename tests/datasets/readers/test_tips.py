"""Tables of one, two, three or any number of spherical tips."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import (
    ImportOptions,
    guess_mapping,
    open_recording,
    read_mapping,
    write_mapping,
)
from tactibench.geometry import scene_of_contacts, tip_depths, tip_positions, true_contacts


def folder_of(tmp_path: Path, header: str, rows: Sequence[Sequence[Any]]) -> Path:
    """A folder as a lab has it: log.csv, and the frames in shots/."""
    folder = tmp_path / "lab"
    (folder / "shots").mkdir(parents=True)
    with (folder / "log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["shot", *header.split(",")])
        for number, row in enumerate(rows):
            writer.writerow([f"s{number}.png", *row])
            frame = np.full((8, 8), number, dtype=np.uint8)
            assert cv2.imwrite(str(folder / "shots" / f"s{number}.png"), frame)
    return folder


def scenes(folder: Path, **given: Any) -> tuple[Scene | None, ...]:
    return tuple(open_recording(folder, ImportOptions(column="shot", **given)).scenes)


PAIRS = {"indenter": "dual", "x": "x", "y": "y", "depth": "d", "spacing": "gap", "yaw": "turn"}


def test_a_pair_is_the_press_that_was_drawn(tmp_path: Path) -> None:
    """Numbers that are written in full come back bit by bit; a row without a gap is one tip."""
    rng = np.random.default_rng(3)
    pairs = [
        Scene(Indenter.dual(g), Pose(*rng.uniform(-3, 3, 2), rng.uniform(0, 360), depth=2.5))
        for g in (6.5, 7.1, 12.0)
    ]
    rows: list[Any] = [
        [
            repr(float(s.pose.x)),
            repr(float(s.pose.y)),
            2.5,
            2 * s.indenter.offsets[1][0],
            repr(s.pose.yaw),
        ]
        for s in pairs
    ]
    folder = folder_of(tmp_path, "x,y,d,gap,turn", [*rows, [1, 2, 3, "", ""]])
    single = Scene(Indenter.single(), Pose(1.0, 2.0, depth=3.0))
    assert scenes(folder, **PAIRS) == (*pairs, single)


def test_units_signs_and_zeros_of_a_pair(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "x,y,d,gap,turn,a,b", [[0.101, 0.2, -0.003, 0.008, 0.5, 0, 0.001]])
    (scene,) = scenes(
        folder,
        **{**PAIRS, "depth": "-d", "y": "-y", "yaw": "-turn"},
        heights="a,b",
        unit="m",
        angles="rad",
        x_zero_mm=100.0,
        y_zero_mm=199.0,
        offset_mm=-0.5,
    )
    assert scene is not None
    assert scene.pose == Pose(
        pytest.approx(1.0), pytest.approx(-1.0), pytest.approx(-math.degrees(0.5)), depth=2.5
    )
    assert np.allclose(scene.indenter.offsets, [[-4, 0, 0], [4, 0, 1]])


def test_numbers_in_place_of_columns(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "x,y,d", [[0, 0, 3]])
    given = {**PAIRS, "indenter": "triple", "spacing": "8", "yaw": "30", "heights": "0,1,2"}
    (scene,) = scenes(folder, **given)
    assert scene == Scene(Indenter.triple((0, 1, 2)), Pose(yaw=30.0, depth=3.0))


@pytest.mark.parametrize("dome_radius", [20.0, math.inf])
@pytest.mark.parametrize("count", [1, 5])
def test_a_list_of_contacts_becomes_the_press_that_makes_them(
    dome_radius: float, count: int
) -> None:
    rng = np.random.default_rng(count)
    xy, depth = rng.uniform(-7, 7, (count, 2)), rng.uniform(0.3, 4, count)
    scene = scene_of_contacts(xy, depth, 3.0, dome_radius)
    assert np.allclose(tip_positions(scene)[:, :2], xy, atol=1e-12)
    assert np.allclose(tip_depths(scene, dome_radius), depth, atol=1e-12)
    assert min(z for _, _, z in scene.indenter.offsets) == 0
    assert len(true_contacts(scene, dome_radius)) == count


def test_lists_are_as_long_as_their_cells_are_filled(tmp_path: Path) -> None:
    header = "x1,y1,d1,x2,y2,d2"
    given = {"indenter": "tips", "x": "x1,x2", "y": "y1,y2", "depth": "d1,d2"}
    folder = folder_of(tmp_path, header, [[1, 2, 3, "", "", ""], [-4, 0, 2, 4, 0, 2]])
    one, two = scenes(folder, **given)
    assert one == Scene(Indenter.single(), Pose(1.0, 2.0, depth=3.0))
    assert two == Scene(Indenter.dual(8.0), Pose(depth=2.0))


@pytest.mark.parametrize(
    ("header", "row", "given", "words"),
    [
        ("x,y,d,gap,turn", [0, 0, 1, 8, ""], PAIRS, ["log.csv row 1", "yaw is empty"]),
        ("x,y,d,gap,turn", [0, 0, 1, -8, 0], PAIRS, ["log.csv row 1", "spacing is -8 mm"]),
        ("x,y,d,gap,turn", ["", 0, 1, 8, 0], PAIRS, ["log.csv row 1", "x is ''"]),
        ("x,y,d,gap", [0, 0, 1, 8], PAIRS, ["no column 'turn'"]),
        ("x,y,d,gap,turn", [0, 0, 1, 8, 0], {**PAIRS, "spacing": ""}, ["spacing=COLUMN"]),
        ("x,y,d,gap,turn", [0, 0, 1, 8, 0], {**PAIRS, "heights": "x"}, ["heights names 1", "2"]),
        ("x,y,d", [0, 0, 1], {"indenter": "tips", "x": "x,x", "y": "y", "depth": "d"}, ["2 for x"]),
        (
            "x,y,d",
            [40, 0, 1],
            {"indenter": "tips", "x": "x,x", "y": "y,y", "depth": "d,d"},
            ["row 1", "beside the dome"],
        ),
        (
            "x1,y1,d1,x2,y2,d2",
            [0, 0, 1, 5, "", 1],
            {"indenter": "tips", "x": "x1,x2", "y": "y1,y2", "depth": "d1,d2"},
            ["row 1", "contact 2 lacks"],
        ),
    ],
)
def test_a_mistake_is_named_with_its_row(
    tmp_path: Path, header: str, row: list[Any], given: dict[str, Any], words: list[str]
) -> None:
    folder = folder_of(tmp_path, header, [row])
    with pytest.raises(UserError) as caught:
        scenes(folder, **given)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("header", "row", "found"),
    [
        (
            "X (mm),Y (mm),Indentation",
            [1, 2, 3],
            {"indenter": "single", "x": "X (mm)", "depth": "Indentation", "unit": None},
        ),
        (
            "tip_pos_x_m,tip_pos_y_m,pressDepth_m",
            [0.001, -0.002, -0.003],
            {"x": "tip_pos_x_m", "depth": "-pressDepth_m", "unit": None},
        ),
        ("x,y,z", [101, -2, 143], {"depth": None, "x_zero_mm": "101", "offset_mm": None}),
        (
            "px,py,depth,spacing,yaw",
            [1, 2, 3, 8, 40],
            {"indenter": "dual", "spacing": "spacing", "yaw": "yaw", "angles": "deg"},
        ),
        (
            "x,y,depth,spacing_mm,yaw_deg,height_1_mm,height_2_mm",
            [1, 2, 3, 8, 0, 0, 0.5],
            {"indenter": "dual", "heights": "height_1_mm,height_2_mm"},
        ),
        ("x_px,x_mm,y_mm,depth,force_z", [64, 2, 3, 1, 9], {"x": "x_mm", "depth": "depth"}),
        (
            "x1,y1,z1,x2,y2,z2",
            [0, 0, 1, 5, 0, 2],
            {"indenter": "tips", "x": "x1,x2", "depth": "z1,z2"},
        ),
    ],
)
def test_columns_are_recognised(
    tmp_path: Path, header: str, row: list[Any], found: dict[str, str]
) -> None:
    folder = folder_of(tmp_path, header, [row, row])
    guess = guess_mapping(folder)
    assert {name: guess.options.get(name) for name in found} == found
    assert guess.options["frames"] == "shots"
    path = tmp_path / "map.toml"
    write_mapping(path, guess)
    assert open_recording(folder, read_mapping(path)).scenes[0] is not None
    with pytest.raises(UserError, match="is there already"):
        write_mapping(path, guess)


@pytest.mark.parametrize(
    ("given", "found", "depth"),
    [
        (["depth=-z"], {"depth": "-z", "offset_mm": "145"}, 4.0),
        (["depth=z"], {"depth": "z", "offset_mm": "-141"}, 0.0),
        (["depth=-w"], {"depth": "-w", "offset_mm": None}, 1.0),
        (["depth=w"], {"depth": "w", "offset_mm": "5"}, 4.0),
        (["unit=um"], {"depth": "z", "offset_mm": None}, 0.141),
        (["spacing=8", "depth=z"], {"indenter": "dual", "spacing": "8", "angles": None}, 0.0),
        (["spacing=8", "yaw=0.5", "depth=z"], {"yaw": "0.5", "angles": None}, 0.0),
        (["offset_mm=-140", "depth=z"], {"offset_mm": "-140", "depth": "z"}, 1.0),
    ],
)
def test_what_is_not_said_is_guessed_from_what_is(
    tmp_path: Path, given: list[str], found: dict[str, str | None], depth: float
) -> None:
    """z is the height of a robot, w a depth below 0."""
    folder = folder_of(tmp_path, "x,y,z,w", [[-1, 1, 141, -1], [1, -1, 145, -5]])
    guess = guess_mapping(folder, given)
    assert {name: guess.options.get(name) for name in found} == found
    path = tmp_path / "map.toml"
    write_mapping(path, guess)
    scene = open_recording(folder, read_mapping(path)).scenes[0]
    assert scene is not None
    assert scene.pose.depth == pytest.approx(depth)


def test_what_a_person_says_goes_before_the_guess(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "left,up,depth", [[1, 2, 3]])
    with pytest.raises(UserError, match="surely x; its columns are shot, left"):
        guess_mapping(folder)
    guess = guess_mapping(folder, ["x=left", "y=-up"])
    assert (guess.options["x"], guess.options["y"]) == ("left", "-up")
    path = tmp_path / "map.toml"
    path.write_text('x = "left"\ny = "up"\nspeling = 3\n')
    with pytest.raises(UserError, match=r"map\.toml.*speling"):
        read_mapping(path)
    path.write_text("x = ")
    with pytest.raises(UserError, match="is no TOML file"):
        read_mapping(path)
