"""Any robot object with ``move_linear``, ``pose`` and ``close``, such as those of cri."""

from __future__ import annotations

import threading
from contextlib import suppress
from importlib import import_module
from typing import Any

from tactibench import UserError
from tactibench_tactip.errors import RobotError
from tactibench_tactip.robots.base import Robot, RobotState
from tactibench_tactip.settings import Pose6, Settings


class CriRobot(Robot):
    """A robot whose ``move_linear`` blocks until it stands: each move runs in a thread of its own.

    The robot is asked for nothing else meanwhile. Its ``stop`` is used where it has one; otherwise
    the move, which is one press at most, runs to its end. ``robot.address`` names a callable that
    makes the robot: ``package.module:callable``, called without arguments. The robot's poses must
    be of the tool in the base frame, in mm and deg in axes sxyz.
    """

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._address = settings.robot.address
        self._tcp = settings.frames.tcp_pose
        self._robot: Any = None
        self._move: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._pose: Pose6 = (0.0,) * 6

    def connect(self) -> None:
        """Make the robot.

        Raises:
            UserError: ``robot.address`` names no callable, or one that makes an object without
                ``move_linear``, ``pose`` or ``close``.
        """
        module, _, name = self._address.partition(":")
        try:
            make = getattr(import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise UserError(
                f"robot.address {self._address!r} cannot be used ({error}); driver cri needs "
                "package.module:callable, the callable that makes the robot."
            ) from None
        self._robot = make()
        for needed in ("move_linear", "pose", "close"):
            if not hasattr(self._robot, needed):
                raise UserError(f"{self._address} makes an object without {needed!r}; add it.")
        for name, value in (("axes", "sxyz"), ("coord_frame", (0.0,) * 6), ("tcp", self._tcp)):
            if hasattr(self._robot, name):
                setattr(self._robot, name, value)
        self._pose = self._read_pose()

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        """Begin a move in a thread of its own."""
        if self._move is not None and self._move.is_alive():
            raise RobotError("the robot was asked to move while it moves; this is a bug.")
        if hasattr(self._robot, "linear_speed"):
            self._robot.linear_speed = speed
        self._move = threading.Thread(target=self._run, args=(pose,), name="cri move", daemon=True)
        self._move.start()

    def _run(self, pose: Pose6) -> None:
        try:
            self._robot.move_linear(pose)
        except BaseException as error:  # noqa: BLE001 - raised again by ``moving``
            self._failure = error

    def moving(self) -> bool:
        """Return whether the move goes on.

        Raises:
            RobotError: The move failed.
        """
        if self._move is None or self._move.is_alive():
            return self._move is not None
        self._move = None
        failure, self._failure = self._failure, None
        if failure is not None:
            raise RobotError(f"move_linear raised {type(failure).__name__}: {failure}.")
        self._pose = self._read_pose()
        return False

    def pose(self) -> Pose6:
        """Return the pose of the tool; during a move, its pose before the move."""
        if self._move is None:
            self._pose = self._read_pose()
        return self._pose

    def _read_pose(self) -> Pose6:
        x, y, z, a, b, c = (float(value) for value in self._robot.pose)
        return x, y, z, a, b, c

    def stop(self) -> None:
        """Stop the robot, where it has a method ``stop``."""
        if hasattr(self._robot, "stop"):
            self._robot.stop()

    def state(self) -> RobotState:
        """Return a normal state: these robots do not report their state."""
        return RobotState(normal=True, description="not told")

    def close(self) -> None:
        """Close the robot."""
        robot, self._robot = self._robot, None
        with suppress(Exception):  # at the end no caller needs the error
            if robot is not None:
                robot.close()

    def describe(self) -> dict[str, str]:
        """Return the kind of robot."""
        info = getattr(self._robot, "info", "")
        return {"driver": "cri", "robot": f"{type(self._robot).__name__} {info}".strip()}
