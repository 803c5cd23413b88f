"""`tactibench sim real`: what it reads, what it refuses, what it prints."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import UserError
from tactibench_sim.commands.real import real
from tactibench_sim.real.calibration import LabelFit, Unknowns
from tactibench_sim.real.comparison import (
    Errors,
    _refuse_disagreement,
    _refuse_misfit,
    compare,
)
from tactibench_sim.real.plate import Labels, Rig, displacements, plate
from tactibench_sim.real.recording import Presses, read

HEADER = "image_name,pose_2,pose_6,move_1,move_6"
TRUTH = Unknowns(centre_x=180.0, centre_y=179.0, drag_per_mm=-0.6)


def frame(xy):
    row, column = np.indices((360, 360))
    image = np.zeros((360, 360), dtype=np.uint8)
    for x, y in xy:
        image[(row - y) ** 2 + (column - x) ** 2 <= 16] = 255
    return image


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Forty-five simulated presses of 61 pins as a recording."""
    folder = tmp_path_factory.mktemp("recording")
    (folder / "frames_bw").mkdir()
    angle = [2 * np.pi * np.arange(6 * k) / (6 * k) for k in range(1, 5)]
    rings = [30 * (k + 1) * np.stack([np.cos(a), np.sin(a)], axis=1) for k, a in enumerate(angle)]
    rest = np.concatenate([[[0.0, 0.0]], *rings]) + np.array([180.0, 179.0])
    columns = np.random.default_rng(1).uniform([-4, -20, -0.9, -5], [0, 20, 0.9, 5], (45, 4))
    moved = displacements(
        Rig(plate("50_stick"), rest, 360), TRUTH, Labels(*columns.T), np.ones(len(columns))
    )
    cv2.imwrite(str(folder / "frames_bw" / "init_0.png"), frame(rest))
    lines = [HEADER]
    for k, values in enumerate(columns):
        cv2.imwrite(str(folder / "frames_bw" / f"f{k}.png"), frame(rest + moved[k]))
        lines.append(f"f{k}.png," + ",".join(map(str, values)))
    (folder / "targets.csv").write_text("\n".join(lines))
    return folder, columns, moved


def test_presses_are_read_and_their_pins_followed(recording) -> None:
    folder, columns, moved = recording
    presses = read(folder, 40)
    assert presses.names == tuple(f"f{k}.png" for k in range(45))
    assert np.allclose(presses.labels.turn, columns[:, 3])
    assert presses.moved.shape == (45, 61, 2)
    assert presses.complete > 0.9
    # pins come in the order of the rest frame's blobs, so sizes are compared, not places
    assert np.allclose(
        np.nanmean(np.linalg.norm(presses.moved, axis=2)),
        np.linalg.norm(moved, axis=2).mean(),
        rtol=0.05,
    )


def corrupt(folder, target, change):
    """A copy of a recording with another table; change: (N, 4) columns -> (N, 4)."""
    names, *rows = (line.split(",") for line in (folder / "targets.csv").read_text().splitlines())
    columns = change(np.array([row[1:] for row in rows], dtype=float))
    lines = [",".join(names)]
    lines += [",".join([row[0], *map(str, v)]) for row, v in zip(rows, columns, strict=True)]
    (target / "targets.csv").write_text("\n".join(lines))
    shutil.copytree(folder / "frames_bw", target / "frames_bw")
    return target


def permuted(columns, which):
    out = columns.copy()
    out[:, which] = np.random.default_rng(0).permutation(out[:, which])
    return out


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda c: permuted(c, 0),
            "do not spread as the depth label says|no plate on the dome explains",
        ),
        (lambda c: permuted(c, 1), "do not spread where the plate is tilted to"),
        (lambda c: c * [1, -1, 1, 1], "towards -90 deg of the frame"),
    ],
    ids=["depths of others", "tilts of others", "flipped tilt"],
)
def test_labels_that_the_pins_contradict_are_refused(
    recording, tmp_path, monkeypatch, change, told
) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tactibench.datasets.pivot.LEAST_SHEARED", 1.0)
    monkeypatch.setattr("tactibench.datasets.pivot.FEWEST", 20)
    monkeypatch.setattr("tactibench_sim.real.comparison.FEWEST", 10)
    with pytest.raises(UserError, match=told):
        compare(corrupt(recording[0], tmp_path, change))


