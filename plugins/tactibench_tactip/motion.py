"""Motion of the tool: one thread owns the robot, every target is checked, every wait ends."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import Any, Self, TypeVar

import numpy as np

from tactibench import Scene, UserError
from tactibench_tactip.geometry import (
    Array,
    PressGeometry,
    PressPath,
    angle_between,
    distance_between,
    envelope_violation,
    inverse,
    matrix,
    pose_of,
)
from tactibench_tactip.robots import (
    GuardError,
    ProtectiveStopError,
    Purpose,
    Robot,
    RobotError,
    RobotState,
    StopNowError,
    connect_seconds,
)
from tactibench_tactip.settings import Pose6, RobotSettings, Settings

T = TypeVar("T")

TICK_S = 0.008
"""Period of the control loop: 125 Hz."""
LOOK_S = 0.05
"""Longest single wait for a job: a signal that comes just before it is handled when it ends."""
TURN_DEG_S = 50.0
"""Speed at which a tool is assumed to turn."""
REACHED_MM, REACHED_DEG = 0.1, 0.2
"""Distance and angle within which a pose counts as reached."""
STANDS_MM, STANDS_DEG = 0.05, 0.1
"""Distance and angle within which a tool that is not said to move has made its move: less than a
step of a search."""
OFF_LINE_MM = 2.0
"""Distance of the tool from its line above which a move is stopped."""
CLOSE_S = 10.0
STOP_S = 3.0
"""Longest wait until a stopped robot stands still."""
QUIET_S = 20.0
"""Time for which the robot's thread may do nothing: every single answer is waited for less."""
GRACE_S = 1.5
"""Time after which a move counts as ended, where the tool stands short of its target and the
controller reports no move: some report a move only a little after its beginning."""
SLACK_MM = 0.05
"""Distance below clearance at which the tool still counts as being at clearance."""
STEP_MM = 0.5
"""Longest move that nobody watches where the tool may touch: a controller that no longer hears this
program goes on no farther. The watchdog of a UR watches a move of less in its period."""
LEAST_SHARE = 0.01
"""Least share of the speed that a move is waited for: below, the speed slider stands at zero."""

Guard = Callable[[Pose6], str]
"""A function of the pose in the work frame during a move, which returns a reason to stop it, or
"" to let it go on."""


def move_seconds(start: Pose6, end: Pose6, speed: float, acceleration: float) -> float:
    """Return the time of a straight move from rest to rest, s.

    Up to v^2 / a the top speed is not reached: t = 2 sqrt(d / a); beyond, t = d / v + v / a. A move
    takes at least the time of its turn.

    Args:
        start: First pose.
        end: Last pose.
        speed: Top speed v, mm/s.
        acceleration: a, mm/s^2.
    """
    distance = distance_between(start, end)
    if distance < speed**2 / acceleration:
        seconds = 2.0 * math.sqrt(distance / acceleration)
    else:
        seconds = distance / speed + speed / acceleration
    return max(seconds, angle_between(start, end) / TURN_DEG_S)


def patience(expected_s: float) -> float:
    """Return the seconds after which a move is given up: twice its time, and 2 s more."""
    return 2.0 * expected_s + 2.0


def steps_in_touch(start: Pose6, target: Pose6, speed: float, robot: RobotSettings) -> list[Pose6]:
    """Return the ends of the moves that make a move where the tool may touch, see STEP_MM."""
    watched = robot.driver == "ur" and speed <= STEP_MM * robot.watchdog_hz
    if watched or target[2] <= start[2]:
        return [target]
    count = math.ceil(distance_between(start, target) / STEP_MM)
    places = np.linspace(start[:3], target[:3], count + 1)[1:].tolist()
    return [(x, y, z, *target[3:]) for x, y, z in places]


def distance_from_line(start: Pose6, end: Pose6, here: Pose6) -> float:
    """Return the distance of a position from the line between two, mm."""
    a, b, p = (np.array(pose[:3]) for pose in (start, end, here))
    along = b - a
    length = float(along @ along)
    share = 0.0 if length == 0 else min(1.0, max(0.0, float((p - a) @ along) / length))
    return float(np.linalg.norm(p - a - share * along))


