"""Every hook has its section, and an example that works when a stranger's package installs it.

A new hook needs an implementation in docs/examples, a test in CALLED, and its name on the page.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import Contacts, Grid, Indenter, ModelContext, Pose, Scene, SensorContext, UserError
from tactibench.plugins import HOOKS, Origin, PluginHost, hookspecs

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "hooks.md").read_text(encoding="utf-8")
EXAMPLE = "docs/examples/tactile_pocket/hooks.py"
GRID = Grid.centred(64, 0.4)


def a_model_answers(host: PluginHost, folder: Path) -> None:
    spec = host.models["apex"]
    model = spec.build(ModelContext("contacts", GRID, 6.0), **spec.settings({"depth": "2.5"}))
    model.save(folder)
    other = spec.build(ModelContext("contacts", GRID, 6.0))
    other.load(folder)
    (answer,) = other.predict([None])
    assert (answer.xy.tolist(), answer.depth.tolist()) == ([[0.0, 0.0]], [2.5])
    with pytest.raises(UserError, match="holds no weights"):
        other.load(folder / "nowhere")
    with pytest.raises(UserError, match=r"at least 0\.5"):
        spec.settings({"depth": "0"})


def a_sensor_presses(host: PluginHost, _: Path) -> None:
    with host.sensors["lamp"].build(SensorContext(np.random.SeedSequence(0))) as sensor:
        (frame,) = sensor.press_many([Scene(Indenter.single(), Pose(x=5.0, y=-5.0, depth=1.0))])
        row, column = np.argwhere(frame.image).mean(axis=0) / frame.image.shape[0]
        assert column > 0.7  # x right
        assert row < 0.3  # y down
        assert not sensor.rest().image.any()
        with pytest.raises(UserError, match="sees"):
            sensor.press(Scene(Indenter.single(), Pose(x=50.0)))


def an_encoder_comes_back(host: PluginHost, _: Path) -> None:
    encoder = host.encoders["cell"].build()
    truth = Contacts.truth([[1.0, -2.0], [-3.0, 4.0]], [5.0, 2.0])
    (back,) = encoder.decode_batch(encoder.encode(truth, GRID)[None], GRID)
    assert np.abs(back.xy - truth.xy).max() <= encoder.tolerance
    np.testing.assert_allclose(back.depth, truth.depth, rtol=1e-6)


def a_verb_runs(host: PluginHost, _: Path) -> None:
    done = CliRunner().invoke(host.commands["greet"].load(), ["lamp"])
    assert (done.exit_code, done.output) == (0, "hello, lamp\n")


CALLED: dict[str, Callable[[PluginHost, Path], None]] = {
    "tactibench_models": a_model_answers,
    "tactibench_sensors": a_sensor_presses,
    "tactibench_encoders": an_encoder_comes_back,
    "tactibench_commands": a_verb_runs,
}


def test_every_hook_is_tested_here() -> None:
    assert set(CALLED) == set(HOOKS), "give every hook an example and a test of it"


@pytest.mark.parametrize("hook", HOOKS)
def test_a_strangers_package_uses_the_hook(hook: str, pocket: Path, tmp_path: Path) -> None:
    host = PluginHost()
    assert not [problem for problem in host.problems if problem.origin.plugin == "pocket"]
    assert Origin("pocket", "tactile-pocket", "1.0") in host.plugins
    CALLED[hook](host, tmp_path)


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_is_documented_and_in_the_example(hook: str) -> None:
    assert inspect.getdoc(getattr(hookspecs, hook))
    assert hook in PAGE
    assert f"@hookimpl\ndef {hook}(" in (ROOT / EXAMPLE).read_text(encoding="utf-8")


def test_the_page_speaks_of_no_hook_that_is_gone_and_shows_the_example() -> None:
    (members,) = re.findall(r"members: \[(tactibench_.*)\]", PAGE)
    assert set(members.split(", ")) == set(HOOKS)
    assert EXAMPLE in PAGE
