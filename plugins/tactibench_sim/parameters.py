"""What a user may set of the optics: the parameters of ``hooks`` and the fields of Optics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from tactibench import Parameter
from tactibench_sim.hooks import OPTICAL
from tactibench_sim.optics import Optics

_CALLED = {
    "noise": "noise.on",
    "read_noise": "noise.read",
    "full_well": "noise.full_well",
    "edge": "edge_px",
    "blur": "blur_px",
    "pin_radius": "marker_radius_mm",
    "camera_distance": "camera_distance_mm",
    "roll": "roll_deg",
    "gel_length": "gel_mm",
    "window_thickness": "window_mm",
    "glare_start": "glare_start_deg",
    "glare_arc": "glare_arc_deg",
    "threshold": "threshold_grey",
}
"""Parameters that are not called like their field: without units, and those of the noise."""


def optical_parameters(nominal: Optics) -> tuple[Parameter, ...]:
    """The parameters of the optics with the nominal values as defaults."""
    return tuple(
        Parameter(p.name, _get(nominal, _field(p.name)), p.help, p.choices, p.low, p.high)
        for p in OPTICAL
    )


def optics_from(nominal: Optics, values: Mapping[str, Any]) -> Optics:
    """The nominal optics with the named parameters set.

    Raises UserError for values that fit no camera, TypeError for names that are no parameters.
    """
    if unknown := set(values) - {p.name for p in OPTICAL}:
        raise TypeError(f"the optics have no parameter {', '.join(sorted(unknown))}")
    fields = {_field(name): value for name, value in values.items()}
    noise = {f.removeprefix("noise."): v for f, v in fields.items() if f.startswith("noise.")}
    own = {f: v for f, v in fields.items() if not f.startswith("noise.")}
    return replace(nominal, **own, noise=replace(nominal.noise, **noise))


def _field(name: str) -> str:
    return _CALLED.get(name, name)


def _get(optics: Optics, field: str) -> Any:
    value: Any = optics
    for name in field.split("."):
        value = getattr(value, name)
    return value
