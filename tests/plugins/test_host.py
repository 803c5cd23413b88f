"""The plugin host with real, mostly broken, distributions: each is named, the others work."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stubs import StubSensor

from tactibench import Parameter, SensorContext, SensorSpec, UserError, open_sensor
from tactibench.errors import printable
from tactibench.plugins import HOOKS, Origin, PluginHost
from tactibench.plugins import host as host_module

GOOD = """
@hookimpl
def tactibench_models():
    yield ModelSpec("good", "heavy_module:Model", "answers well")

@hookimpl
def tactibench_sensors():
    return [SensorSpec("good-sensor", "heavy_module:Sensor", "feels well")]

@hookimpl
def tactibench_encoders():
    return (EncoderSpec("good-encoder", "heavy_module:Encoder", "maps well"),)

@hookimpl
def tactibench_commands():
    return {CommandSpec("good-verb", "heavy_module:verb", "does well")}
"""


def model(name: str, **keys: Any) -> str:
    more = "".join(f", {key}={value!r}" for key, value in keys.items())
    return f"""
@hookimpl
def tactibench_models():
    return [ModelSpec({name!r}, "heavy_module:Model", "a model"{more})]
"""


def test_a_good_plugin_is_found_through_every_hook(install: Any) -> None:
    install("good", GOOD)
    host = PluginHost()
    found = [host.models, host.sensors, host.encoders, host.commands]
    names = ["good", "good-sensor", "good-encoder", "good-verb"]
    assert len(names) == len(HOOKS), "a hook is not tested here"
    for catalogue, name in zip(found, names, strict=True):
        assert catalogue[name].name == name
        assert catalogue.origins[name] == Origin("good", "dist-good", "1.2")
        assert list(catalogue.specs) == sorted(catalogue.specs)
    assert not host.problems
    assert {"mean", "nearest", "cnn", "unet"} <= set(host.models.specs)


@pytest.mark.parametrize(
    ("source", "step", "reason"),
    [
        ("import a_module_nobody_has", "load", "ModuleNotFoundError: No module named 'a_module_no"),
        ("raise SystemExit(3)", "load", "SystemExit: 3"),
        ("class Panic(BaseException): ...\nraise Panic('in Rust')", "load", "Panic: in Rust"),
        ("raise ValueError('one\\n\\n  two')", "load", "ValueError: one two"),
        (
            "@hookimpl\ndef tactibench_model(): return []",
            "validate",
            "there is no hook 'tactibench_model'; did you mean 'tactibench_models'?",
        ),
        (model("lost").replace("@hookimpl", ""), "validate", "tactibench_models is not marked"),
        ("x = 1", "validate", "it has none of the hooks tactibench_models, tactibench_sensors"),
        ("@hookimpl\ndef tactibench_models(): raise SystemExit", "declare", "raised SystemExit"),
        (
            "@hookimpl\ndef tactibench_models():\n"
            "    yield ModelSpec('half', 'm:C', '')\n    raise OSError('half way')",
            "declare",
            "tactibench_models raised OSError: half way",
        ),
        ("@hookimpl\ndef tactibench_models(): pass", "declare", "gave NoneType, not a list of Mod"),
        (
            "@hookimpl\ndef tactibench_models(): return [EncoderSpec('x', 'm:C', ''), 7, 8]",
            "declare",
            "gave EncoderSpec and int where ModelSpec is expected",
        ),
        (
            model("a", colour="red"),
            "declare",
            "TypeError: ModelSpec.__init__() got an unexpected keyword argument 'colour'",
        ),
    ],
)
def test_a_broken_plugin_is_named_with_its_reason_and_the_others_work(
    install: Any, only: Any, source: str, step: str, reason: str
) -> None:
    install("aaa", source)
    install("zzz", model("healthy"))
    host = PluginHost()
    problem = only(host.problems, "aaa")
    assert problem.step == step
    assert reason in problem.message
    assert "\n" not in problem.message
    assert problem.origin == Origin("aaa", "dist-aaa", "1.2")
    assert {"healthy", "mean", "unet"} <= set(host.models.specs)
    assert len(host.problems) == 1
    assert not {"half", "x", "lost"} & set(host.models.specs)


@pytest.fixture
def handled_interrupt() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt, also where the tests run in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("handled_interrupt")
@pytest.mark.parametrize(
    "where",
    ["raise KeyboardInterrupt", "@hookimpl\ndef tactibench_models(): raise KeyboardInterrupt"],
)
def test_an_interrupt_passes(install: Any, where: str) -> None:
    install("slow", where)
    with pytest.raises(KeyboardInterrupt):
        _ = PluginHost().problems


def test_two_plugins_that_offer_a_name_are_both_named_and_neither_wins(install: Any) -> None:
    install("one", model("twin"))
    install("two", model("twin"))
    install("third", model("triplet"))
    host = PluginHost()
    assert "twin" not in host.models.specs
    assert "triplet" in host.models.specs
    messages = {problem.origin.plugin: problem.message for problem in host.problems}
    assert messages == {
        "one": "model 'twin' is offered also by 'two' (dist-two 1.2)",
        "two": "model 'twin' is offered also by 'one' (dist-one 1.2)",
    }
    with pytest.raises(UserError, match=r"'one' \(dist-one 1.2\) and 'two' \(dist-two 1.2\)"):
        _ = host.models["twin"]


def test_two_distributions_with_a_plugin_of_the_same_name(install: Any, only: Any) -> None:
    install("same", model("first"), distribution="alpha")
    install(
        "same", model("second") + "raise AssertionError('not even imported')", distribution="beta"
    )
    host = PluginHost()
    problem = only(host.problems, "same")
    assert (problem.step, problem.origin.distribution) == ("duplicate", "beta")
    assert "'same' (alpha 1.2)" in problem.message
    assert "first" in host.models.specs
    assert "second" not in host.models.specs


def test_unknown_names_get_the_close_match(install: Any) -> None:
    host = PluginHost()
    with pytest.raises(UserError, match=r"^unknown model 'unett'; did you mean 'unet'\?$"):
        _ = host.models["unett"]
    with pytest.raises(UserError, match=r"^unknown encoder 'zzz'; known: .*hertz.*\.$"):
        _ = host.encoders["zzz"]


def test_an_unknown_name_names_the_plugin_that_could_not_offer_it(install: Any) -> None:
    install("torn", model("mine", colour="red"))
    host = PluginHost()
    words = (
        r"^unknown model 'mine'; .* Broken plugin 'torn' \(dist-torn 1.2\) in step declare: .*"
        r"unexpected keyword argument 'colour'.*\.$"
    )
    with pytest.raises(UserError, match=words):
        _ = host.models["mine"]
    with pytest.raises(UserError) as caught:
        _ = host.encoders["mine"]
    assert "torn" not in str(caught.value), "it declares no encoder"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("0.1 mm ± 2 °, Σ", "0.1 mm ± 2 °, Σ"),
        ("\x1b[2J\x1b]0;title\x07\n", r"\x1b[2J\x1b]0;title\x07\n"),
        ("abc\N{RIGHT-TO-LEFT OVERRIDE}def", r"abc\u202edef"),
        ("\ud800", r"\ud800"),
    ],
)
def test_what_a_terminal_would_obey_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(shown) == shown


class Made(StubSensor):
    def __init__(self, context: SensorContext, **values: Any) -> None:
        self.context, self.values = context, values


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> SensorContext:
    module = ModuleType("made_sensors")
    module.Made = Made  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "made_sensors", module)
    spec = SensorSpec(
        "made",
        "made_sensors:Made",
        "a sensor",
        (Parameter("noise", True, "on or off"), Parameter("size", 8, "px")),
    )
    sensors = PluginHost([]).sensors
    catalogue = type(sensors)("sensor", {"made": spec}, {}, {})
    host = SimpleNamespace(sensors=catalogue)
    monkeypatch.setattr(host_module, "PluginHost", lambda: host)
    return SensorContext(np.random.SeedSequence(0))


def test_given_parameters_go_before_preferred_ones_and_both_before_defaults(
    context: SensorContext,
) -> None:
    preferred = {"noise": "false", "unknown": "1"}
    made: Any = open_sensor("made", context, {}, preferred=preferred)
    assert made.values == {"noise": False, "size": 8}
    made = open_sensor("made", context, {"noise": "true", "size": "9"}, preferred=preferred)
    assert made.values == {"noise": True, "size": 9}
    assert made.context is context


def test_unknown_names_and_parameters_are_refused(context: SensorContext) -> None:
    with pytest.raises(UserError, match="unknown sensor 'mad'"):
        open_sensor("mad", context, {})
    with pytest.raises(UserError, match="no parameter 'sise'"):
        open_sensor("made", context, {"sise": "9"})
