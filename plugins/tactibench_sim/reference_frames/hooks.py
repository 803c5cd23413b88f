"""Declarations of the finite-element scenes: a sensor beside each simulated TacTip to test on."""

from __future__ import annotations

from dataclasses import replace

from tactibench import SensorSpec, hookimpl
from tactibench_sim import hooks

TARGETS = {"tactip-127": "Reference127", "tactip-331": "Reference331"}


@hookimpl
def tactibench_sensors() -> tuple[SensorSpec, ...]:
    """Declare the sensors of the finite-element scenes."""
    return tuple(_reference(spec) for spec in hooks.tactibench_sensors() if spec.name in TARGETS)


def _reference(spec: SensorSpec) -> SensorSpec:
    return replace(
        spec,
        name=f"{spec.name}-fem",
        target=f"tactibench_sim.reference_frames.sensor:{TARGETS[spec.name]}",
        summary=f"finite-element scenes of {spec.name}, for --test reference",
        # finite elements have said how the scenes become fields
        parameters=tuple(p for p in spec.parameters if p.name != "tier"),
        reference_of=spec.name,
        scenes="finite-element scenes",
    )