class Mover:
    """A mover of a robot in the work frame, for the one thread that owns the robot.

    Args:
        robot: The connected robot.
        settings: Configuration of the setup.
        halt: Event that is set from outside to stop at once.

    Attributes:
        last_pose: The pose that was read last, in the work frame; None: none was.
        checked_s: Moment of ``time.monotonic`` of the last check of the robot.
    """

    def __init__(self, robot: Robot, settings: Settings, halt: threading.Event) -> None:
        self._robot = robot
        self._settings = settings
        self._halt = halt
        self._work = matrix(settings.frames.work_frame)
        self._from_base = inverse(self._work)
        self.last_pose: Pose6 | None = None
        self.checked_s = 0.0

    def pose(self) -> Pose6:
        """Return the pose of the tool in the work frame."""
        self.last_pose = pose_of(self._from_base @ matrix(self._robot.pose()))
        return self.last_pose

    def force(self) -> Array | None:
        """Return the force (3,) in the work frame, N; None where the robot does not measure it."""
        force = self._robot.state().force_n
        turn: Array = self._work[:3, :3]
        return None if force is None else turn.T @ force

    def go(self, target: Pose6, speed: float, guard: Guard | None = None) -> None:
        """Move straight to a pose in the work frame and wait until it is reached.

        The way out, up from the sensor, is always free: neither the guard nor the time that a move
        may take stops it while the tool moves.

        Args:
            target: The pose.
            speed: Top speed, mm/s.
            guard: Guard of the move, if any.

        Raises:
            RobotError: The target lies outside the envelope, and farther than the tool does, or the
                robot is not normal, stops before the target or needs too long.
            GuardError: The tool leaves its line, or the guard returns a reason.
            StopNowError: Somebody asked to stop.
        """
        violation = envelope_violation(self._settings.envelope, target, self.pose())
        if violation:
            raise RobotError(f"the tool was to go to {violation}; nothing was moved.")
        self._go(target, speed, guard)

    def go_in_touch(self, target: Pose6, speed: float, guard: Guard) -> None:
        """Move as ``go`` does where the tool may touch: in steps, unless the robot has a watchdog.

        Args:
            target: The pose, of the present orientation.
            speed: Top speed, mm/s.
            guard: Guard of the move.
        """
        for pose in steps_in_touch(self.pose(), target, speed, self._settings.robot):
            self.go(pose, speed, guard)

    def check_inside(self) -> Pose6:
        """Return the pose of the tool, or raise UserError where it is outside the envelope."""
        pose = self.pose()
        violation = envelope_violation(self._settings.envelope, pose)
        if violation:
            raise UserError(
                f"the tool stands at {violation}; drive it into the envelope above the sensor "
                "first, with the pendant or `tactibench hw jog`."
            )
        return pose

    def come_in(self, speed: float) -> None:
        """Move from a stage's switches, which may lie outside the envelope, into it.

        It moves sideways at the height of the switches, then down.

        Raises:
            RobotError: The height of the switches is not above the clearance, or a move fails.
        """
        limits = self._settings.envelope
        _, _, z, a, b, c = self.pose()
        if z > -limits.clearance_mm:
            raise RobotError(
                f"the stage's switches are at z {z:.1f} mm of the work frame, not above the "
                f"sensor's clearance of {-limits.clearance_mm:g} mm; check frames.work_frame."
            )
        self._go((0.0, 0.0, z, a, b, c), speed, None)
        self._go((0.0, 0.0, max(z, -limits.above_mm), a, b, c), speed, None)

    def descend(self, path: PressPath, guard: Guard) -> int:
        """Move along a path, above, near and down, from any place at clearance.

        Args:
            path: Path of the press.
            guard: Guard of the moves to near and down.

        Returns:
            The moment of ``time.monotonic_ns`` at which the tool left near.
        """
        robot = self._settings.robot
        self.go(path.above, robot.approach_mm_s)
        self.go(path.near, robot.approach_mm_s, guard)
        left_ns = time.monotonic_ns()
        self.go_in_touch(path.down, robot.press_mm_s, guard)
        return left_ns

    def withdraw(self, scene: Scene, geometry: PressGeometry) -> None:
        """Move straight back along the approach axis to clearance, unless the tool is that high."""
        reached = geometry.reached(scene, self.pose())
        clear = geometry.clear_depth(reached)
        if not math.isfinite(clear):  # beside the dome: up along the work frame's own axis
            self.raise_straight(geometry)
        elif reached.pose.depth > clear + SLACK_MM:
            self._go(geometry.at_depth(reached, clear), self._settings.robot.retract_mm_s, None)

    def raise_straight(self, geometry: PressGeometry) -> None:
        """Move up along the work frame's z until the whole indenter is clearance_mm above the apex.

        It starts from any place, and comes before any sideways motion.
        """
        x, y, z, a, b, c = self.pose()
        if z > geometry.clear_height + SLACK_MM:
            above = (x, y, geometry.clear_height, a, b, c)
            self._go(above, self._settings.robot.approach_mm_s, None)

    def force_guard(self) -> Guard:
        """Return a guard that stops where the force differs by ``max_force_n`` from now."""
        before, most_n = self.force(), self._settings.envelope.max_force_n

        def guard(_: Pose6) -> str:
            force = self.force()
            if before is None:
                return ""
            if force is None:
                return "the robot no longer tells its force; look at it."
            change = float(np.linalg.norm(force - before))
            if change <= most_n:
                return ""
            return (
                f"the force changed by {change:.1f} N, envelope.max_force_n allows {most_n:g} N; "
                "look what is in the way."
            )

        return guard

    def stop(self) -> None:
        """Stop the robot, or raise RobotError where it does not stand still within STOP_S."""
        self._robot.stop()
        end = time.monotonic() + STOP_S
        while self._robot.moving():
            if time.monotonic() > end:
                raise RobotError(f"the robot still moves {STOP_S:g} s after it was told to stop.")
            time.sleep(TICK_S)

    def check(self) -> RobotState:
        """Return the state, or raise an error.

        Raises:
            StopNowError: Somebody asked to stop.
            RobotError: The robot is not normal.
        """
        self.checked_s = time.monotonic()
        if self._halt.is_set():
            raise StopNowError
        state = self._robot.state()
        if not state.normal:
            kind = ProtectiveStopError if state.stopped else RobotError
            raise kind(f"the robot is not normal: {state.description}.")
        return state

    def rest(self, seconds: float) -> None:
        """Stand still for a time.

        Raises:
            StopNowError: Somebody asked to stop.
            RobotError: The robot is not normal.
        """
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.check()
            time.sleep(min(TICK_S, left))

    def _go(self, target: Pose6, speed: float, guard: Guard | None) -> None:
        self.check()
        start = self.pose()
        acceleration = self._settings.robot.acceleration_mm_s2
        for attempt in (1, 2):
            self._robot.start(pose_of(self._work @ matrix(target)), speed, acceleration)
            self._wait(start, target, speed, guard)
            reached = self.pose()
            if _same(reached, target):
                return
            # A robot that did not move at all may have missed the command; a robot that stopped on
            # its way was held.
            if attempt == 2 or not _same(reached, start):
                raise RobotError(
                    f"the robot stopped {distance_between(reached, target):.2f} mm and "
                    f"{angle_between(reached, target):.1f} deg before its target; look whether "
                    "somebody held it."
                )

    def _wait(self, start: Pose6, target: Pose6, speed: float, guard: Guard | None) -> None:
        """Wait until a move ends, and stop it where something is wrong."""
        goes_out = target[2] < start[2] - SLACK_MM
        expected = move_seconds(start, target, speed, self._settings.robot.acceleration_mm_s2)
        share, last = 1.0, start
        began_s = moved_s = time.monotonic()
        try:
            while self._robot.moving() or (
                time.monotonic() - moved_s < GRACE_S
                and not _same(self.pose(), target, STANDS_MM, STANDS_DEG)
            ):
                share = max(LEAST_SHARE, min(share, self.check().speed_share))
                pose = self.pose()
                self._check_way(start, target, pose, None if goes_out else guard)
                now_s = time.monotonic()
                if distance_between(pose, last) > REACHED_MM:
                    last, moved_s = pose, now_s
                limit = patience(expected / share)
                if now_s - (moved_s if goes_out else began_s) > limit:
                    slow = f" with the speed slider at {100 * share:.0f} %" if share < 1.0 else ""
                    raise RobotError(
                        f"a move of {distance_between(start, target):.1f} mm took longer than "
                        f"{limit:.1f} s{slow}; look whether the robot is held or slowed down."
                    )
                time.sleep(TICK_S)
        except BaseException:
            with suppress(RobotError):  # the reason for stopping is the error that is shown
                self.stop()
            raise
        self.check()

    def _check_way(self, start: Pose6, target: Pose6, pose: Pose6, guard: Guard | None) -> None:
        distance = distance_from_line(start, target, pose)
        if not distance <= OFF_LINE_MM:  # a pose of NaN is beside every line
            raise GuardError(f"the tool was {distance:.1f} mm beside its line.")
        reason = "" if guard is None else guard(pose)
        if reason:
            raise GuardError(reason)


