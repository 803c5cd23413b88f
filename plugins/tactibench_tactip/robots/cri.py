"""Any robot object with ``move_linear``, ``pose`` and ``close``, such as those of cri."""

from __future__ import annotations

import threading
from contextlib import suppress
from importlib import import_module
from typing import Any

from tactibench import UserError
from tactibench_tactip.failures import RobotError
from tactibench_tactip.robots.base import RobotState
from tactibench_tactip.settings import Pose6, Settings


class CriRobot:
    """``move_linear`` blocks until the robot stands, so it runs in a thread of its own, one at a
    time. The robot is asked for nothing else meanwhile; ``stop`` is used where it has one, and
    otherwise the move, which is one press at most, runs to its end.

    ``robot.address`` names what makes the robot: ``package.module:callable``, called without
    arguments. It must talk mm and deg in axes sxyz, of the tool in the base frame.
    """

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._address = settings.robot.address
        self._tcp = settings.frames.tcp_pose
        self._robot: Any = None
        self._move: threading.Thread | None = None
        self._failed: BaseException | None = None
        self._pose: Pose6 | None = None

    def connect(self) -> None:
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
        self._pose = self._read()

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:  # noqa: ARG002
        if self._move is not None and self._move.is_alive():
            raise RobotError("the robot was asked to move while it moves; this is a bug.")
        if hasattr(self._robot, "linear_speed"):
            self._robot.linear_speed = speed
        self._move = threading.Thread(target=self._run, args=(pose,), name="cri move", daemon=True)
        self._move.start()

    def _run(self, pose: Pose6) -> None:
        try:
            self._robot.move_linear(pose)
        except BaseException as error:  # noqa: BLE001 - raised again by the owner
            self._failed = error

    def moving(self) -> bool:
        if self._move is None or self._move.is_alive():
            return self._move is not None
        self._move = None
        failed, self._failed = self._failed, None
        if failed is not None:
            raise RobotError(f"move_linear raised {type(failed).__name__}: {failed}.")
        self._pose = self._read()
        return False

    def pose(self) -> Pose6:
        """Where it is; during a move, where it was before."""
        if self._move is None:
            self._pose = self._read()
        assert self._pose is not None, "connected"  # noqa: S101
        return self._pose

    def _read(self) -> Pose6:
        x, y, z, a, b, c = (float(value) for value in self._robot.pose)
        return x, y, z, a, b, c

    def stop(self) -> None:
        if hasattr(self._robot, "stop"):
            self._robot.stop()

    def state(self) -> RobotState:
        return RobotState(normal=True, words="not told")

    def tick(self) -> None:
        """Nothing to keep quiet."""

    def close(self) -> None:
        robot, self._robot = self._robot, None
        with suppress(Exception):  # there is nobody left to tell
            if robot is not None:
                robot.close()

    def describe(self) -> dict[str, str]:
        info = getattr(self._robot, "info", "")
        return {"driver": "cri", "robot": f"{type(self._robot).__name__} {info}".strip()}
