"""How good a sensor is: noise, repeatability and drift of recordings made with known ones."""

from __future__ import annotations

from pathlib import Path

import drawn_pins
import numpy as np
import pytest

from tactibench.datasets import (
    ImportOptions,
    Measure,
    SensorReport,
    Signals,
    measure_signals,
    open_recording,
    report_sensor,
)
from tactibench.png import encode_png
from tactibench.report import sensor_page

CHANNELS = 30


def skin(
    noise: float, drift: float, *, repeats: int = 5, resting: int = 40, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """(600, 3) poses and (600, CHANNELS) signals; the drift is that of its root mean square."""
    rng = np.random.default_rng(seed)
    presses = rng.uniform((-5, -5, 0.5), (5, 5, 4), (600 // repeats, 3))
    poses = rng.permutation(np.repeat(presses, repeats, axis=0))
    poses[rng.choice(600, resting, replace=False)] = 0.0
    places, course = rng.uniform(-6, 6, (CHANNELS, 2)), rng.normal(size=CHANNELS)
    near = np.exp(-((poses[:, None, :2] - places) ** 2).sum(axis=2) / 50)
    values = poses[:, 2:] ** 1.3 * near + noise * rng.normal(size=near.shape)
    values += np.outer(np.linspace(0, drift, 600), course / np.sqrt(np.mean(course**2)))
    return poses, values


def signals(poses: np.ndarray, values: np.ndarray) -> Signals:
    columns = dict(zip(("x", "y", "depth"), poses.T, strict=True))
    order = np.arange(600.0)
    return Signals(values, columns, 3, order, poses[:, 2] <= 0, np.zeros(CHANNELS))


def lines(report: SensorReport) -> dict[str, Measure]:
    return {line.name.partition(" (")[0]: line for line in report.measures}


def value(report: SensorReport, name: str) -> float:
    found = lines(report)[name].value
    assert found is not None, lines(report)[name].remark
    return found


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("noise", "drift"), [(0.05, 0.3), (0.2, 0.3), (0.05, 0.0), (0.02, 1.0)])
def test_noise_repeatability_and_drift_are_those_of_the_recording(
    noise: float, drift: float, seed: int
) -> None:
    report = measure_signals(signals(*skin(noise, drift, seed=seed)))
    assert value(report, "noise at rest") == pytest.approx(noise, rel=0.15)
    assert value(report, "repeatability") == pytest.approx(noise, rel=0.1)
    found = value(report, "drift over the recording")
    assert found == pytest.approx(drift, rel=0.1, abs=0.15 * noise)
    if drift == 0 or drift > 4 * noise:
        assert report.limit.startswith("Drift" if drift else "Scatter")


@pytest.mark.parametrize("drift", [0.0, 0.3])
def test_drift_is_found_where_nothing_was_repeated(drift: float) -> None:
    report = measure_signals(signals(*skin(0.05, drift, repeats=1, resting=0)))
    assert lines(report)["repeatability"].value is None
    assert lines(report)["noise at rest"].value is None
    assert value(report, "drift over the recording") == pytest.approx(drift, rel=0.1, abs=0.02)


def test_drift_is_not_told_from_labels_that_follow_the_time() -> None:
    poses, values = skin(0.05, 0.3, repeats=1, resting=0)
    order = np.argsort(poses[:, 0])
    report = measure_signals(signals(poses[order], values[order]))
    assert lines(report)["drift over the recording"].value is None
    assert "labels follow the order" in lines(report)["drift over the recording"].remark


@pytest.mark.parametrize("repeats", [1, 5])
def test_the_bound_of_a_linear_sensor_is_that_of_least_squares(repeats: int) -> None:
    rng = np.random.default_rng(5)
    poses = np.repeat(rng.uniform(-5, 5, (600 // repeats, 2)), repeats, axis=0)
    slope = rng.normal(size=(2, 8))
    values = poses @ slope + 0.1 * rng.normal(size=(600, 8))
    given = Signals(
        values,
        {"x": poses[:, 0], "y": poses[:, 1]},
        2,
        rng.permutation(np.arange(600.0)),
        np.zeros(600, dtype=bool),
    )
    truth = 0.1 * np.sqrt(np.diag(np.linalg.inv(slope @ slope.T)))
    report = measure_signals(given)
    for name, best in zip("xy", truth, strict=True):
        assert value(report, f"best possible {name}") == pytest.approx(best, rel=0.12)


def test_the_smallest_press_that_differs_from_rest() -> None:
    rng = np.random.default_rng(6)
    depth = np.repeat(rng.uniform(0.05, 2.0, 300), 2)
    depth[:60] = 0.0
    values = depth[:, None] * np.ones(10) + 0.1 * rng.normal(size=(600, 10))
    given = Signals(values, {"depth": depth}, 1, np.arange(600.0), depth <= 0, np.zeros(10))
    smallest = value(measure_signals(given), "smallest press that differs from rest")
    assert smallest == pytest.approx(0.3, abs=0.06)  # three times the noise


@pytest.mark.parametrize("count", [60, 100])
def test_how_many_presses_the_limit_needs_is_said(count: int) -> None:
    poses, values = skin(0.05, 0.0, repeats=1, resting=0)
    columns = dict(zip(("x", "y", "depth"), poses[:count].T, strict=True))
    resting = np.arange(count) >= 79  # of 100 presses the last touch nothing
    given = Signals(values[:count], columns, 3, np.arange(float(count)), resting, None)
    touching = f"{min(count, 79)} presses have labels of one contact, and 80 are needed"
    assert touching in measure_signals(given).limit


def write_skin(folder: Path, time: str = "time") -> Path:
    """A skin that drifts, with a dead and a saturated channel, and stretches that froze."""
    poses, values = skin(0.05, 0.3)
    values[:, 1] = np.minimum(values[:, 1], np.quantile(values[:, 1], 0.9))
    values[:, 2] = 7.0
    for start in (100, 200, 400):
        values[start : start + 4] = values[start]
    times = 0.1 * np.arange(600.0)
    times[[300, 301]] = times[[301, 300]]
    np.savetxt(folder / "field.csv", values, delimiter=",", fmt="%.9g")
    table = np.column_stack([poses, times])
    head = f"x_mm,y_mm,depth_mm,{time}"
    np.savetxt(folder / "labels.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
    return folder


@pytest.mark.parametrize("time", ["time", "Time", "time [s]", "t (s)", "t_ms", "Time stamp [s]"])
def test_faults_of_a_skin_are_counted(tmp_path: Path, time: str) -> None:
    options = ImportOptions(channels="field.csv", surface="flat")
    report = report_sensor(open_recording(write_skin(tmp_path, time), options), options)
    assert value(report, "dead channels") == 1
    assert value(report, "saturated channels") == 1
    assert value(report, "frozen frames") == 9
    assert value(report, "times out of order") == 1
    assert value(report, "drift over the recording") == pytest.approx(0.3, rel=0.25)
    assert "9 frames of 600: equal to the one before" in report.limit


def test_a_skin_whose_depth_is_not_known_has_a_bound_of_its_places(tmp_path: Path) -> None:
    poses, values = skin(0.05, 0.0, resting=0)
    poses = poses[:, :2] + np.random.default_rng(3).normal(scale=1e-3, size=(600, 2))
    np.savetxt(tmp_path / "field.csv", values, delimiter=",", fmt="%.9g")
    np.savetxt(tmp_path / "labels.csv", poses, delimiter=",", header="x_mm,y_mm", comments="")
    options = ImportOptions(
        channels="field.csv", surface="flat", indenter="single", x="x_mm", y="y_mm"
    )
    report = report_sensor(open_recording(tmp_path, options), options)
    assert {"best possible x", "best possible y"} <= lines(report).keys()
    assert "best possible depth" not in lines(report)
    assert "not known" not in sensor_page(report, "skin", "600 frames")


def test_the_way_in_and_the_way_out_are_compared(tmp_path: Path) -> None:
    """On the way out the signal is larger by a tenth of its range."""
    depth = np.tile(np.r_[np.linspace(0, 2, 9), np.linspace(1.75, 0, 8)], 20)
    out = np.tile(np.r_[np.zeros(9), np.ones(8)], 20) * (depth > 0)
    press = np.repeat(np.arange(20), 17)
    rng = np.random.default_rng(7)
    level = depth[:, None] + 0.2 * out[:, None] + 1e-3 * rng.normal(size=(340, 4))
    np.savetxt(tmp_path / "field.csv", level, delimiter=",")
    rows = np.column_stack([press % 5, press // 5, depth, press])
    head = "x_mm,y_mm,depth_mm,trial"
    np.savetxt(tmp_path / "labels.csv", rows, delimiter=",", header=head, comments="")
    options = ImportOptions(channels="field.csv", surface="flat", press="trial")
    report = report_sensor(open_recording(tmp_path, options), options)
    assert value(report, "hysteresis") == pytest.approx(-9, abs=1.5)


@pytest.fixture(scope="module")
def pin_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hundred presses of a drawn sensor with 37 pins, each frame taken twice."""
    folder = tmp_path_factory.mktemp("pins")
    rng = np.random.default_rng(8)
    (folder / "init_0.png").write_bytes(encode_png(drawn_pins.draw(drawn_pins.REST)))
    rows = ["file_name,x_mm,y_mm,depth_mm"]
    for number, (x, y, depth) in enumerate(rng.uniform((-4, -4, 1), (4, 4, 4), (100, 3))):
        for again in range(2):
            name = f"{number}_{again}.png"
            pins = drawn_pins.pushed(x, y, depth) + rng.normal(0, 0.05, (37, 2))
            (folder / name).write_bytes(encode_png(drawn_pins.draw(pins)))
            rows.append(f"{name},{x},{y},{depth}")
    (folder / "labels.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_pins_of_a_recording_are_measured(pin_folder: Path) -> None:
    report = report_sensor(open_recording(pin_folder), ImportOptions())
    assert value(report, "pins found at rest") == 37
    assert value(report, "pins lost") < 1
    for axis in "xy":  # pins flee from the contact, somewhat less far than it moves
        scale = value(report, f"scale along {axis}")
        assert scale == pytest.approx(drawn_pins.PX_PER_MM, rel=0.25)
    assert value(report, "repeatability") == pytest.approx(0.05, rel=0.3)
    assert value(report, "best possible x") < 0.3
    assert "Scatter limits" in report.limit
