"""Errors of devices, by what a caller has to do about them."""

from __future__ import annotations

from tactibench import UserError


class NotHomedError(UserError):
    """A stage does not know where it is, and may not drive to its switches."""


class DeviceError(UserError):
    """A device did not do what it was asked to do; it cannot be used further in this session."""


class RobotError(DeviceError):
    """The robot did not do what it was asked to do. It may be moved away if its state is normal."""


class RobotLostError(RobotError):
    """The connection to the robot is gone."""


class ProtectiveStopError(RobotError):
    """The robot's controller stopped it to protect somebody or something."""


class GuardError(RobotError):
    """A move was stopped: the force was too great, or the tool left its line."""


class NoTouchError(RobotError):
    """A search for first touch touched nothing."""


class CameraError(DeviceError):
    """The camera gives no frames, or not those that it was asked for."""


class StopNowError(Exception):
    """Somebody asked to stop at once."""
