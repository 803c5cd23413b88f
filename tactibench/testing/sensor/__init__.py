"""What every sensor must hold."""

from __future__ import annotations

from tactibench.testing.property import Property
from tactibench.testing.sensor import frames, pressing
from tactibench.testing.sensor.subject import SensorSubject

PROPERTIES = tuple(
    Property.of(function)
    for function in (
        pressing.target,
        pressing.parameters,
        pressing.context_manager,
        frames.frames,
        frames.rest_frame,
        frames.deeper,
        frames.direction,
        frames.timestamps,
        pressing.determinism,
        pressing.press_many,
        pressing.refusals,
        pressing.describe,
        pressing.scenes,
        pressing.surface,
        pressing.bound,
    )
)

__all__ = ["PROPERTIES", "SensorSubject"]