def test_a_fit_that_does_not_explain_the_pins_is_refused() -> None:
    labels = Labels(*np.array([[-2.0, 5.0, 4.0, 0.0]] * 4).T)
    presses = Presses(tuple("abcd"), labels, np.zeros((3, 2)), np.ones((4, 3, 2)), 360)

    def off_by(share):
        return Errors(presses.moved, presses.moved, np.full(4, share))

    folder = Path("here")
    _refuse_misfit(folder, presses, off_by(0.3), off_by(0.2))
    with pytest.raises(UserError, match="no plate on the dome explains the pins of here"):
        _refuse_misfit(folder, presses, off_by(0.6), off_by(0.5))
    with pytest.raises(UserError, match="not dragged as move_1 and move_6 say"):
        _refuse_misfit(folder, presses, off_by(0.6), off_by(0.2))


def test_first_touch_found_in_two_ways_must_agree() -> None:
    labels = Labels(*np.array([[-2.0, 5.0, 4.0, 0.0]] * 4).T)
    _refuse_disagreement(Path("here"), labels, TRUTH, LabelFit(5.1, 20.0, 0.0))
    with pytest.raises(UserError, match=r"0\.50 mm apart"):
        _refuse_disagreement(Path("here"), labels, TRUTH, LabelFit(5.5, 20.0, 0.0))


def test_too_few_presses_are_refused(recording) -> None:
    with pytest.raises(UserError, match="45 presses"):
        read(recording[0], 46)


def test_a_folder_without_labels_is_refused(tmp_path) -> None:
    with pytest.raises(UserError, match=r"targets\.csv"):
        read(tmp_path / "nowhere", 10)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("image_name,pose_2,pose_6\na.png,1,2", "move_1, move_6"),
        (HEADER + "\na.png,1,nan,0,0", "line 2"),
        (HEADER + "\na.png,1,2,0,0\nb.png,deep,2,0,0", "line 3"),
        ("", "CSV"),
    ],
)
def test_a_bad_table_is_refused(tmp_path, text, told) -> None:
    (tmp_path / "targets.csv").write_text(text)
    with pytest.raises(UserError, match=told):
        read(tmp_path, 1)


def test_a_missing_frame_is_refused(tmp_path) -> None:
    (tmp_path / "targets.csv").write_text(HEADER + "\na.png,1,2,0,0")
    with pytest.raises(UserError, match=r"init_0\.png"):
        read(tmp_path, 1)


def test_a_rest_frame_without_pins_is_refused(tmp_path) -> None:
    (tmp_path / "targets.csv").write_text(HEADER + "\na.png,1,2,0,0")
    (tmp_path / "frames_bw").mkdir()
    cv2.imwrite(str(tmp_path / "frames_bw" / "init_0.png"), frame([]))
    with pytest.raises(UserError, match="the rest frame shows 0 pins"):
        read(tmp_path, 1)


def test_the_command_refuses_before_it_works(tmp_path) -> None:
    result = CliRunner().invoke(real, [str(tmp_path), "--out", str(tmp_path / "no" / "p.png")])
    assert isinstance(result.exception, UserError)
    assert "p.png" in str(result.exception)


@pytest.mark.slow
def test_the_command_prints_a_table_and_draws(recording, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tactibench.datasets.pivot.LEAST_SHEARED", 1.0)
    monkeypatch.setattr("tactibench.datasets.pivot.FEWEST", 20)
    monkeypatch.setattr("tactibench_sim.real.comparison.FEWEST", 10)
    monkeypatch.setattr("tactibench_sim.real.comparison.kinds", lambda: ("50_stick",))
    picture = tmp_path / "p.png"
    numbers = tmp_path / "n.json"
    command = [str(recording[0]), "--fit", "20", "--out", str(picture), "--json", str(numbers)]
    monkeypatch.setattr(real.params[2].type, "min", 10)
    CliRunner().invoke(real, command, catch_exceptions=False)
    told = {(r["metric"], r["group"]): r["value"] for r in json.loads(numbers.read_text())}
    assert told["presses fitted", "all"] == 20
    assert told["presses", "all"] >= 10
    assert told["presses", "all"] + told["presses", "fitted blocks, all"] == 45
    assert told["median relative error", "all"] < 0.2  # pins of 8 px: a third of a px
    assert cv2.imread(str(picture)) is not None
