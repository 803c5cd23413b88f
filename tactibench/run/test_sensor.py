"""What presses the test scenes, where it is not what presses those of the training: ``--test``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.plugins.specs import SensorSpec, Value
from tactibench.run.components import Part, Sensors
from tactibench.run.request import REFERENCE, RunRequest, TestedOn, folder_label

SensorsT = TypeVar("SensorsT", bound=Sensors)

INDIVIDUAL = "instance"
"""Parameter of a sensor that stands for one of its make; 0 is the nominal one."""


def with_test_sensor(request: RunRequest, parts: SensorsT, host: PluginHost) -> SensorsT:
    """The parts with what is asked to press the test scenes. Raises UserError."""
    sensor, asked = parts.sensor, request.tested
    if of := sensor.spec.reference_of:
        raise UserError(
            f"sensor {sensor.name!r} has nothing but {sensor.spec.scenes} to be tested on; "
            f"use --sensor {of} --test {REFERENCE}."
        )
    if not asked:
        return parts
    if asked.data is not None:
        raise UserError(
            "--test data=FOLDER is for protocols that test on another sensor than they train on, "
            "such as transfer; name the folder of this one with --data."
        )
    if sensor.spec.needs_data:
        raise UserError(
            f"sensor {sensor.name!r} has the frames of its folder and can press no others; leave "
            f"{'--hidden-seed' if asked.hidden else '--test'} out."
        )
    if asked.hidden and asked.reference:
        raise UserError(
            "--hidden-seed draws presses anew and reference scenes are not drawn; leave one of "
            "--hidden-seed and --test reference out."
        )
    name = _reference_of(sensor, host) if asked.reference else sensor.name
    spec = host.sensors[name]
    tested = Part(spec, _values(spec, sensor, asked), host.sensors.origins[name])
    same = tested.name == sensor.name and tested.values == sensor.values
    if same and not (asked.hidden and not asked.parameters):
        raise UserError(
            f"--test {' --test '.join(asked.texts)} is what the training frames are made with "
            "already; give another value, or leave --test out."
        )
    return replace(parts, tested=tested)


def words(parts: Sensors, asked: TestedOn) -> str:
    """What the model is tested on: "finite-element scenes", "another individual (instance=1)"."""
    other = [f"{name}={parts.test_sensor.values[name]}" for name in asked.parameters]
    settings = f" ({', '.join(other)})" if other else ""
    if asked.data is not None:
        return f"recording {folder_label(asked.data)}{settings}"
    if asked.reference:
        return f"{parts.test_sensor.spec.scenes}{settings}"
    if asked.hidden:
        return f"hidden presses{settings}"
    kind = "individual" if set(asked.parameters) == {INDIVIDUAL} else "setting"
    return f"another {kind}{settings}"


def tested_record(
    parts: Sensors, asked: TestedOn, presses: int, trained_on: Path | None
) -> dict[str, Any]:
    """What the record says of it; empty where the sensor itself was pressed.

    presses: how many the test frames are of. trained_on: folder of the training frames, said where
    they and the test frames are of two sensors.
    """
    if parts.tested is None:
        return {}
    return {
        "tested": {
            "name": parts.tested.name,
            "parameters": dict(parts.tested.values),
            "asked": asked.texts,
            "on": words(parts, asked),
            "presses": presses,
            **_trained(parts, asked, trained_on),
        }
    }


def _trained(parts: Sensors, asked: TestedOn, folder: Path | None) -> dict[str, str]:
    if asked.data is None:
        return {}
    on = parts.sensor.label() if folder is None else f"recording {folder_label(folder)}"
    return {"trained_on": f"{parts.sensor.spec.origin} {on}"}


def _reference_of(sensor: Part[SensorSpec], host: PluginHost) -> str:
    names = {spec.reference_of: spec.name for spec in host.sensors if spec.reference_of}
    if sensor.name not in names:
        have = f"; {' and '.join(sorted(names))} have some" if names else ""
        raise UserError(
            f"sensor {sensor.name!r} has no reference scenes{have}; take another sensor, or "
            "--test sensor.NAME=VALUE."
        )
    return names[sensor.name]


def _values(spec: SensorSpec, sensor: Part[SensorSpec], asked: TestedOn) -> dict[str, Value]:
    """Those asked for, and otherwise those of the training sensor, where it has them."""
    values = spec.settings(asked.parameters)
    for name in values:
        if name not in asked.parameters and name in sensor.values:
            values[name] = sensor.values[name]
    return values
