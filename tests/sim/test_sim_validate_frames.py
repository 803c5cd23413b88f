"""The reference scenes as frames."""

import csv
import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import SensorContext, UserError
from tactibench_sim.commands.validate import validate as command
from tactibench_sim.reference_frames import scenes as reference
from tactibench_sim.reference_frames.frames import frames, write
from tactibench_sim.sensor import TacTip127, TacTip331

SCENES = reference.shipped()[:4]
SEED = np.random.SeedSequence(5)


def sensor(kind=TacTip127, **settings):
    return kind(SensorContext(np.random.SeedSequence(0)), **settings)


@pytest.mark.parametrize(
    ("kind", "pins"), [(TacTip331, slice(0, 331)), (TacTip127, slice(331, 458))]
)
def test_frames_show_the_pins_of_the_scene(kind, pins):
    made = sensor(kind, noise=False)
    found = frames(made, SCENES, SEED)
    for image, scene in zip(found, SCENES, strict=True):
        tips = 19 * scene.directions + scene.displacement - 2 * scene.normals
        assert (image == made.renderer.frames(tips[None, pins])[0]).all()
        assert (image != made.rest().image).any()


def test_frames_look_like_those_of_the_tiers():
    made = sensor(noise=False)
    shallow = next(s for s in SCENES if s.depth <= 1)
    found = frames(made, [shallow], SEED)[0].astype(float)
    tier = made.renderer.clean(made.places(shallow.as_tips))[0]
    rest = made.rest().image.astype(float)
    assert np.abs(found - tier).mean() < 0.5 * np.abs(found - rest).mean()


def test_noise_follows_the_seed():
    made = sensor()
    first = frames(made, SCENES, SEED)
    assert (first == frames(made, SCENES, SEED)).all()
    assert (first != frames(made, SCENES, np.random.SeedSequence(6))).any()
    quiet = frames(sensor(noise=False), SCENES, SEED)
    spread = (first.astype(float) - quiet).std()
    assert 1.0 < spread < 3.5


def test_lost_pins_stay_lost():
    made = sensor(pin_loss=0.3, instance=2, noise=False)
    assert len(made.directions) < 127
    found = frames(made, SCENES, SEED)
    whole = frames(sensor(instance=2, noise=False), SCENES, SEED)
    assert found.astype(float).mean() < whole.astype(float).mean()


def test_a_sensor_with_other_pins_is_refused():
    made = sensor()
    made.directions = made.directions[:, [1, 2, 0]]
    with pytest.raises(UserError, match="tactip-127"):
        frames(made, SCENES, SEED)


@pytest.mark.parametrize("output", ["grey", "rgb"])
def test_the_folder_holds_frames_and_their_contacts(tmp_path, output):
    made, folder = sensor(output=output), tmp_path / "set"
    assert write(folder, made, SCENES, 5) == len(SCENES)
    expected = frames(made, SCENES, SEED)
    with (folder / "contacts.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for image, scene in zip(expected, SCENES, strict=True):
        own = [row for row in rows if row["sensor_image"] == f"{scene.name}_d{scene.depth:.3g}.png"]
        tips = [[float(row[k]) for k in ("x_mm", "y_mm", "depth_mm")] for row in own]
        assert np.array(tips) == pytest.approx(scene.tips, abs=1e-6)
        assert {row["scene"] for row in own} == {scene.name}
        assert {row["radius_mm"] for row in own} == {"3"}
        stored = cv2.imread(str(folder / "images" / own[0]["sensor_image"]), cv2.IMREAD_UNCHANGED)
        assert (stored == (image[..., ::-1] if output == "rgb" else image)).all()
    assert len(rows) == sum(len(scene.tips) for scene in SCENES)
    assert (folder / "images" / "init_0.png").is_file()
    about = json.loads((folder / "sensor.json").read_text())
    assert about["reference_sha256"] == reference.shipped_file().digest
    assert about["seed"] == 5
    assert about["sensor"]["sensor"] == "tactip-127"


def test_a_folder_in_use_is_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("kept")
    with pytest.raises(UserError, match="no empty folder"):
        write(tmp_path, sensor(), SCENES, 0)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_the_command_writes_every_scene(tmp_path):
    folder = tmp_path / "set"
    given = ["--frames", str(folder), "--sensor", "tactip-331"]
    done = CliRunner().invoke(command, given, catch_exceptions=False)
    assert done.exit_code == 0
    assert str(folder) in done.output
    assert len(list((folder / "images").iterdir())) == len(reference.shipped()) + 1


@pytest.mark.parametrize("other", ["planar-grid", "fitted-127"])
def test_a_sensor_of_another_kind_is_refused(tmp_path, other):
    given = ["--frames", str(tmp_path / "set"), "--sensor", other]
    with pytest.raises(UserError, match=f"take one of them as --sensor, not '{other}'"):
        CliRunner().invoke(command, given, catch_exceptions=False)
