"""Recordings that know where something pressed, and not how deep: position, and force, alone."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactibench import Contacts, Indenter, Pose, Scene, UserError, api
from tactibench.board import Source, add, verify
from tactibench.contacts import Workspace
from tactibench.datasets import Dataset, import_folder, open_recording, own_workspace, read_options
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost
from tactibench.protocols import in_range, load_protocol
from tactibench.records import StoredRun, pack, unpack_contacts
from tactibench.run import NullReporter, execute

SIDE, COUNT, RESTING = 40.0, 260, 20
"""Half the side of the skin, mm, its presses, and the rows in which nothing touches it."""
SENSORS = np.array([[x, y] for x in (-30, 0, 30) for y in (-30, 0, 30)], dtype=np.float64)
REST = 5.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with x, y and force of a skin of nine channels."""
    return press(tmp_path_factory.mktemp("skin") / "lab", seed=5, rest=REST)


def press(where: Path, seed: int, rest: float) -> Path:
    """Write a session of the skin, whose channels have a value at rest."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-SIDE, SIDE, (COUNT, 2))
    force = rng.uniform(0.5, 4.0, COUNT)
    force[rng.permutation(COUNT)[:RESTING]] = 0.0
    apart = np.linalg.norm(xy[:, None] - SENSORS, axis=2)
    channels = rest + force[:, None] * np.exp(-((apart / 30) ** 2))
    channels += rng.normal(0, 0.003, channels.shape)
    where.mkdir()
    rows = np.column_stack([xy + 50, force])
    np.savetxt(where / "labels.csv", rows, delimiter=",", header="px,py,load", comments="")
    np.savetxt(where / "channels.csv", channels, delimiter=",")
    return where


OPTIONS = (
    "table=labels.csv",
    "channels=channels.csv",
    "indenter=single",
    "surface=flat",
    "x=px",
    "x_zero_mm=50",
    "y=py",
    "y_zero_mm=50",
)


@pytest.fixture(scope="module")
def skin(folder: Path) -> Dataset:
    """Return the data set, with force and without depth."""
    return import_folder(folder, folder.parent / "set", read_options([*OPTIONS, "force=load"]))


def test_a_truth_without_depths_says_so() -> None:
    truth = Contacts.truth([[1.0, 2.0], [3.0, 4.0]])
    assert not truth.knows_depth
    assert np.isnan(truth.depth).all()
    assert len(truth.top(1)) == 1
    assert Contacts.none().knows_depth
    with pytest.raises(ValueError, match="depth holds"):  # one of two is a mistake
        Contacts.truth([[1.0, 2.0], [3.0, 4.0]], [1.0, math.nan])


@pytest.mark.parametrize("radius", [20.0, math.inf])
@pytest.mark.parametrize(("depth", "touches"), [(math.nan, 1), (0.0, 0), (-1.0, 0), (1.0, 1)])
def test_a_tip_of_unknown_depth_touches(radius: float, depth: float, touches: int) -> None:
    scene = Scene(Indenter.single(), Pose(1.0, 2.0, depth=depth))
    assert len(true_contacts(scene, radius)) == touches


def test_answers_come_back_with_what_they_know() -> None:
    force = [[0.0, 0.0, -2.0]]
    answers = [Contacts.truth([[1.0, 2.0]], force=force), Contacts.none()]
    first, second = unpack_contacts(pack(answers, "contacts"))
    assert not first.knows_depth
    assert np.array_equal(first.force, force)
    assert not len(second)
    mixed = [*answers, Contacts.truth([[1.0, 2.0]])]  # not known of all: of none
    assert "force" not in pack(mixed, "contacts")


def test_a_gate_is_a_share_of_the_half_width() -> None:
    spec = load_protocol("exp1").spec
    wide = in_range(spec, Workspace(70.0, math.nan, math.nan, math.inf))
    assert wide.test.gate_mm == pytest.approx(3.0 * 70 / 6.4)
    assert wide.workspace.depth_max_mm == spec.workspace.depth_max_mm


def test_the_import_says_what_is_known(folder: Path, skin: Dataset) -> None:
    recording = open_recording(folder, read_options([*OPTIONS, "force=load"]))
    assert any("depth is not known" in note for note in recording.notes)
    assert any(note.startswith(f"{RESTING} rows touch nothing") for note in recording.notes)
    touching = [skin.contacts(sample) for sample in skin.samples]
    assert sum(len(contacts) for contacts in touching if contacts) == COUNT - RESTING
    assert skin.rest is not None
    assert np.abs(skin.rest - REST).max() < 0.01
    loads = np.loadtxt(folder / "labels.csv", delimiter=",", skiprows=1)[:, 2]
    forces = [-contacts.force[0, 2] if len(contacts) else 0.0 for contacts in touching]
    assert np.allclose(forces, loads)
    space = own_workspace([sample.scene for sample in skin.samples], math.inf)
    assert space is not None
    assert str(space).endswith("depth not known, flat")


def run(model: str, data: Path, store: Path) -> StoredRun:
    """Return a short run of exp1, without times."""
    made = api.plan("exp1", model, data=data, store=store, quick=True)
    return execute(made, NullReporter(), timed=False)


def test_exp1_scores_what_is_known(skin: Dataset, tmp_path: Path) -> None:
    done = run("kernel", skin.folder, tmp_path)
    by_axis = {m.group: m.value for m in done.record.metrics if m.metric == "mae_mm"}
    assert by_axis["z"] is None
    assert by_axis["mean"] == pytest.approx((by_axis["x"] + by_axis["y"]) / 2)
    assert by_axis["mean"] < 4.0  # guessing the mean is off by 20 mm
    force = done.record.metric("force_mae_n", "all")
    assert force.value is not None
    assert force.value < 0.3  # guessing the mean: 0.9 N
    pressed = done.record.sensor.range
    assert pressed.gate_mm == pytest.approx(3.0 * pressed.half_width_mm / 6.4)
    assert f"depth not known, flat, gate {pressed.gate_mm:.3g} mm" in pressed.text()
    assert api.score(done).differences == ()


def test_a_row_is_verified_with_the_gate_of_its_skin(skin: Dataset, tmp_path: Path) -> None:
    made = api.plan("exp1", "mean", data=skin.folder, store=tmp_path / "runs")
    record, _ = add(execute(made, NullReporter(), timed=False), tmp_path / "board")
    verdict = verify(record, Source(PluginHost(), tmp_path / "cache", data=skin.folder))
    gospa = {row.group: row.value for row in verdict.again if row.metric == "gospa_depth_mm"}
    assert gospa["all"] > 3.0  # the gate of the protocol, beyond which no error counts


@pytest.mark.long
@pytest.mark.parametrize("model", ["mean", "nearest", "pins"])
def test_every_model_of_channels_answers_what_is_known(
    model: str, skin: Dataset, tmp_path: Path
) -> None:
    done = run(model, skin.folder, tmp_path)
    assert done.record.metric("mae_mm", "z").value is None
    assert done.record.metric("mae_mm", "x").value is not None
    assert done.record.metric("force_mae_n", "all").value is not None


@pytest.mark.parametrize("shots", [0, 30])
def test_another_session_is_tested_on(
    shots: int, folder: Path, skin: Dataset, tmp_path: Path
) -> None:
    later = press(tmp_path / "later", seed=6, rest=REST + 0.7)
    options = read_options([*OPTIONS, "force=load"])
    session = import_folder(later, tmp_path / "set", options)
    test = (f"data={session.folder}", *([f"shots={shots}"] if shots else []))
    made = api.plan("exp1", "pins", data=skin.folder, test=test, store=tmp_path, quick=True)
    (tested,), shown = made.frames.test, made.frames.few_shot
    assert len({pose_of(scene) for scene in tested.scenes} & scenes_of(session)) == 40
    assert (0 if shown is None else len(shown.scenes)) == shots
    assert not set(() if shown is None else shown.clusters) & set(tested.clusters)
    done = execute(made, NullReporter(), timed=False)
    # Each session is zeroed by its own rest; 0.7 would be a third of a press.
    assert done.record.metric("mae_mm", "mean").value < 3.0
    assert done.record.test_sensor.description == f"recording {tmp_path.name}/set"


def pose_of(scene: Scene) -> tuple[float, float]:
    return scene.pose.x, scene.pose.y


def scenes_of(dataset: Dataset) -> set[tuple[float, float]]:
    return {pose_of(sample.scene) for sample in dataset.samples if sample.scene is not None}


def test_a_simulated_sensor_is_not_tested_on_a_recording(skin: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="tests on another recording than --data"):
        api.plan("exp1", "kernel", test=(f"data={skin.folder}",), store=tmp_path)


def test_a_ranking_by_depth_is_refused_before_any_work(skin: Dataset, tmp_path: Path) -> None:
    made = api.plan("exp1", "kernel", data=skin.folder, store=tmp_path)
    from tactibench.run.components import check_depth

    ranked = replace(made.protocol, spec=load_protocol("surface").spec)
    with pytest.raises(UserError, match="ranks by depth_mae_mm, but nobody knows how deep"):
        check_depth(made.components, ranked, None)


def test_a_force_of_several_tips_is_refused(folder: Path) -> None:
    options = [o for o in OPTIONS if not o.startswith("indenter")]
    given = read_options([*options, "indenter=dual", "spacing=8", "force=load"])
    with pytest.raises(UserError, match="force names the force of one tip"):
        open_recording(folder, given)