class RobotThread:
    """The one thread that owns the robot: it connects on entry and lets go on exit.

    On entry, RobotError is raised where the robot does not answer within ``robot.connect_s``,
    homing not counted.

    Args:
        robot: The robot.
        settings: Configuration of the setup.
        purpose: What the robot is connected for.

    Attributes:
        robot: The robot.
        halt: Event that stops all motion, also homing while it connects.
        mover: Mover of the robot; only jobs may call it.
    """

    def __init__(self, robot: Robot, settings: Settings, purpose: Purpose = "move") -> None:
        self.robot = robot
        self.halt = threading.Event()
        self.mover = Mover(robot, settings, self.halt)
        self._settings, self._purpose = settings, purpose
        self._jobs: queue.SimpleQueue[tuple[Callable[[Mover], Any], Future[Any]] | None] = (
            queue.SimpleQueue()
        )
        self._thread = threading.Thread(target=self._run, name="tactip robot", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        seconds = connect_seconds(self._settings, self._purpose)
        end = time.monotonic() + seconds
        connected = self._submit(lambda _: self.robot.connect(self._purpose))
        try:
            while not (connected.done() or self.halt.is_set()) and time.monotonic() < end:
                wait([connected], LOOK_S)
            if not connected.done():
                if self.halt.is_set():
                    raise StopNowError
                raise RobotError(
                    f"the robot at {self._settings.robot.address} did not answer within "
                    f"{seconds:g} s; check that it is switched on and that robot.address is right."
                )
            connected.result()
        except BaseException:
            self._jobs.put(None)  # the thread then closes the robot, unless it hangs
            if connected.done():
                self._thread.join(CLOSE_S)
            else:
                self.robot.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._jobs.put(None)
        self._thread.join(CLOSE_S)

    def do(self, job: Callable[[Mover], T]) -> T:
        """Return the result of a job that the robot's thread does.

        Errors of the job are raised here. A job whose caller no longer waits, because nothing was
        done for QUIET_S or because of Ctrl-C, is told to stop, or never begun.

        Args:
            job: Function of the mover.

        Raises:
            RobotError: The robot's thread hangs.
        """
        future, asked_s = self._submit(job), time.monotonic()
        try:
            while not future.done():
                if time.monotonic() - max(asked_s, self.mover.checked_s) > QUIET_S:
                    raise RobotError(
                        f"the robot's thread has not answered for {QUIET_S:g} s; it was told to "
                        "stop. Look at the robot."
                    )
                wait([future], LOOK_S)
        except BaseException:
            if not future.done():
                self.halt.set()
                future.cancel()
            raise
        return future.result()

    def _submit(self, job: Callable[[Mover], T]) -> Future[T]:
        future: Future[T] = Future()
        self._jobs.put((job, future))
        return future

    def _run(self) -> None:
        while True:
            item = self._jobs.get()
            if item is None:
                break
            job, future = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(job(self.mover))
            except BaseException as error:  # noqa: BLE001 - given to the caller
                future.set_exception(error)
        self.robot.close()


def _same(a: Pose6, b: Pose6, mm: float = REACHED_MM, deg: float = REACHED_DEG) -> bool:
    return distance_between(a, b) < mm and angle_between(a, b) < deg
