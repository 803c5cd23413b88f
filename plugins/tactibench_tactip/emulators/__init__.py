"""Emulated devices around one simulated world: real clients talk to them over real bytes.

    world = World(simulated("tactip-127"), Rig(), envelope=Envelope(), time_scale=20)
    with world, UrEmulator(world) as ur, CameraEmulator(world) as camera:
        cv2.VideoCapture(camera.url, cv2.CAP_FFMPEG)
        ...
        world.truth().depth_mm      # what the label should say
        world.log.outside           # must be empty

ur_rtde cannot be used like this: its constructors hold Python's global lock while they wait, so
that nothing else in their process runs, an emulator included. Such emulators run apart:

    with Apart(Setup(time_scale=20, ur={}, camera={"fps": 60})) as world:
        RTDEControlInterface(world.ports.ur)
        world.truth().depth_mm

Poses are ``Pose6``: x, y, z mm and alpha, beta, gamma deg, extrinsic xyz ("sxyz"). The tool's z
points at the sensor, and so does the work frame's. Times are seconds of the world's clock, which
runs ``time_scale`` times as fast as the host's.
"""

from tactibench_tactip.emulators.apart import Apart
from tactibench_tactip.emulators.camera import CameraEmulator
from tactibench_tactip.emulators.clock import Clock
from tactibench_tactip.emulators.faults import FAULTS, Fault, Fired
from tactibench_tactip.emulators.grbl import GrblEmulator
from tactibench_tactip.emulators.log import Envelope, Log, Press, Stretch
from tactibench_tactip.emulators.poses import Pose6
from tactibench_tactip.emulators.rig import Rig, Truth
from tactibench_tactip.emulators.setup import Ports, Setup
from tactibench_tactip.emulators.ur import UrEmulator
from tactibench_tactip.emulators.world import World, simulated

__all__ = [
    "FAULTS",
    "Apart",
    "CameraEmulator",
    "Clock",
    "Envelope",
    "Fault",
    "Fired",
    "GrblEmulator",
    "Log",
    "Ports",
    "Pose6",
    "Press",
    "Rig",
    "Setup",
    "Stretch",
    "Truth",
    "UrEmulator",
    "World",
    "simulated",
]
