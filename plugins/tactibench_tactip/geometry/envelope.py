"""Where the tool may be. Checked for the whole plan before any motion, and again at every target.

A software limit is no safety function: it catches mistakes of a configuration, not of a controller.
"""

from __future__ import annotations

import math

from tactibench_tactip.geometry.frames import matrix
from tactibench_tactip.settings import EnvelopeKeys, Pose6

_ROUNDING = 1e-6


def outside(keys: EnvelopeKeys, pose: Pose6) -> str:
    """What of a pose in the work frame leaves the envelope, "" when nothing does."""
    x, y, z, _, _, gamma = pose
    for name, value in (("x", x), ("y", y)):
        if not abs(value) <= keys.half_width_mm + _ROUNDING:
            return (
                f"{name} {value:.2f} mm of the work frame, where envelope.half_width_mm allows "
                f"{keys.half_width_mm:g} mm"
            )
    if not -keys.above_mm - _ROUNDING <= z:
        return f"z {z:.2f} mm, where envelope.above_mm allows {-keys.above_mm:g} mm"
    if not z <= keys.below_mm + _ROUNDING:
        return f"z {z:.2f} mm, where envelope.below_mm allows {keys.below_mm:g} mm"
    tilt = tilt_of(pose)
    if not tilt <= keys.tilt_deg + 1e-3:
        return f"a tilt of {tilt:.1f} deg, where envelope.tilt_deg allows {keys.tilt_deg:g} deg"
    if not abs(gamma) <= keys.yaw_deg + 1e-3:
        return f"a yaw of {gamma:.1f} deg, where envelope.yaw_deg allows {keys.yaw_deg:g} deg"
    return ""


def tilt_of(pose: Pose6) -> float:
    """Angle between the tool's z and the work frame's, deg."""
    return math.degrees(math.acos(max(-1.0, min(1.0, float(matrix(pose)[2, 2])))))
