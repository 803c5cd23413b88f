"""What stands where, and what the tool does to the sensor there: closed form."""

from __future__ import annotations

from dataclasses import dataclass, field

from tactibench import Contacts, Indenter, Scene
from tactibench_tactip.emulators.poses import Pose6


@dataclass(frozen=True)
class Rig:
    """The true geometry, which a collector has to find out.

    work_frame: in the robot's base frame (a stage: machine coordinates), as in the drivers'
    configuration. sensor_frame: of the sensor (origin at the undeformed apex, z out of the dome,
    x right and y down in the image) in the work frame; the default has the apex in the work
    frame's origin and the axes turned about x. A rig whose sensor sits 0.7 mm beside, 1.2 mm
    deeper and turned by 12 deg has (0.7, 0, 1.2, 180, 0, 12). start: the tool at the beginning,
    work frame. indenter: its tips lie at (dx, -dy, dz) in the tool frame, dz towards the sensor:
    with the tool's z against the sensor's, the tool's x axis is at the yaw of ``tactibench.Pose``.
    The tool point is the foremost point of a tip with dz = 0, or a plate's centre.
    stiffness_n_per_mm: of the sensor, per tip, for the force a robot feels.
    """

    work_frame: Pose6 = (109.1, -487.0, 341.3, 180.0, 0.0, -90.0)
    sensor_frame: Pose6 = (0.0, 0.0, 0.0, 180.0, 0.0, 0.0)
    indenter: Indenter = field(default_factory=Indenter.single)
    start: Pose6 = (0.0, 0.0, -50.0, 0.0, 0.0, 0.0)
    stiffness_n_per_mm: float = 0.8


@dataclass(frozen=True, eq=False)
class Truth:
    """What is so. tool: pose in the work frame. depth_mm: of the deepest tip past its own first
    touch, negative: the gap along z. contacts: in the sensor frame. scene: what the sensor shows,
    None: nothing touches. force_n: along the work frame's z, pushing the tool away.
    """

    tool: Pose6
    depth_mm: float
    contacts: Contacts
    scene: Scene | None
    force_n: float
