"""Models that read channels, and those that do not."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import Frame, Grid, ModelContext, Pose, UserError
from tactibench.plugins import Origin, PluginHost, installed
from tactibench.run import NullProgress, RunRequest, make_plan

MODELS = {"nearest": {}, "kernel": {}, "pins": {"members": 2, "width": 64, "epochs": 30}}
CONTEXT = ModelContext(answer="contacts", grid=Grid.centred(64, 0.75), max_depth=4.0)


@pytest.fixture(scope="module")
def host(skin: Any) -> PluginHost:
    """Return the plugins that are installed, and the skin."""
    point = EntryPoint("soft_skin", "tactibench_soft_skin.hooks", "tactibench")
    return PluginHost([*installed(), (point, Origin("soft_skin", "tactibench-soft-skin", "1"))])


@pytest.fixture(scope="module", params=MODELS)
def trained(request: pytest.FixtureRequest, host: PluginHost, press_skin: Any) -> Any:
    """Return name, model and how to build another one."""
    spec = host.models[request.param]
    values = {**spec.settings({}), **MODELS[request.param]}

    def build() -> Any:
        return spec.build(CONTEXT, **values)

    model = build()
    frames, truth = press_skin(200, 1)
    held_out = press_skin(40, 2)
    model.fit(
        frames,
        truth,
        validation=held_out,
        rng=np.random.default_rng(1),
        progress=NullProgress(),
    )
    return request.param, model, build


def test_presses_are_read(trained: Any, press_skin: Any) -> None:
    name, model, _ = trained
    frames, truth = press_skin(60, 3)
    errors = [
        np.abs([*(one.xy[0] - true.xy[0]), one.depth[0] - true.depth[0]]).mean()
        for one, true in zip(model.predict(frames), truth, strict=True)
    ]
    # The range is 24 x 24 x 3.5 mm: guessing is off by 4 mm, the nearest of 200 presses by 1.
    assert np.mean(errors) < {"nearest": 1.5, "kernel": 0.8, "pins": 0.8}[name]


def test_an_untouched_skin_is_no_contact(trained: Any, press_skin: Any) -> None:
    name, model, _ = trained
    if name == "nearest":
        pytest.skip("it answers with a training press, whatever the frame")
    (frame, *_), _ = press_skin(1, 4)
    still = Frame(frame.rest + np.float32(0.3), 0.0, Pose(), frame.rest)
    (answer,) = model.predict([still])
    assert len(answer) == 0


def test_weights_come_back(trained: Any, press_skin: Any, tmp_path: Path) -> None:
    _, model, build = trained
    model.save(tmp_path)
    again = build()
    again.load(tmp_path)
    frames, _ = press_skin(8, 5)
    for one, other in zip(model.predict(frames), again.predict(frames), strict=True):
        assert np.array_equal(one.xy, other.xy)
        assert np.array_equal(one.depth, other.depth)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: Frame(f.signal[:7], 0.0, Pose(), f.rest[:7]), "7 channels"),
        (lambda f: Frame(f.signal, 0.0, Pose()), "no rest frame"),
        (lambda f: Frame(f.signal * np.float32("nan"), 0.0, Pose(), f.rest), "no finite number"),
    ],
    ids=["fewer", "no rest", "NaN"],
)
def test_other_frames_are_refused(trained: Any, press_skin: Any, change: Any, says: str) -> None:
    _, model, _ = trained
    (frame, *_), _ = press_skin(1, 6)
    with pytest.raises(UserError, match=says):
        model.predict([change(frame)])


def test_a_frame_of_channels_has_no_image(press_skin: Any) -> None:
    (frame, *_), _ = press_skin(1, 7)
    with pytest.raises(UserError, match="15 channels and no image"):
        _ = frame.image


def plan(host: PluginHost, cache: Path, protocol: str, model: str) -> Any:
    return make_plan(RunRequest(protocol, model, sensor="soft_skin"), host, cache)


@pytest.mark.parametrize(
    ("protocol", "model", "says"),
    [
        ("exp1", "unet", "model 'unet' reads image frames, but sensor 'soft_skin' gives channels"),
        ("exp2", "superpose", "models that read channels: kernel, mean, nearest, pins"),
        ("stability", "nearest", "protocol 'stability' changes images"),
    ],
)
def test_what_cannot_be_read_is_refused_before_any_work(
    host: PluginHost, tmp_path: Path, protocol: str, model: str, says: str
) -> None:
    with pytest.raises(UserError, match=says):
        plan(host, tmp_path, protocol, model)
    assert not list(tmp_path.iterdir())


def test_a_skin_is_pressed_in_its_own_range(host: PluginHost, tmp_path: Path, skin: Any) -> None:
    made = plan(host, tmp_path, "exp1", "nearest")
    assert made.frames.source.workspace == skin.workspace
    reach = [
        max(abs(scene.pose.x), abs(scene.pose.y))
        for frames in made.frames.test
        for scene in frames.scenes
    ]
    assert 10.0 < max(reach) <= skin.workspace.half_width_mm
    context = made.context()
    assert context.max_depth == skin.workspace.depth_max_mm
    assert np.abs(context.grid.axes()[0]).max() > skin.workspace.half_width_mm
