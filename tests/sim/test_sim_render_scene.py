"""Scenes written as text."""

import pytest

from tactibench import Indenter, Pose, Scene, UserError
from tactibench_sim.commands.scene_text import read_scene


@pytest.mark.parametrize(
    ("text", "scene"),
    [
        ("single@depth=3", Scene(Indenter.single(), Pose(depth=3))),
        ("single@radius=4,depth=1", Scene(Indenter.single(4.0), Pose(depth=1))),
        ("dual:7@x=1,y=-2,yaw=30,depth=2", Scene(Indenter.dual(7), Pose(1, -2, 30, 0, 2))),
        ("dual: 7 @ depth = 2", Scene(Indenter.dual(7), Pose(depth=2))),
        ("triple:0,1,2@depth=3", Scene(Indenter.triple((0, 1, 2)), Pose(depth=3))),
        (
            "triple:0,0,.5@side=10,depth=3",
            Scene(Indenter.triple((0, 0, 0.5), side=10), Pose(depth=3)),
        ),
        ("plate@tilt=10,yaw=45,depth=2", Scene(Indenter.plate(), Pose(0, 0, 45, 10, 2))),
    ],
)
def test_a_line(text, scene):
    assert read_scene(text) == scene


@pytest.mark.parametrize(
    ("lines", "scene"),
    [
        ("indenter='triple'\nheights=[0,1,2]\ndepth=3", read_scene("triple:0,1,2@depth=3")),
        ("indenter='dual'\ndistance=7.0\nx=1\ndepth=2", read_scene("dual:7@x=1,depth=2")),
        (
            "indenter='custom'\noffsets=[[0,0,0],[8,0,0.5]]\nradius=2.5\ndepth=2",
            Scene(Indenter(2.5, ((0, 0, 0), (8, 0, 0.5)), "custom"), Pose(depth=2)),
        ),
    ],
)
def test_a_file(lines, scene, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(lines)
    assert read_scene(str(file)) == scene


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("daul:7@depth=2", "did you mean 'dual'"),
        ("cone@depth=2", "known: custom, dual"),
        ("", "known: custom"),
        ("single@dept=2", "did you mean 'depth'"),
        ("single@distance=7,depth=2", "which single has not"),
        ("single", "add for example depth=2"),
        ("dual@depth=2", "for example dual:7"),
        ("dual:7,8@depth=2", "distance"),
        ("dual:-7@depth=2", "above 0"),
        ("single:7@depth=2", "only dual and triple"),
        ("triple:0,1@depth=2", "3 numbers"),
        ("triple:0,1,x@depth=2", "where a number must be"),
        ("single@depth", "NAME=VALUE"),
        ("single@", "NAME=VALUE"),
        ("single@depth=2,depth=3", "twice"),
        ("single@depth=nan", "finite"),
        ("plate@x=3,depth=2", "only yaw, tilt, depth and dx, dy, dyaw"),
        ("nowhere.toml", "does not exist"),
    ],
)
def test_a_mistake_gets_one_sentence(text, named):
    with pytest.raises(UserError, match=named) as caught:
        read_scene(text)
    assert str(caught.value)[-1] in ".?"
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "named"),
    [
        ("indenter = ", "cannot be read as TOML"),
        ("depth = 2", "indenter None"),
        ("indenter='custom'\noffsets=3\ndepth=2", "list of"),
        ("indenter='custom'\noffsets=[[0,0]]\ndepth=2", "3 numbers"),
        ("indenter='custom'\ndepth=2", "does not say its offsets"),
        ("indenter='single'\ndepth='2'", "finite number"),
        ("indenter='single'\ndepth=true", "finite number"),
        ("indenter=['single']\ndepth=2", "has the indenter"),
        ("indenter='dual'\ndistance=[7]\ndepth=2", "above 0"),
    ],
)
def test_a_mistake_in_a_file(lines, named, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(lines)
    with pytest.raises(UserError, match=named) as caught:
        read_scene(str(file))
    assert str(caught.value)[-1] in ".?"
