"""Emulators of a robot, a stage and a camera around one simulated sensor.

They speak the real protocols over real sockets, so that the drivers and the client libraries
(ur_rtde, pyserial, OpenCV) are used as they are with devices. They do what the drivers use and
nothing more. ``rehearse`` runs those of a configuration in a process of their own:

    with rehearse(settings) as rehearsal:
        Station(rehearsal.settings)             # finds the emulators as it would find devices
        rehearsal.emulation.truth().depth_mm    # what the label should say
        rehearsal.emulation.outside()           # motion outside the envelope, must be empty

Poses are x, y, z mm and alpha, beta, gamma deg, extrinsic about x, y, z. The tool's z points at the
sensor, and so does the work frame's. Times are seconds of the world's clock, which by default runs
as fast as the host's.
"""

from tactibench_tactip.emulators.device import FAULTS, Fault
from tactibench_tactip.emulators.rehearsal import Emulation, HiddenOffset, Rehearsal, rehearse

__all__ = ["FAULTS", "Emulation", "Fault", "HiddenOffset", "Rehearsal", "rehearse"]
