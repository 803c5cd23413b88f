"""What of a protocol's workspace a sensor can be pressed in."""

from __future__ import annotations

from typing import Protocol as StructuralType

from tactibench.errors import UserError
from tactibench.protocols.schema import Protocol


class SensorShape(StructuralType):
    """Surface of a sensor, see the attributes of ``tactibench.Sensor``."""

    @property
    def dome_radius_mm(self) -> float | None: ...

    @property
    def deepest_mm(self) -> float: ...


def pressable(keys: Protocol, sensor: SensorShape) -> Protocol:
    """The protocol whose presses are drawn: on the sensor's surface, as deep as it can be pressed.

    A sensor that does not say leaves the protocol as it is. Raises UserError for one that cannot be
    pressed as deep as the protocol's shallowest tip.
    """
    workspace = keys.workspace
    deepest = min(workspace.depth_max_mm, sensor.deepest_mm)
    if not deepest > workspace.depth_min_mm:
        raise UserError(
            f"the sensor can be pressed {sensor.deepest_mm:g} mm deep, but protocol {keys.id!r} "
            f"presses {workspace.depth_min_mm:g} mm and more; take another sensor."
        )
    radius = sensor.dome_radius_mm
    if radius is None:
        radius = workspace.dome_radius_mm
    shape = {"dome_radius_mm": radius, "depth_max_mm": deepest}
    return keys.model_copy(update={"workspace": workspace.model_copy(update=shape)})
