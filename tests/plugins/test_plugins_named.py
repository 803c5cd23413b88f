"""A sensor by name, for plugins."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from stubs import StubSensor

from tactibench import Parameter, SensorContext, SensorSpec, UserError, open_sensor
from tactibench.plugins import named


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
    sensors = named.PluginHost([]).sensors
    catalogue = type(sensors)("sensor", {"made": spec}, {}, {})
    monkeypatch.setattr(named, "PluginHost", lambda: type("Host", (), {"sensors": catalogue})())
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
