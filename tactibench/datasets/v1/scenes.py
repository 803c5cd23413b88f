"""A scene as keys of a row: the same in the journal and in a plan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.errors import UserError

_POSE = ("x_mm", "y_mm", "yaw_deg", "tilt_deg", "depth_mm")


@dataclass(frozen=True, kw_only=True)
class SceneKeys:
    """Indenter and pose. indenter_radius_mm is left out for a plate, all of it without a scene."""

    indenter: str | None = None
    indenter_radius_mm: float | None = None
    indenter_offsets_mm: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    x_mm: float | None = None
    y_mm: float | None = None
    yaw_deg: float | None = None
    tilt_deg: float | None = None
    depth_mm: float | None = None

    def scene(self, where: str) -> Scene | None:
        """The scene, None where there is no indenter. Raises UserError, which begins with
        ``where``, for half a scene and for an indenter that cannot be."""
        values = {key: getattr(self, key) for key in _POSE}
        if self.indenter is None:
            if any(value is not None for value in values.values()):
                raise UserError(f"{where}: a pose needs the key 'indenter'; add it.")
            return None
        missing = [key for key, value in values.items() if value is None]
        if missing:
            raise UserError(f"{where}: the key {missing[0]!r} is missing; add it.")
        radius = math.inf if self.indenter_radius_mm is None else self.indenter_radius_mm
        try:
            indenter = Indenter(radius, self.indenter_offsets_mm, self.indenter)
        except ValueError as error:
            raise UserError(f"{where}: {error}; mend it.") from None
        return Scene(indenter, Pose(*values.values()))


def scene_keys(scene: Scene) -> dict[str, Any]:
    """What ``SceneKeys`` reads, as JSON values; every number a float."""
    indenter, pose = scene.indenter, scene.pose
    return {
        "indenter": indenter.name,
        **({} if indenter.is_plate else {"indenter_radius_mm": float(indenter.radius)}),
        "indenter_offsets_mm": [[float(v) for v in offset] for offset in indenter.offsets],
        "x_mm": float(pose.x),
        "y_mm": float(pose.y),
        "yaw_deg": float(pose.yaw),
        "tilt_deg": float(pose.tilt),
        "depth_mm": float(pose.depth),
    }
