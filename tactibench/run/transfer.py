"""What a protocol tests that moves a model from one sensor to another: ``--test data=FOLDER``."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.protocols.loader import LoadedProtocol
from tactibench.run.components import Part, Sensors, data_folder
from tactibench.run.request import RunRequest

SensorsT = TypeVar("SensorsT", bound=Sensors)


def with_target(
    request: RunRequest, protocol: LoadedProtocol, parts: SensorsT, host: PluginHost
) -> SensorsT:
    """The parts with the recorded sensor that is tested. Raises UserError."""
    keys, asked = protocol.keys, request.tested
    if asked.data is None:
        raise UserError(
            f"protocol {keys.id!r} tests on another sensor than it trains on; name the recording "
            "of that one with --test data=FOLDER."
        )
    if asked.reference or asked.hidden:
        raise UserError(
            f"protocol {keys.id!r} tests on a recording; leave "
            f"{'--hidden-seed' if asked.hidden else '--test reference'} out."
        )
    data_folder(asked.data, "--test data=FOLDER")
    if keys.plates is None and not parts.sensor.spec.needs_data:
        raise UserError(
            f"protocol {keys.id!r} draws no presses for a sensor that makes its own frames, as "
            f"{parts.sensor.name!r} does; use --data DIR."
        )
    name = keys.defaults.sensor
    spec = host.sensors[name]
    if not spec.needs_data:
        raise UserError(
            f"protocol {keys.id!r} reads the tested recording with sensor {name!r}, which reads no "
            "folder; mend its key 'defaults.sensor'."
        )
    target = Part(spec, spec.settings(asked.parameters), host.sensors.origins[name])
    return replace(parts, tested=target)
