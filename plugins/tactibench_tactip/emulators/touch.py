"""What a tool does to the sensor at a pose, in closed form; vectorised for whole ways."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tactibench import Contacts, Indenter, Pose, Scene
from tactibench.geometry import true_contacts
from tactibench_tactip.emulators.poses import Array, inverse, matrix, pose6
from tactibench_tactip.emulators.rig import Rig, Truth

_UPRIGHT = 1.0 - 1e-10
"""Cosine of a tilt that is rounding."""


@dataclass(frozen=True, eq=False)
class Touch:
    """Rig and dome radius (mm; inf: a flat pad). Tool poses are (4, 4) in the work frame."""

    rig: Rig
    dome_radius: float

    @property
    def _to_sensor(self) -> Array:
        return inverse(matrix(self.rig.sensor_frame))

    def depths(self, tools: Array) -> Array:
        """(N, K) travel of every tip past its own first touch for (N, 4, 4) tools, mm; negative: a
        gap; -inf: the tip's axis passes beside the dome.

        With its centre at (rho, z) from the dome's, a tip touches at sqrt((R_d + R)^2 - rho^2).
        A plate's depth is R_d - n (p - O) along its normal n.
        """
        seen = self._to_sensor @ tools
        radius, dome = self.rig.indenter.radius, self.dome_radius
        if self.rig.indenter.is_plate:
            normal, point = -seen[:, :3, 2], seen[:, :3, 3]
            if math.isinf(dome):
                return np.asarray(-point[:, 2:] / normal[:, 2:])
            reach = (normal * point).sum(axis=1) + normal[:, 2] * dome
            return np.asarray(dome - reach)[:, None]
        centres = self._centres(seen)
        if math.isinf(dome):
            return np.asarray(radius - centres[..., 2])
        square = (dome + radius) ** 2 - (centres[..., :2] ** 2).sum(axis=-1)
        depth = np.sqrt(np.maximum(square, 0.0)) - (centres[..., 2] + dome)
        return np.where(square > 0, depth, -np.inf)

    def forces(self, depths: Array) -> Array:
        """(N,) N of (N, K) depths: a spring under every tip."""
        force: Array = self.rig.stiffness_n_per_mm * np.maximum(depths, 0.0).sum(axis=1)
        return force

    def truth(self, tool: Array) -> Truth:
        """All that is so at one pose."""
        depths = self.depths(tool[None])
        depth = float(depths.max())
        scene = self._scene(self._to_sensor @ tool, depth) if depth > 0 else None
        flat_plate = math.isinf(self.dome_radius) and self.rig.indenter.is_plate
        contacts = (
            Contacts.none()
            if scene is None or flat_plate
            else true_contacts(scene, self.dome_radius)
        )
        return Truth(pose6(tool), depth, contacts, scene, float(self.forces(depths)[0]))

    def _centres(self, seen: Array) -> Array:
        """(N, K, 3) of the tips in the sensor frame: (dx, -dy, dz - R) in the tool's."""
        offsets = np.array(self.rig.indenter.offsets) * [1.0, -1.0, 1.0]
        offsets[:, 2] -= self.rig.indenter.radius
        centres: Array = offsets @ seen[:, :3, :3].transpose(0, 2, 1) + seen[:, None, :3, 3]
        return centres

    def _scene(self, seen: Array, depth: float) -> Scene:
        indenter, (x, y) = self.rig.indenter, seen[:2, 3].tolist()
        normal = -seen[:3, 2]
        if indenter.is_plate:
            tilt = math.degrees(math.acos(min(1.0, float(normal[2]))))
            tilt = tilt if normal[2] < _UPRIGHT else 0.0
            turn = math.degrees(math.atan2(normal[1], normal[0])) if tilt else 0.0
            return Scene(indenter, Pose(x, y, turn, tilt, depth))
        if normal[2] >= _UPRIGHT:
            return Scene(
                indenter, Pose(x, y, math.degrees(math.atan2(seen[1, 0], seen[0, 0])), 0.0, depth)
            )
        return Scene(_upright(indenter, self._centres(seen[None])[0]), Pose(depth=depth))


def _upright(indenter: Indenter, centres: Array) -> Indenter:
    """An untilted indenter with its tips where those of a tilted one are: spheres do not turn."""
    offsets = tuple((float(x), float(y), float(-z)) for x, y, z in centres)
    return replace(indenter, offsets=offsets)
