"""The sensor that presses the test scenes, where it is not the one of the training: ``--test``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins import INSTANCE, VERSION, PluginHost, SensorSpec
from tactibench.protocols import Protocol
from tactibench.records import BoundSpec
from tactibench.run.request import REFERENCE, SHOTS, TestOptions, data_folder, folder_label

Sensor = BoundSpec[SensorSpec]

INSTANCES = "instances"
"""Parameter of a sensor that spreads the training presses over several instances of it."""


def resolve_test_sensor(
    options: TestOptions, protocol: Protocol, sensor: Sensor, host: PluginHost
) -> Sensor | None:
    """Return the sensor that presses the test scenes; None where it is the training sensor.

    Args:
        options: The options of ``--test``.
        protocol: The protocol of the run.
        sensor: The training sensor.
        host: The plugins.

    Raises:
        UserError: The options do not fit the protocol or the sensor.
    """
    if options.shots:
        _check_shots(options, protocol)
    if protocol.transfer is not None:
        return _recorded_target(options, protocol, sensor, host)
    if of := sensor.spec.reference_of:
        raise UserError(
            f"sensor {sensor.name!r} has nothing but {sensor.spec.scenes} to be tested on; "
            f"use --sensor {of} --test {REFERENCE}."
        )
    if options:
        return _changed_sensor(options, sensor, host)
    return _one_instance(sensor) if _has_several(sensor) else None


def _has_several(sensor: Sensor) -> bool:
    """Return whether the presses of a sensor are spread over several instances."""
    count = sensor.values.get(INSTANCES, 0)
    return isinstance(count, int) and count > 1


def _one_instance(sensor: Sensor) -> Sensor:
    """Return the sensor with all presses on one instance, as it is tested."""
    return BoundSpec(sensor.spec, {**sensor.values, INSTANCES: 0}, sensor.origin)


def describe_target(tested: Sensor, options: TestOptions) -> str:
    """Return words for the tested sensor, such as "another individual (instance=1)".

    Args:
        tested: The sensor that presses the test scenes.
        options: The options of ``--test``.
    """
    if not replace(options, shots=0):
        return "the nominal sensor"
    values = [f"{name}={tested.values[name]}" for name in options.parameters]
    settings = f" ({', '.join(values)})" if values else ""
    if options.data is not None:
        return f"recording {folder_label(options.data)}{settings}"
    if options.reference:
        return f"{tested.spec.scenes}{settings}"
    if options.hidden:
        return f"hidden presses{settings}"
    kind = "individual" if set(options.parameters) == {INSTANCE} else "setting"
    return f"another {kind}{settings}"


def target_record(
    tested: Sensor, sensor: Sensor, options: TestOptions, presses: int, data: Path | None
) -> dict[str, Any]:
    """Return the entry of the tested sensor in the record.

    Args:
        tested: The sensor that presses the test scenes.
        sensor: The sensor that pressed the training scenes.
        options: The options of ``--test``.
        presses: Number of presses of the test frames.
        data: Folder of the training frames.
    """
    record = {
        "name": tested.name,
        "parameters": dict(tested.values),
        "asked": options.texts,
        "on": describe_target(tested, options),
        "presses": presses,
    }
    if options.data is not None:
        trained_on = sensor.label if data is None else f"recording {folder_label(data)}"
        record["trained_on"] = f"{sensor.spec.origin} {trained_on}"
    return record


def _check_shots(options: TestOptions, protocol: Protocol) -> None:
    """Raise UserError where a model cannot be shown labelled presses of the tested sensor."""
    leave_out = f"leave --test {SHOTS} out"
    if protocol.transfer is not None:
        counts = ", ".join(map(str, protocol.transfer.shots))
        raise UserError(
            f"protocol {protocol.id!r} shows {counts} labelled frames of its own accord; "
            f"{leave_out}."
        )
    if protocol.families:
        raise UserError(
            f"protocol {protocol.id!r} tests many sensors at once, so no labelled presses of one "
            f"can be shown; {leave_out}."
        )
    if options.reference:
        raise UserError(
            f"--test {REFERENCE} has its few scenes for the test alone and none to be shown with "
            f"labels; {leave_out}."
        )


def _changed_sensor(options: TestOptions, sensor: Sensor, host: PluginHost) -> Sensor:
    if options.data is not None:
        raise UserError(
            "--test data=FOLDER is for protocols that test on another sensor than they train on, "
            "such as transfer; name the folder of this one with --data."
        )
    if sensor.spec.needs_data:
        raise UserError(
            f"sensor {sensor.name!r} has the frames of its folder and can press no others; leave "
            f"{'--hidden-seed' if options.hidden else '--test'} out."
        )
    if options.hidden and options.reference:
        raise UserError(
            "--hidden-seed draws presses anew and reference scenes are not drawn; leave one of "
            "--hidden-seed and --test reference out."
        )
    name = _reference_name(sensor, host) if options.reference else sensor.name
    tested: Sensor = BoundSpec.named(host.sensors, name, options.parameters)
    over = set(sensor.values)
    # Another version has defaults of its own: only the parameters that were set are taken over.
    if VERSION in options.parameters:
        over = set(sensor.component.settings or ())
    taken_over = {
        name: sensor.values[name]
        for name in tested.values
        if name not in options.parameters and name in over
    }
    tested = BoundSpec(tested.spec, {**tested.values, **taken_over}, tested.origin)
    if INSTANCES in options.parameters and _has_several(tested):
        raise UserError(
            f"--test sensor.{INSTANCES} would test on the instances that models are trained on; "
            f"test on one that no training sees, --test sensor.{INSTANCE}=K with K from 0 to 9."
        )
    if _has_several(tested):
        tested = _one_instance(tested)
    same = tested.name == sensor.name and tested.values == sensor.values
    if same and options.shots:
        raise UserError(
            f"--test {SHOTS}={options.shots} shows presses of another sensor than the trained one; "
            "name it with --test sensor.NAME=VALUE, for example sensor.instance=1."
        )
    if same and not (options.hidden and not options.parameters):
        texts = replace(options, hidden=False).texts  # --hidden-seed is no text of --test
        raise UserError(
            f"--test {' --test '.join(texts)} is what the training frames are made with already; "
            "give another value, or leave --test out."
        )
    return tested


def _reference_name(sensor: Sensor, host: PluginHost) -> str:
    names = {spec.reference_of: spec.name for spec in host.sensors if spec.reference_of}
    if sensor.name not in names:
        others = f"; {' and '.join(sorted(names))} have some" if names else ""
        raise UserError(
            f"sensor {sensor.name!r} has no reference scenes{others}; take another sensor, or "
            "--test sensor.NAME=VALUE."
        )
    return names[sensor.name]


def _recorded_target(
    options: TestOptions, protocol: Protocol, sensor: Sensor, host: PluginHost
) -> Sensor:
    """Return the recorded sensor of a protocol that moves a model to another sensor.

    Raises:
        UserError: No recording is named, or the options or the sensors do not fit the protocol.
    """
    if options.data is None:
        raise UserError(
            f"protocol {protocol.id!r} tests on another sensor than it trains on; name the "
            "recording of that one with --test data=FOLDER."
        )
    if options.reference or options.hidden:
        raise UserError(
            f"protocol {protocol.id!r} tests on a recording; leave "
            f"{'--hidden-seed' if options.hidden else '--test reference'} out."
        )
    data_folder(options.data, "--test data=FOLDER")
    if protocol.plates is None and not sensor.spec.needs_data:
        raise UserError(
            f"protocol {protocol.id!r} draws no presses for a sensor that makes its own frames, "
            f"as {sensor.name!r} does; use --data DIR."
        )
    name = protocol.defaults.sensor
    if not host.sensors[name].needs_data:
        raise UserError(
            f"protocol {protocol.id!r} reads the tested recording with sensor {name!r}, which "
            "reads no folder; fix its key 'defaults.sensor'."
        )
    target: Sensor = BoundSpec.named(host.sensors, name, options.parameters)
    return target
