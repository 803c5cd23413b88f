"""Labels held against frames: spoiled copies are noticed, clean ones are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tac_vgnn import tac_vgnn_folder

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.datasets import (
    ImportOptions,
    LabelReport,
    Recording,
    check_labels,
    import_folder,
    open_recording,
)
from tactibench.plugins import PluginHost
from tactibench.png import encode_png
from tactibench.records import BoundSpec

Spoil = Callable[[Pose], Pose]

SPOILED: list[tuple[str, Spoil, str]] = [
    ("x and y swapped", lambda p: replace(p, x=p.y, y=p.x), "mirrored"),
    ("depth the other way", lambda p: replace(p, depth=6 - p.depth), "counts the other way"),
    ("depth and x swapped", lambda p: replace(p, depth=p.x, x=p.depth), "does not follow"),
    ("metres", lambda p: replace(p, depth=p.depth / 1000), "check the column of the depth"),
    ("a zero elsewhere", lambda p: replace(p, x=p.x + 300), "places would reach"),
    ("y in another unit", lambda p: replace(p, y=p.y / 10), "times as long"),
]


def singles(count: int) -> list[Scene]:
    rng = np.random.default_rng(11)
    x, y, depth = rng.uniform((-5, -5, 0.5), (5, 5, 5.0), (count, 3)).T.tolist()
    return [
        Scene(Indenter.single(), Pose(a, b, depth=d)) for a, b, d in zip(x, y, depth, strict=True)
    ]


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Eighty presses of the simulated sensor, as a lab's folder."""
    return lab_folder(tmp_path_factory.mktemp("pressed"), singles(80))


