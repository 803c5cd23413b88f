"""What every robot can do for us. One thread calls it; nothing here waits but ``connect``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from tactibench_tactip.settings import Pose6

HOMING_S = 90.0
"""Within which a stage has found its switches, s."""


@dataclass(frozen=True)
class RobotState:
    """normal: whether it may be moved. stopped: by its controller, to protect something. words:
    what it says of itself. force_n: (x, y, z) N in the base frame, None where nobody measures it.
    time_s: of the robot's own clock, s."""

    normal: bool
    words: str = "normal"
    stopped: bool = False
    force_n: tuple[float, float, float] | None = None
    time_s: float | None = None


class Robot(Protocol):
    """Poses are of the tool's centre point in the robot's base frame, mm and deg (sxyz).

    turns: whether the tool can be turned. Methods raise RobotError.
    """

    turns: bool

    def connect(self) -> None:
        """Get ready to move, or say what keeps it from that. May take ``connect_s``."""
        ...

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        """Begin a straight move, mm/s and mm/s^2, and return."""
        ...

    def moving(self) -> bool:
        """Whether the move goes on."""
        ...

    def pose(self) -> Pose6:
        """Where the tool is."""
        ...

    def stop(self) -> None:
        """Begin to stop; ``moving`` says when it stands."""
        ...

    def state(self) -> RobotState: ...

    def tick(self) -> None:
        """Called at least at every turn of the control loop: keeps watchdogs quiet."""
        ...

    def close(self) -> None:
        """Let go of the robot. Never raises."""
        ...

    def describe(self) -> dict[str, str]:
        """Versions and settings, for people and the record."""
        ...


@runtime_checkable
class Recovers(Protocol):
    """Optional: a robot whose protective stop can be released from here."""

    def recover(self) -> None:
        """Release the stop and get ready again. Raises RobotError when that is refused."""
        ...


@runtime_checkable
class Homes(Protocol):
    """Optional: a stage that finds its position at its switches. at_switches: whether it stands
    there."""

    at_switches: bool

    def home(self) -> None:
        """Drive to the switches, at most HOMING_S. Raises RobotError."""
        ...


@runtime_checkable
class Probes(Protocol):
    """Optional: a robot that stops by itself where a probe closes its contact."""

    def probe(self, pose: Pose6, speed: float) -> Pose6 | None:
        """Move towards a pose, mm and deg, at mm/s until contact; the pose there, None: none."""
        ...
