"""Contact of a tool with the sensor: closed form, many poses at once."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from tactibench import Contacts, Indenter, Pose, Scene
from tactibench.geometry import true_contacts
from tactibench_tactip.emulators.motion import Array, Pose6, inverse, matrix, pose6

_UPRIGHT = 1.0 - 1e-10
"""Cosine above which a tilt is only rounding."""


@dataclass(frozen=True)
class Rig:
    """The true geometry of a setup, which a collection has to measure.

    Attributes:
        work_frame: Pose of the work frame in the robot's base, or in machine coordinates of a
            stage.
        sensor_frame: Pose of the sensor in the work frame: origin at the undeformed apex, z out of
            the dome, x right and y down in the image. A sensor 0.7 mm beside, 1.2 mm deeper and
            turned by 12 deg has (0.7, 0, 1.2, 180, 0, 12).
        indenter: The indenter. Its tips lie at (dx, -dy, dz) in the tool frame, dz towards the
            sensor. The tool point is the foremost point of a tip with dz = 0, or a plate's centre.
        start: Pose of the tool at the beginning, in the work frame.
        stiffness_n_per_mm: Stiffness of the sensor under each tip, which gives the force on a
            robot.
    """

    work_frame: Pose6 = (109.1, -487.0, 341.3, 180.0, 0.0, -90.0)
    sensor_frame: Pose6 = (0.0, 0.0, 0.0, 180.0, 0.0, 0.0)
    indenter: Indenter = field(default_factory=Indenter.single)
    start: Pose6 = (0.0, 0.0, -50.0, 0.0, 0.0, 0.0)
    stiffness_n_per_mm: float = 0.8


@dataclass(frozen=True, eq=False)
class Truth:
    """The state of the world at one moment.

    Attributes:
        tool: Pose of the tool in the work frame.
        depth_mm: Travel of the deepest tip past its own first touch; negative: the gap along z.
        contacts: Contacts in the sensor frame.
        scene: Scene that the sensor shows; None: nothing touches.
        force_n: Force along the work frame's z that pushes the tool away.
    """

    tool: Pose6
    depth_mm: float
    contacts: Contacts
    scene: Scene | None
    force_n: float


class Touch:
    """Contact of a rig's tool with a dome.

    Args:
        rig: Geometry of the setup.
        dome_radius: Radius of the dome, mm; inf: a flat pad.
    """

    def __init__(self, rig: Rig, dome_radius: float) -> None:
        self.rig, self.dome_radius = rig, dome_radius
        self._to_sensor = inverse(matrix(rig.sensor_frame))

    def depths(self, tools: Array) -> Array:
        """Return the travel (N, K) of every tip past its first touch, mm, for tools (N, 4, 4).

        A negative value is a gap; -inf: the tip's axis passes beside the dome. With its centre at
        (rho, z) from the dome's, a tip touches at z = sqrt((R_d + R)^2 - rho^2). A plate's depth is
        R_d - n (p - O) along its normal n.
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
        """Return the forces (N,), newton, of depths (N, K), mm: every tip is on a spring."""
        force: Array = self.rig.stiffness_n_per_mm * np.maximum(depths, 0.0).sum(axis=1)
        return force

    def truth(self, tool: Array) -> Truth:
        """Return the state of the world with the tool at a (4, 4) pose in the work frame."""
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
        """Return the centres (N, K, 3) of the tips in the sensor frame, mm.

        In the tool frame they are (dx, -dy, dz - R).
        """
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
            yaw = math.degrees(math.atan2(seen[1, 0], seen[0, 0]))
            return Scene(indenter, Pose(x, y, yaw, 0.0, depth))
        # Spheres do not turn: a tilted indenter is an upright one with its tips elsewhere.
        centres = self._centres(seen[None])[0]
        offsets = tuple((float(x), float(y), float(-z)) for x, y, z in centres)
        return Scene(replace(indenter, offsets=offsets), Pose(depth=depth))