@pytest.fixture(scope="module")
def tilted(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Eighty presses of a tilted plate, without a frame of the undeformed sensor."""
    rng = np.random.default_rng(12)
    poses = rng.uniform((-20, 1), (20, 4.5), (80, 2)).tolist()
    scenes = [Scene(Indenter.plate(), Pose(tilt=t, depth=d)) for t, d in poses]
    return replace(lab_folder(tmp_path_factory.mktemp("tilted"), scenes), rest=None)


def lab_folder(folder: Path, scenes: list[Scene]) -> Recording:
    sensor = BoundSpec.named(PluginHost().sensors, "tactip-127", {}).build(
        SensorContext(np.random.SeedSequence(1))
    )
    lines = ["image,x_mm,y_mm,depth_mm,pose_2,pose_6"]
    with sensor:
        (folder / "init_0.png").write_bytes(encode_png(sensor.rest().image))
        for number, frame in enumerate(sensor.press_many(scenes)):
            (folder / f"{number}.png").write_bytes(encode_png(frame.image))
            pose = scenes[number].pose
            lines.append(
                f"{number}.png,{pose.x},{pose.y},{pose.depth},{pose.depth - 5},{pose.tilt}"
            )
    (folder / "labels.csv").write_text("\n".join(lines))
    return open_recording(folder)


def test_rows_that_hover_have_no_place_that_pins_could_show(tmp_path: Path) -> None:
    pressed, labelled = (
        [
            replace(scene, pose=replace(scene.pose, depth=depth)) if row % 2 else scene
            for row, scene in enumerate(singles(100))
        ]
        for depth in (0.0, -3.0)
    )
    report = check_labels(lab_folder(tmp_path, pressed), labelled, ImportOptions())
    assert report.contradictions == ()
    assert report.presses == 50


def contradictions(recording: Recording, scenes: tuple[Scene | None, ...]) -> str:
    return "; ".join(check_labels(recording, scenes, ImportOptions()).contradictions)


def posed(recording: Recording, spoil: Spoil) -> tuple[Scene, ...]:
    return tuple(Scene(s.indenter, spoil(s.pose)) for s in recording.scenes if s is not None)


def test_true_labels_are_not_doubted(pressed: Recording) -> None:
    report = check_labels(pressed, pressed.scenes, ImportOptions())
    assert report.contradictions == ()
    assert report.presses == 80
    turned = posed(pressed, lambda p: replace(p, x=-p.y, y=p.x))  # a camera may be turned
    assert contradictions(pressed, turned) == ""


@pytest.mark.parametrize(("spoil", "words"), [s[1:] for s in SPOILED], ids=[s[0] for s in SPOILED])
def test_spoiled_labels_of_tips_are_noticed(pressed: Recording, spoil: Spoil, words: str) -> None:
    assert words in contradictions(pressed, posed(pressed, spoil))


@pytest.mark.parametrize("lag", [-1, 2])
def test_shifted_rows_are_noticed(pressed: Recording, lag: int) -> None:
    scenes = list(pressed.scenes)
    wrong = contradictions(pressed, tuple(scenes[-lag:] + scenes[:-lag]))
    assert "rows are shifted" in wrong


def test_channels_are_held_against_their_depth(tmp_path: Path) -> None:
    """A skin of eight channels: no picture, so that x and y cannot be placed, but depth can."""
    rng = np.random.default_rng(4)
    table = rng.uniform((-8, -8, 0.5), (8, 8, 4.0), (300, 3))
    places = rng.uniform(-8, 8, (8, 2))
    near = np.exp(-((table[:, None, :2] - places) ** 2).sum(axis=2) / 60)
    np.savetxt(tmp_path / "field.csv", near * table[:, 2:] ** 1.5, delimiter=",")
    np.savetxt(
        tmp_path / "labels.csv", table, delimiter=",", header="x_mm,y_mm,depth_mm", comments=""
    )
    skin = open_recording(tmp_path, ImportOptions(channels="field.csv", surface="flat"))
    assert contradictions(skin, skin.scenes) == ""
    other = posed(skin, lambda p: replace(p, depth=4.5 - p.depth))
    assert "counts the other way" in contradictions(skin, other)
    shifted = skin.scenes[-1:] + tuple(skin.scenes[:-1])
    assert "rows are shifted" in contradictions(skin, shifted)
    other_rows = rng.permutation(table[:, 0]).tolist()
    wrong_x = tuple(
        Scene(s.indenter, replace(s.pose, x=x))
        for s, x in zip(skin.scenes, other_rows, strict=True)
        if s is not None
    )
    assert "no x alike" in contradictions(skin, wrong_x)


def test_too_few_presses_are_no_contradiction(pressed: Recording) -> None:
    few = (*pressed.scenes[:20], *[None] * 60)
    assert contradictions(pressed, few) == ""


def plates(recording: Recording, **labels: np.ndarray) -> LabelReport:
    scenes = [Scene(Indenter.plate(), Pose(depth=1.0))] * len(recording)
    changed = {name: np.asarray(column) for name, column in labels.items()}
    return check_labels(replace(recording, labels=changed), scenes, ImportOptions())


def test_places_are_no_plates(pressed: Recording) -> None:
    """A tip at several places, whose second length stands where a plate's depth would."""
    poses = [scene.pose for scene in pressed.scenes if scene is not None]
    depth = np.array([pose.y for pose in poses])
    report = plates(pressed, pose_2=depth, pose_6=np.zeros(len(poses)))
    assert "does not follow the depth" in report.contradictions[0]
    assert "the tilt is the same in all presses: not checked" in report.facts


NO_REST: list[tuple[str, Spoil, str]] = [
    ("as they are", lambda p: p, ""),
    ("mirrored", lambda p: replace(p, x=-p.x), "mirrored"),
    ("metres", lambda p: replace(p, depth=p.depth / 1000), "check the column of the depth"),
    ("depth of 80 mm", lambda p: replace(p, depth=16 * p.depth), "check the column of the depth"),
    ("one place", lambda p: replace(p, x=0.0), ""),
    ("one depth, to 10 um", lambda p: replace(p, depth=2.0 + p.depth / 500), ""),
    ("one depth", lambda p: replace(p, depth=0.0), ""),
    ("all alike", lambda p: Pose(depth=1.0), "all labels are the same"),
]


@pytest.mark.parametrize(("spoil", "words"), [s[1:] for s in NO_REST], ids=[s[0] for s in NO_REST])
def test_tips_are_checked_without_a_rest_frame(
    pressed: Recording, spoil: Spoil, words: str
) -> None:
    """A label that never changes says nothing, and nothing is said against it."""
    wrong = contradictions(replace(pressed, rest=None), posed(pressed, spoil))
    assert words in wrong
    assert bool(words) == bool(wrong)


@pytest.mark.parametrize("lag", [-1, 2])
def test_shifted_rows_are_noticed_without_a_rest_frame(pressed: Recording, lag: int) -> None:
    scenes = list(pressed.scenes)
    wrong = contradictions(replace(pressed, rest=None), tuple(scenes[-lag:] + scenes[:-lag]))
    assert "rows are shifted" in wrong


def test_plates_are_checked_without_a_rest_frame(tilted: Recording) -> None:
    depth, tilt = tilted.labels["pose_2"], tilted.labels["pose_6"]
    assert plates(tilted, pose_2=depth, pose_6=tilt).contradictions == ()
    assert plates(tilted, pose_2=0 * depth, pose_6=tilt).contradictions == ()
    assert plates(tilted, pose_2=depth, pose_6=0 * tilt).contradictions == ()
    other = np.random.default_rng(3).permutation(tilt)  # an edge that turns about the axis
    spoiled = {
        "tilt reaches 179 deg": plates(tilted, pose_2=depth, pose_6=180 - np.abs(tilt) - 1),
        "depth label spans 3": plates(tilted, pose_2=1000 * depth, pose_6=tilt),
        "where the plate is tilted to": plates(tilted, pose_2=depth, pose_6=other),
        "does not follow the depth": plates(tilted, pose_2=np.roll(depth, 1), pose_6=tilt),
        "all labels are the same": plates(tilted, pose_2=0 * depth, pose_6=0 * tilt),
    }
    for words, report in spoiled.items():
        assert words in "; ".join(report.contradictions)


@pytest.mark.long
@pytest.mark.parametrize("pins", ["331", pytest.param("127", marks=pytest.mark.slow)])
def test_the_public_recordings_and_their_spoiled_copies(pins: str) -> None:
    clean = open_recording(tac_vgnn_folder() / pins / "model_surface2d")
    labels = dict(clean.labels)
    depth, tilt = labels["pose_2"], labels["pose_6"]
    spoiled = {
        "depth the other way": {"pose_2": -depth},
        "tilt in rad": {"pose_6": np.radians(tilt)},
        "depth in um": {"pose_2": 1000 * depth},
        "depth in m": {"pose_2": depth / 1000},
        "swapped": {"pose_2": tilt, "pose_6": depth},
        "depths shifted by one row": {"pose_2": np.roll(depth, 1)},
        "tilts of other rows": {"pose_6": np.roll(tilt, 1000)},
        "all shifted by one row": {name: np.roll(column, 1) for name, column in labels.items()},
        "another column for the depth": {"pose_2": labels["move_1"]},
        "an edge: it turns about the axis": {"pose_6": labels["move_6"]},
    }

    def report(recording: Recording) -> tuple[str, ...]:
        scenes = [Scene(Indenter.plate(), Pose(depth=1.0))] * len(recording)
        return check_labels(recording, scenes, ImportOptions()).contradictions

    assert report(clean) == ()
    missed = [
        name
        for name, change in spoiled.items()
        if not report(replace(clean, labels={**labels, **change}))
    ]
    assert missed == []


def test_a_data_set_keeps_what_was_imported(pressed: Recording, tmp_path: Path) -> None:
    dataset = import_folder(pressed, tmp_path / "set")
    again = open_recording(dataset.folder)
    assert contradictions(again, again.scenes) == ""
