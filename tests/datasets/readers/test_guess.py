"""What `--guess` takes columns for: it never guesses in silence, and reads ordinary tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from messy_labs import ROWS, SIZE, Lab, Skin, hovering, imported
from scipy.io import savemat

from tactibench import Indenter, Scene, UserError
from tactibench.datasets import (
    guess_mapping,
    open_recording,
    own_workspace,
    read_mapping,
    read_options,
    write_mapping,
)
from tactibench.png import encode_png


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path / "lab")


def places(lab: Lab) -> dict[str, Any]:
    return {"x": lab.x, "y": lab.y, "depth": lab.depth}


def noise(lab: Lab, low: float = -1, high: float = 1) -> np.ndarray:
    return np.round(lab.rng.uniform(low, high, lab.rows), 4)


def quaternion(lab: Lab) -> dict[str, Any]:
    four = lab.rng.normal(size=(4, lab.rows))
    return dict(zip(("x_1", "y_1", "z_1", "w"), four / np.linalg.norm(four, axis=0), strict=True))


OTHERS: dict[str, tuple[Callable[[Lab], dict[str, Any]], Sequence[str]]] = {
    "quaternion": (quaternion, ("x_1", "y_1", "z_1", "w")),
    "forces": (lambda lab: {f"F_{a}": noise(lab) for a in "xyz"}, ("F_x", "F_y")),
    "shear": (lambda lab: {f"shear_{a}": noise(lab) for a in "xyz"}, ("shear_x", "shear_y")),
    "object": (lambda lab: {f"object_{a}": noise(lab) for a in "xyz"}, ("object_x", "object_z")),
    "poses": (lambda lab: {f"pose_{a}": noise(lab) for a in "xyz"}, ("pose_x", "pose_y")),
    "velocity": (lambda lab: {f"vel_{a}": noise(lab) for a in "xy"}, ("vel_x", "vel_y")),
    "pixels": (lambda lab: {"x_px": noise(lab), "y_px": noise(lab)}, ("x_px", "y_px")),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_other_quantities_are_no_tips(lab: Lab, kind: str) -> None:
    columns, unused = OTHERS[kind]
    guess = guess_mapping(lab.table(places(lab) | columns(lab)))
    assert guess.options["indenter"] == "single"
    assert [guess.options[role] for role in ("x", "y", "depth")] == ["x", "y", "depth"]
    assert {*unused} <= guess.unused.keys()
    assert all(name in guess.text() for name in unused)


def test_a_second_tip_needs_places_of_its_own(lab: Lab, tmp_path: Path) -> None:
    one = {"x1": lab.x, "y1": lab.y, "d1": lab.depth}
    two = {"x2": -lab.x + 3, "y2": lab.y[::-1], "depth_2": lab.depth}
    numbered = {"x1": lab.x, "y1": lab.y, "depth_1": lab.depth, **two}
    assert guess_mapping(lab.table(numbered)).options["x"] == "x1,x2"
    with pytest.raises(UserError, match="x2 and y2 have no depth of their own"):
        guess_mapping(lab.table(one | {"x2": two["x2"], "y2": two["y2"]}))
    far = {"x2": lab.x * 40 + 900, "y2": lab.y, "depth_2": lab.depth}
    guess = guess_mapping(lab.table(numbered | far))
    assert (guess.options["indenter"], guess.options["x"]) == ("single", "x1")
    assert "no second tip" in guess.unused["x2"]


@pytest.mark.parametrize(
    ("unit", "per_mm", "named"),
    [
        ("mm", 1.0, "x [mm]"),
        ("cm", 0.1, "x_cm"),
        ("in", 1 / 25.4, "x (inch)"),
        ("um", 1e3, "x [\u00b5m]"),
        ("um", 1e3, "x [\u03bcm]"),
        ("m", 1e-3, "x/m"),
    ],
)
def test_a_unit_that_a_header_states_holds(
    lab: Lab, tmp_path: Path, unit: str, per_mm: float, named: str
) -> None:
    """Also where another column has another one, and whatever the options say of the rest."""
    columns = {named: lab.x * per_mm, named.replace("x", "y"): lab.y * per_mm, "depth": lab.depth}
    assert lab.table(columns)
    guess = guess_mapping(lab.folder)
    write_mapping(tmp_path / "map.toml", guess)
    recording = open_recording(lab.folder, read_mapping(tmp_path / "map.toml", ["unit=mm"]))
    poses = [scene.pose for scene in recording.scenes if scene is not None]
    assert np.allclose([pose.x for pose in poses], lab.x)
    assert np.allclose([pose.depth for pose in poses], lab.depth)


def test_metres_of_a_robot_are_told_from_their_span(lab: Lab) -> None:
    columns = {
        f"pose.position.{axis}": values
        for axis, values in (
            ("x", 0.42 + lab.x * 1e-3),
            ("y", lab.y * 1e-3),
            ("z", 0.1 - lab.depth * 1e-3),
        )
    }
    guess = guess_mapping(lab.table(columns))
    assert guess.options["unit"] == "m"
    assert guess.options["depth"] == "-pose.position.z"  # the frames change more the lower it is
    with pytest.raises(UserError, match=r"span 0\.5.*tells no unit.*--param unit=UNIT"):
        guess_mapping(lab.table({"x": lab.x / 20, "y": lab.y / 20, "depth": lab.depth}))


def test_degrees_or_radians_are_asked_for(lab: Lab) -> None:
    pair = places(lab) | {"spacing": noise(lab, 7, 9), "yaw": noise(lab, -1.5, 1.5)}
    with pytest.raises(UserError, match=r"yaw reaches.*angles=deg or --param angles=rad"):
        guess_mapping(lab.table(pair))
    assert guess_mapping(lab.folder, ["angles=rad"]).options["angles"] == "rad"
    pair["yaw"] = noise(lab, -90, 90)
    assert guess_mapping(lab.table(pair)).options["angles"] == "deg"
    pair["yaw_rad"] = pair.pop("yaw")
    guess = guess_mapping(lab.table(pair))
    assert (guess.options["yaw"], guess.options.get("angles")) == ("yaw_rad", None)


def test_several_columns_that_may_be_it_are_asked_for(lab: Lab) -> None:
    twice = places(lab) | {"x_nozzle": lab.x, "y_nozzle": lab.y, "x_arm": lab.x, "y_arm": lab.y}
    assert guess_mapping(lab.table(twice)).options["x"] == "x"
    del twice["x"], twice["y"]
    with pytest.raises(UserError, match=r"x_nozzle, y_nozzle or x_arm, y_arm.*--param x=COLUMN"):
        guess_mapping(lab.table(twice))


def test_the_sign_of_a_height_follows_from_the_signal(lab: Lab) -> None:
    height = {"x": lab.x, "y": lab.y, "z": 150 - lab.depth}
    guess = guess_mapping(lab.table(height))
    assert guess.options["depth"] == "-z"
    assert "correlation -0.9" in guess.remarks["depth"]
    height["z"] = noise(lab, 148, 150)
    guess = guess_mapping(lab.table(height))
    assert "depth" not in guess.options
    assert '# \'z\' may be the depth; write depth = "z" or depth = "-z"' in guess.text()
    height["z"] = np.full(lab.rows, 150.0)
    assert "no depth" in guess_mapping(lab.table(height)).unused["z"]
    hover = {"x": lab.x, "y": lab.y, "depth": lab.depth - 0.5}
    assert "offset_mm" not in guess_mapping(lab.table(hover)).options


def test_rows_that_hover_do_not_move_the_depths_of_others(tmp_path: Path) -> None:
    lab = hovering(tmp_path / "lab")
    columns = {"x": lab.x + 80, "y": lab.y, "z": 152.3 - lab.depth}
    guess, poses = imported(lab, columns, tmp_path)
    assert guess.options["depth"] == "-z"
    assert float(guess.options["offset_mm"]) == pytest.approx(152.3, abs=0.3)
    assert "first touch" in guess.remarks["offset_mm"]
    touching = lab.depth > 0.5
    depth = np.array([pose.depth for pose in poses])
    assert (depth[lab.depth < 0] <= 0).all()
    assert np.ptp((depth - lab.depth)[touching]) < 1e-6


def test_most_rows_may_hover_and_a_parking_place_is_no_part_of_the_sensor(tmp_path: Path) -> None:
    lab = hovering(tmp_path / "lab", 0.7)
    x, depth = lab.x.copy(), lab.depth.copy()
    x[::10], depth[::10] = 180.0, -60.0
    guess, poses = imported(lab, {"x": x, "y": lab.y, "depth": depth}, tmp_path)
    assert guess.options["depth"] == "depth"  # although most are negative
    assert not {"x_zero_mm", "offset_mm"} & guess.options.keys()
    scenes = [Scene(Indenter.single(), pose) for pose in poses]
    space = own_workspace(scenes, np.inf)
    assert space is not None
    assert space.half_width_mm < 6.1


def subsets(presses: Sequence[str]) -> int:
    return len(set(presses))


@pytest.mark.parametrize("kind", ["number", "text", "none"])
def test_rows_near_each_other_are_one_press_whatever_names_them(tmp_path: Path, kind: str) -> None:
    lab = Lab(tmp_path / "lab", 60)
    press = np.tile(np.arange(12), 5)
    lab.x, lab.y = (v[press] + lab.rng.uniform(-0.03, 0.03, 60) for v in (lab.x, lab.y))
    ids: dict[str, dict[str, Any]] = {
        "number": {"point_id": press},
        "text": {"recording": [f"rec-{number}" for number in press]},
        "none": {"contact": np.arange(60) % 2},
    }
    guess, _ = imported(lab, places(lab) | ids[kind], tmp_path)
    assert guess.options.get("press", "none") == next(iter(ids[kind])).replace("contact", "none")
    recording = open_recording(lab.folder, read_mapping(tmp_path / "guess.toml"))
    assert len({*zip(press, recording.presses, strict=True)}) == 12


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        (("x [0.1mm]", "y [0.1mm]", "depth"), "no column that is surely x"),
        (("x (counts)", "y (counts)", "depth"), "no column that is surely x"),
        (("x_idx", "y_idx", "depth"), "no column that is surely x"),
        (
            ("x", "y", "depth in thousandths"),
            r"reach .* which no press does; .* such as depth \[um\]",
        ),
        (("x", "y", "depth in metres"), r"no press does; .* such as depth \[m\]"),
    ],
)
def test_what_is_no_length_in_mm_is_asked_for(
    lab: Lab, columns: tuple[str, str, str], sentence: str
) -> None:
    scale = {"depth in thousandths": 1e3, "depth in metres": 1e-3}.get(columns[2], 1.0)
    values = (lab.x, lab.y, lab.depth * scale)
    names = [name.partition(" in ")[0] for name in columns]
    with pytest.raises(UserError, match=sentence):
        guess_mapping(lab.table(dict(zip(names, values, strict=True))))


@pytest.mark.parametrize(
    ("given", "near"),
    [
        ("depth=indentaton", "indentation [mm]"),
        ("depth=-indentation[mm]", "indentation [mm]"),
        ("x=posx", "pos_x"),
        ("y=pos_y,posz", "pos_y"),
        ("force=Fz", "fz"),
        ("press=shot", "shots"),
        ("yaw=tun", "turn"),
        ("x=", ""),
    ],
)
def test_a_column_that_is_named_and_not_there_gets_the_nearest_name(
    lab: Lab, given: str, near: str
) -> None:
    columns = {"pos_x": lab.x, "pos_y": lab.y, "indentation [mm]": lab.depth, "fz": lab.depth}
    folder = lab.table(columns | {"shots": np.arange(lab.rows), "turn": 100 * lab.depth})
    sentence = f"did you mean '{re.escape(near)}'" if near else "known: "
    with pytest.raises(UserError, match=rf"log\.csv has no column '.*'; {sentence}"):
        guess_mapping(folder, [given])
    assert guess_mapping(folder, ["depth=auto"]).options["depth"] == "indentation [mm]"


def test_a_video_needs_no_column_of_numbers(lab: Lab, tmp_path: Path) -> None:
    kind = cv2.VideoWriter_fourcc(*"MJPG")
    video = cv2.VideoWriter(str(lab.folder / "cam.avi"), kind, 30, (SIZE, SIZE))
    for row in range(ROWS):
        path = lab.folder / f"f{row}.png"
        video.write(cv2.imread(str(path)))
        path.unlink()
    video.release()
    lab.table({"x": lab.x, "y": lab.y, "z": 90 - lab.depth})
    path = lab.folder / "log.csv"
    path.write_text("\n".join(row.partition(",")[2] for row in path.read_text().splitlines()))
    guess = guess_mapping(lab.folder)
    assert guess.options["depth"] == "-z"  # what the frames show was looked at
    path.write_text(path.read_text().rpartition("\n")[0])
    with pytest.raises(UserError, match=r"has 39 rows, and the video 40 frames"):
        guess_mapping(lab.folder)


def test_sessions_in_folders_are_named_with_their_own_frames(tmp_path: Path) -> None:
    for day in ("monday", "tuesday"):
        lab = Lab(tmp_path / "lab" / day)
        lab.table(places(lab))
    with pytest.raises(UserError, match=r"in 2 ways.*table=monday/log\.csv column=file frames=mo"):
        guess_mapping(tmp_path / "lab")


def test_files_that_are_not_read_are_named(lab: Lab) -> None:
    (lab.folder / "labels.xlsx").write_bytes(b"PK")
    with pytest.raises(UserError, match=r"Not read: labels\.xlsx; save them as one CSV table"):
        guess_mapping(lab.folder)


def test_frames_of_one_press_or_place_stay_together(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab", 60)
    slides = places(lab) | {"press": np.repeat(np.arange(12), 5)}
    for start in range(0, 60, 5):
        slides["x"][start : start + 5] = slides["x"][start] + 0.3 * np.arange(5)
        slides["y"][start : start + 5] = slides["y"][start]
    guess = guess_mapping(lab.table(slides))
    assert guess.options["press"] == "press"
    write_mapping(tmp_path / "map.toml", guess)
    assert subsets(open_recording(lab.folder, read_mapping(tmp_path / "map.toml")).presses) == 12
    repeats = {"x": np.tile(lab.x[:12], 5), "y": np.tile(lab.y[:12], 5), "depth": lab.depth}
    repeats["trial"] = np.repeat(np.arange(5), 12)
    guess = guess_mapping(lab.table(repeats))
    assert "press" not in guess.options
    assert "session" in guess.unused["trial"]
    write_mapping(tmp_path / "again.toml", guess)
    recording = open_recording(lab.folder, read_mapping(tmp_path / "again.toml"))
    assert subsets(recording.presses) == 12
    assert any("12 places: rows at one place are one press" in note for note in recording.notes)


@pytest.mark.parametrize(("dragged", "presses"), [("differently", 60), ("alike", 30)])
def test_presses_that_were_dragged_differently_are_two(
    tmp_path: Path, dragged: str, presses: int
) -> None:
    """Of thousands of plates, two have one pose by chance."""
    rng = np.random.default_rng(1)
    poses = np.tile(rng.uniform(-5, 5, (30, 2)), (2, 1))
    drag = np.tile(rng.uniform(-5, 5, 30), 2) + (np.arange(60) // 30 if presses == 60 else 0)
    rows = ["image_name,pose_2,pose_6,move_1"]
    for row, (depth, tilt) in enumerate(poses):
        image = rng.integers(0, 256, (12, 10), dtype=np.uint8)
        (tmp_path / f"{row}.png").write_bytes(encode_png(image))
        rows.append(f"{row}.png,{depth},{tilt},{drag[row]}")
    (tmp_path / "targets.csv").write_text("\n".join(rows) + "\n")
    assert subsets(open_recording(tmp_path).presses) == presses


def test_rows_along_a_path_are_no_single_place(tmp_path: Path) -> None:
    lab = Lab(tmp_path / "lab")
    path = {"x_mm": np.arange(ROWS) * 0.005, "y_mm": np.zeros(ROWS), "depth_mm": lab.depth}
    assert subsets(open_recording(lab.table(path)).presses) == ROWS


def test_frames_of_two_sensors_are_not_mixed(lab: Lab) -> None:
    for path in lab.folder.glob("*.png"):
        path.unlink()
    lab.draw(lab.folder / "left")
    lab.draw(lab.folder / "right")
    lab.table(places(lab))
    with pytest.raises(UserError, match=r"2 ways.*frames=left or .*frames=right"):
        guess_mapping(lab.folder)
    with pytest.raises(UserError, match=r"in left, right, maybe of different sensors.*frames="):
        open_recording(lab.folder)
    assert guess_mapping(lab.folder, ["frames=left"]).options["frames"] == "left"
    lab.table({"file": [f"{('left', 'right')[r % 2]}/f{r}.png" for r in range(ROWS)]} | places(lab))
    with pytest.raises(UserError, match="maybe of different sensors"):
        open_recording(lab.folder)
    assert len(open_recording(lab.folder, read_options(["frames=left", "missing=skip"]))) == 20


def test_a_frozen_camera_is_named(lab: Lab) -> None:
    image = (lab.folder / "f9.png").read_bytes()
    for row in range(10, 16):
        (lab.folder / f"f{row}.png").write_bytes(image)
    lab.table({f"{name}_mm": values for name, values in places(lab).items()})
    with pytest.raises(
        UserError, match=r"log\.csv row 15: the signal is that of the 5 rows before"
    ):
        open_recording(lab.folder)


def test_a_frame_that_no_row_lists_is_not_taken_for_the_rest_frame(lab: Lab) -> None:
    for name in ("image_0.png", "spare.png", "definition.png"):
        (lab.folder / name).write_bytes((lab.folder / "f3.png").read_bytes())
    lab.table(places(lab))
    assert open_recording(lab.folder).rest is None
    (lab.folder / "rest.png").write_bytes((lab.folder / "f3.png").read_bytes())
    assert open_recording(lab.folder).rest == lab.folder / "rest.png"


def test_a_last_line_that_was_cut_off_is_named(lab: Lab) -> None:
    path = lab.table(places(lab)) / "log.csv"
    path.write_text(path.read_text().rstrip()[:-12].rsplit(",", 1)[0])
    with pytest.raises(UserError, match="cut off there: Expected 4 fields in line 41, saw"):
        guess_mapping(lab.folder)


ORDINARY: list[dict[str, str]] = [
    {"x": "x", "y": "y", "depth": "depth"},
    {"x": "X", "y": "Y", "depth": "Depth"},
    {"x": "x_mm", "y": "y_mm", "depth": "depth_mm"},
    {"x": "x (mm)", "y": "y (mm)", "depth": "indentation (mm)"},
    {"x": "cx [mm]", "y": "cy [mm]", "depth": "indentation [mm]"},
    {"x": "contact_x", "y": "contact_y", "depth": "contact_depth"},
    {"x": "contactX", "y": "contactY", "depth": "pressDepth"},
    {"x": "pos_x", "y": "pos_y", "depth": "penetration"},
    {"x": "posX", "y": "posY", "depth": "indent"},
    {"x": "px", "y": "py", "depth": "depth"},
    {"x": "probe x", "y": "probe y", "depth": "probe depth"},
    {"x": "tip_x_mm", "y": "tip_y_mm", "depth": "tip_depth_mm"},
    {"x": "indenter_x", "y": "indenter_y", "depth": "indentation"},
    {"x": "x_position", "y": "y_position", "depth": "press_depth"},
    {"x": "stage_x", "y": "stage_y", "depth": "indentation_depth"},
    {"x": "robot_x", "y": "robot_y", "depth": "depth"},
    {"x": "tcp.x", "y": "tcp.y", "depth": "depth"},
    {"x": "pose_x", "y": "pose_y", "depth": "pose_z"},
    {"x": "x", "y": "y", "depth": "z"},
    {"x": "location_x", "y": "location_y", "depth": "depth"},
    {"x": "center_x", "y": "center_y", "depth": "depth"},
    {"x": "x_label", "y": "y_label", "depth": "depth_label"},
    {"x": "nozzle_x", "y": "nozzle_y", "depth": "nozzle_z"},
    {"x": "xpos", "y": "ypos", "depth": "zpos"},
]
BESIDE: list[Callable[[Lab], dict[str, Any]]] = [
    lambda lab: {},
    lambda lab: {"time": np.arange(lab.rows) * 0.1, "operator": ["me"] * lab.rows},
    lambda lab: {"Fz": noise(lab, 0, 3), "temperature": noise(lab, 20, 21)},
]


@pytest.mark.parametrize("names", ORDINARY, ids=lambda names: names["x"])
@pytest.mark.parametrize("beside", [0, 1, 2])
def test_ordinary_tables_are_read(
    lab: Lab, tmp_path: Path, names: dict[str, str], beside: int
) -> None:
    columns = {names["x"]: lab.x, names["y"]: lab.y, names["depth"]: lab.depth}
    guess = guess_mapping(lab.table(columns | BESIDE[beside](lab), ",;\t"[beside]))
    assert {role: guess.options.get(role) for role in names} == names
    assert {*guess.unused} >= {*BESIDE[beside](lab)} - {"Fz"}
    assert not {"offset_mm", "x_zero_mm", "unit"} & guess.options.keys()
    write_mapping(tmp_path / "map.toml", guess)
    recording = open_recording(lab.folder, read_mapping(tmp_path / "map.toml"))
    assert [s.pose.depth for s in recording.scenes if s is not None] == lab.depth.tolist()


@pytest.fixture
def skin(tmp_path: Path) -> Skin:
    return Skin(tmp_path / "skin")


NAMES = ",".join(f"s{n}" for n in range(16))
FIELD = ",".join(f"B{axis}{n}" for n in range(5) for axis in "xyz")


@pytest.mark.parametrize(
    ("header", "channels", "count"),
    [(f"t,x,y,depth,{NAMES}", "s0:s15", 16), (f"t,x,y,depth,{FIELD},T", "Bx0:Bz4", 15)],
)
def test_labels_and_channels_of_one_table(
    skin: Skin, tmp_path: Path, header: str, channels: str, count: int
) -> None:
    time = np.arange(skin.rows) * 0.1
    guess = guess_mapping(
        skin.write("all.csv", [time, skin.x, skin.y, skin.depth, skin.taxels], header)
    )
    found = [guess.options[name] for name in ("channel_columns", "x", "y", "depth")]
    assert found == [channels, "x", "y", "depth"]
    assert "t" in guess.unused
    write_mapping(tmp_path / "map.toml", guess)
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    assert recording.kind.shape == (count,)
    assert {*recording.labels} >= {"x", "y", "depth"}


def test_columns_without_names_need_a_part_in_the_signal(skin: Skin) -> None:
    skin.write("in.csv", [skin.taxels])
    guess = guess_mapping(skin.write("out.csv", [skin.x, skin.y, skin.depth]))
    assert [guess.options[name] for name in ("table", "channels")] == ["out.csv", "in.csv"]
    assert [guess.options[name] for name in ("x", "y")] == ["column_1", "column_2"]
    assert 'depth = "column_3" or force = "column_3"' in guess.unused["column_3"]
    far = guess_mapping(skin.write("out.csv", [skin.x, skin.y, 150 - skin.depth]))
    assert far.options["depth"] == "-column_3"
    rng = np.random.default_rng(0)
    skin.write("out.csv", [rng.permutation(skin.x), rng.permutation(skin.y), skin.depth])
    with pytest.raises(UserError, match=r"surely x.*--param x=COLUMN"):
        guess_mapping(skin.folder)
    skin.write("third.csv", [skin.taxels])
    with pytest.raises(UserError, match=r"channels=in\.csv, third\.csv"):
        guess_mapping(skin.folder)


def test_a_time_is_no_channel(skin: Skin) -> None:
    time = np.arange(skin.rows) * 0.1
    skin.write("field.csv", [time, skin.taxels], f"time,{NAMES}")
    guess = guess_mapping(skin.write("poses.csv", [skin.x, skin.y, skin.depth], "x,y,depth"))
    assert guess.options["channel_columns"] == "s0:s15"
    assert "time" in guess.unused
    guess = guess_mapping(
        skin.write("poses.csv", [time[::2], *(v[::2] for v in (skin.x, skin.y))], "time,x,y")
    )
    assert guess.options["join"] == "time"


def test_rows_without_a_place_touch_nothing(skin: Skin, tmp_path: Path) -> None:
    labels = np.column_stack([skin.x, skin.y, skin.depth])
    labels[::10] = np.nan
    skin.write("all.csv", [labels, skin.taxels], f"x,y,depth,{NAMES}")
    write_mapping(tmp_path / "map.toml", guess_mapping(skin.folder))
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    depths = [scene.pose.depth for scene in recording.scenes if scene is not None]
    assert depths[::10] == [0.0] * 12
    assert depths[1] == skin.depth[1]
    labels[5, 0] = np.nan
    skin.write("all.csv", [labels, skin.taxels], f"x,y,depth,{NAMES}")
    with pytest.raises(UserError, match="x is 'nan', but it must be"):
        open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))


def test_channels_before_a_press_are_subtracted(skin: Skin, tmp_path: Path) -> None:
    touched = (np.random.default_rng(3).uniform(size=(skin.rows, 4)) > 0.5).astype(np.uint8)
    arrays = {"befores": skin.taxels * 0 + 7, "afters": skin.taxels + 7, "patterns": touched}
    savemat(skin.folder / "batch.mat", arrays)
    guess = guess_mapping(skin.folder)
    found = {name: guess.options[name] for name in ("channel_columns", "before", "sites")}
    assert found == {"channel_columns": "afters", "before": "befores", "sites": "patterns"}
    write_mapping(tmp_path / "map.toml", guess)
    recording = open_recording(skin.folder, read_mapping(tmp_path / "map.toml"))
    assert np.allclose(recording.signal(5), skin.taxels[5], atol=1e-5)
    assert recording.sites == ("A", "B", "C", "D")


def test_a_flag_of_contact_numbers_no_presses(skin: Skin) -> None:
    labels = np.column_stack([skin.rng.integers(0, 2, skin.rows), skin.x, skin.y, skin.depth])
    labels[labels[:, 0] == 0, 1:] = np.nan
    skin.write("all.csv", [labels, skin.taxels], f"contact,x,y,depth,{NAMES}")
    assert "press" not in guess_mapping(skin.folder).options
