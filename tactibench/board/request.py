"""The request that the run of a record was made with."""

from __future__ import annotations

from pathlib import Path

from tactibench.plugins import PluginHost
from tactibench.records import BoundSpec, Record
from tactibench.run import HIDDEN, RunRequest, read_test_options


def request_of_record(record: Record, host: PluginHost, data: Path | None) -> RunRequest:
    """Return the request that a run was made with, with all parameters of its record."""
    test, bound = record.test_sensor, {"model": BoundSpec.of_record(host.models, record.model)}
    bound["sensor"] = BoundSpec.of_record(host.sensors, record.sensor)
    if record.encoder is not None:
        bound["encoder"] = BoundSpec.of_record(host.encoders, record.encoder)
    options = () if test is None else tuple(test.options)
    return RunRequest(
        record.protocol.id,
        record.model.name,
        regime=record.regime,
        sensor=record.sensor.name,
        encoder=None if record.encoder is None else record.encoder.name,
        data=data,
        seed=record.seed,
        device=record.training.device or "cpu",
        parameters={
            kind: {name: str(value) for name, value in spec.values.items()}
            for kind, spec in bound.items()
        },
        presses=record.limits.presses,
        test=read_test_options(
            tuple(option for option in options if option != HIDDEN), hidden=HIDDEN in options
        ),
    )
