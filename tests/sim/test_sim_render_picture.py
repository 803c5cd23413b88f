"""The picture of one press: what its panels are drawn from, and the command."""

import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim.commands import press_picture as picture
from tactibench_sim.commands.render import render
from tactibench_sim.commands.scene_text import read_scene
from tactibench_sim.sensor import TacTip127

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def sensor():
    return TacTip127(SensorContext(np.random.SeedSequence(0)), noise=False, vignetting=0.0)


def size_of(path):
    """Width and height from the header."""
    raw = path.read_bytes()
    assert raw.startswith(PNG)
    return int.from_bytes(raw[16:20]), int.from_bytes(raw[20:24])


def test_rest_rings_lie_on_the_pins_of_the_rest_frame(sensor):
    """The brightness around every ring has its centroid in the ring's middle."""
    image = sensor.rest().image.astype(float) - 16
    for x, y, _ in picture.marker_pixels(sensor, Scene(Indenter.single(), Pose())):
        rows, columns = np.mgrid[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
        light = image[rows, columns].clip(0)
        centre = [(light * columns).sum() / light.sum(), (light * rows).sum() / light.sum()]
        assert centre == pytest.approx([x, y], abs=0.5)


def test_the_arrows_spread_from_the_contact(sensor):
    scene = Scene(Indenter.single(), Pose(depth=2.0))
    before = picture.marker_pixels(sensor, Scene(scene.indenter, Pose()))[:, :2]
    moved = picture.marker_pixels(sensor, scene)[:, :2] - before
    middle = (sensor.renderer.optics.size - 1) / 2
    near = np.hypot(*(before - middle).T)
    inner = (near > 1) & (near < 15)
    assert (((before - middle) * moved).sum(axis=1)[inner] > 0).all()
    assert np.hypot(*moved.T)[inner].min() > 0.3


def test_the_cap_is_the_dome_with_a_dent_under_the_tip(sensor):
    x, y, z, inward = picture.skin_cap(sensor, read_scene("single@x=4,depth=2"), 26, 48)
    assert np.sqrt(x**2 + y**2 + (z + 20) ** 2) == pytest.approx(20 - inward, abs=1e-9)
    deepest = np.unravel_index(inward.argmax(), inward.shape)
    assert [x[deepest], y[deepest]] == pytest.approx([4 * 20 / 21, 0], abs=0.6)
    assert inward.max() == pytest.approx(1.96, abs=0.06)
    untouched = picture.skin_cap(sensor, Scene(Indenter.single(), Pose()), 26, 48)[3]
    assert (untouched == 0).all()


@pytest.mark.parametrize(
    ("longest", "times"), [(20.0, 1), (8.0, 1), (3.9, 2), (0.15, 50), (0.01, 100), (0.0, 100)]
)
def test_arrows_stay_within_their_neighbourhood(longest, times):
    assert picture.exaggeration(longest, 5.0) == times


@pytest.mark.long
def test_the_command_writes_a_picture_of_what_it_is_asked(tmp_path):
    first, second = tmp_path / "1.png", tmp_path / "2.png"
    options = ["--sensor", "tactip-331", "--param", "output=rgb", "--param", "sensor.size=64"]
    for out, more in ((first, []), (second, options)):
        result = CliRunner().invoke(
            render, ["plate@tilt=10,depth=2", "--out", str(out), *more], catch_exceptions=False
        )
        assert result.output.endswith(f"picture: {out}\n")
        assert size_of(out) == (2440, 800)
    assert first.read_bytes() != second.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.png", "2.png"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["single@depth=2", "--out", "press.jpg"], r"call it press\.png"),
        (["single@depth=2", "--out", "no/press.png"], "folder no of --out is not there"),
        (["single@depth=2", "--out", "p.png", "--sensor", "tacto"], "known: .*tactip-127"),
        (["single@depth=2", "--out", "p.png", "--param", "model.x=1"], "sensor.NAME=VALUE"),
        (["single@depth=2", "--out", "p.png", "--param", "teir=coupled"], "did you mean 'tier'"),
        (
            ["single@depth=2", "--out", "p.png", "--param", "instances=4"],
            "shows one sensor instance",
        ),
        (
            ["single@depth=2", "--out", "p.png", "--param", "size=64", "--param", "sensor.size=64"],
            "given twice",
        ),
        (["single@depth=9", "--out", "p.png"], "tables end"),
        (["singel@depth=2", "--out", "p.png"], "did you mean 'single'"),
    ],
)
def test_mistakes_write_nothing(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=named):
        CliRunner().invoke(render, arguments, catch_exceptions=False)
    assert not list(tmp_path.iterdir())
