"""Collection of a plan's presses into a data set; it may be interrupted at any time.

An acknowledged sample is never lost and never made twice: the plan is written first, a sample is
written when it is complete, and a later session makes the presses that the data set lacks.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from tactibench import Indenter, Scene, UserError
from tactibench.datasets import Draft, Writer
from tactibench.lab import Press
from tactibench_tactip.camera import Image
from tactibench_tactip.errors import CameraError, GuardError, ProtectiveStopError, StopNowError
from tactibench_tactip.plan import (
    CollectionPlan,
    by_indenter,
    indenter_settings,
    is_mounted,
    with_smallest_turn,
)
from tactibench_tactip.press_result import PressResult
from tactibench_tactip.robots.base import RecoverableRobot
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import FirstTouch, TouchAge, find_touch

MountRequest = Callable[[Indenter, int], bool]
"""A function that asks a person to mount an indenter for a number of presses, and returns whether
it was done."""

ATTEMPTS = 2
"""Attempts at a press in a session before it is written as bad."""
STOPS_OF_PRESS = 2
"""Protective stops at one press, over all sessions, before it is given up."""
RECOVER_PRESSES = 500
"""Fewest presses between two protective stops that are released without asking."""
DRIFT_MM = 0.05
"""Drift of first touch between two searches above which a warning is given."""

EXTRA = MappingProxyType(
    {
        "draw": "",
        "outcome": "",
        "reason": "",
        "depth_cmd_mm": 0.0,
        "depth_meas_mm": 0.0,
        "z0_mm": 0.0,
        "z0_method": "",
        "pose_cmd": (),
        "pose_meas_before": (),
        "pose_meas_after": (),
        "force_n": (),
        "t_settle_ns": 0,
        "robot_timestamp": (),
        "frames_median": 0,
        "looks": 0,
        "brightness_mean": 0.0,
        "brightness_std": 0.0,
        "saturated": 0.0,
        "n_pins": -1,
    }
)
"""Every key of ``extra`` in its order, with the value for a press that lacks it, so that every row
has each key with the same type."""


@dataclass
class SessionReport:
    """The outcome of a session.

    Attributes:
        ok: Samples that may be used.
        bad: Samples that were written as bad.
        touches: First touches, in order.
        stops: Protective stops.
        left: Presses that are still missing.
        interrupted: Whether a person ended it.
    """

    ok: int = 0
    bad: int = 0
    touches: list[FirstTouch] = field(default_factory=list)
    stops: int = 0
    left: int = 0
    interrupted: bool = False


@dataclass(frozen=True)
class Callbacks:
    """Functions by which a session tells and asks a person.

    Attributes:
        notify: Takes a sentence for a person.
        advance: Takes the number of samples just written.
        should_end: Returns whether to end after this press.
        mount: Asks for another indenter, and returns whether it is mounted.
    """

    notify: Callable[[str], None] = lambda _: None
    advance: Callable[[int], None] = lambda _: None
    should_end: Callable[[], bool] = lambda: False
    mount: MountRequest = lambda _indenter, _count: False


class Collector:
    """One session at an open station; it continues the report of earlier sessions."""

    def __init__(
        self,
        station: Station,
        plan: CollectionPlan,
        writer: Writer,
        report: SessionReport,
        callbacks: Callbacks,
    ) -> None:
        self._station, self._plan, self._writer = station, plan, writer
        self._report, self._callbacks = report, callbacks
        self._session = uuid.uuid4().hex[:12]
        self._method = station.settings.contact.method
        self._touch = TouchAge(station.settings)
        self._bad_in_row = 0
        self._recovered_at = -RECOVER_PRESSES
        self._stops: Counter[int] = Counter(
            int(event["id"]) for event in writer.events if event.get("kind") == "protective-stop"
        )

    @property
    def _settings(self) -> Settings:
        return self._station.settings

    def run(self) -> None:
        """Make the presses that are missing.

        Presses that need another indenter are made when ``mount`` says that it is mounted.

        Raises:
            UserError: A device failed, a press may not be made, or too many presses in a row were
                bad.
        """
        report, writer = self._report, self._writer
        todo = [press for press in self._plan.presses if press.id not in writer.done]
        writer.event(
            "session",
            session=self._session,
            todo=len(todo),
            press_mm_s=self._settings.robot.press_mm_s,
            settle_s=self._settings.timing.settle_s,
            robot=self._station.robot.describe(),
        )
        mounted = self._settings.indenter
        groups = sorted(
            by_indenter(todo).items(), key=lambda item: not is_mounted(mounted, item[0])
        )
        try:
            for indenter, presses in groups:
                if not report.interrupted and self._mount(indenter, len(presses)):
                    self._press_all(presses)
        except StopNowError:
            report.interrupted = True
        finally:
            report.left = len(self._plan) - len(writer.done)

    def _mount(self, indenter: Indenter, count: int) -> bool:
        """Return whether the indenter is mounted; where it is not, a person is asked to do it."""
        if is_mounted(self._settings.indenter, indenter):
            return True
        settings = indenter_settings(indenter)
        if settings is None:
            return False
        self._station.make_room()
        if not self._callbacks.mount(indenter, count):
            return False
        self._station.mount(settings)
        return True

    def _press_all(self, presses: Iterable[Press]) -> None:
        """Make the presses of one indenter, whose length is not known before it first touches."""
        first = True
        for press in presses:
            if self._callbacks.should_end():
                self._report.interrupted = True
                return
            if first or self._touch.is_due:
                self._find_touch(first=first)
                first = False
            self._press(press)

    def _find_touch(self, *, first: bool) -> None:
        """Take a new rest frame, find first touch from it, and check all planned poses again."""
        station = self._station
        rest = station.look_at_rest()
        self._writer.reference(rest.image)
        before = station.geometry.z0
        touch = find_touch(station, first=first)
        drift = 0.0 if first else touch.z0_mm - before
        self._writer.event(
            "touch",
            session=self._session,
            z0_mm=touch.z0_mm,
            spread_mm=touch.spread_mm,
            drift_mm=drift,
            method=touch.method,
            power=touch.power,
            brightness=rest.brightness,
            pins=rest.pins,
        )
        if abs(drift) > DRIFT_MM:
            self._callbacks.notify(f"first touch drifted by {drift:+.3f} mm")
        station.check_plan(self._plan)
        self._report.touches.append(touch)
        self._touch = TouchAge(self._settings)

    def _press(self, press: Press) -> None:
        """Make one press until it is written.

        Where the whole setup has a fault, nothing is written, so that the next session makes this
        press.

        Raises:
            UserError: The setup has a fault, or too many presses in a row were bad.
        """
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result, reason = self._station.press_checked(with_smallest_turn(press.scene))
            except ProtectiveStopError as error:
                self._handle_stop(press, error, attempt)
                return
            except CameraError as error:
                self._event("camera", press, str(error))
                if attempt == ATTEMPTS:
                    raise
                self._station.camera.now()  # reopens the camera, or raises where it is gone
                continue
            except GuardError as error:
                self._event("tripped", press, str(error))
                if attempt == ATTEMPTS:
                    self._give_up(press, str(error), attempt)
                    return
                continue
            if not reason or attempt == ATTEMPTS:
                break
            self._event("bad-frame", press, reason)
        if reason:
            self._station.check_undeformed()
        self._write_result(press, result, attempt, reason)

    def _give_up(self, press: Press, reason: str, attempt: int) -> None:
        """Write a press that was aborted, with an image of the undeformed sensor."""
        image = self._station.rest_reference().image
        extra = _extra(
            press,
            outcome="aborted",
            reason=reason,
            z0_mm=self._station.geometry.z0,
            z0_method=self._method,
            brightness_mean=float(image.mean()),
            brightness_std=float(image.std()),
        )
        draft = self._draft(press, press.scene, image, extra, attempt)
        self._write(press, draft, f"aborted, {reason}")

    def _write_result(self, press: Press, result: PressResult, attempt: int, reason: str) -> None:
        """Write a press that was completed.

        Args:
            press: The press.
            result: Its outcome.
            attempt: Number of the attempt, from 1.
            reason: Why its frame is bad; "" where it is good.
        """
        check, state = result.check, result.state
        extra = _extra(
            press,
            outcome="bad_frame" if reason else "ok",
            reason=reason,
            depth_meas_mm=result.scene.pose.depth,
            z0_mm=result.z0,
            z0_method=self._method,
            pose_cmd=_floats(result.commanded),
            pose_meas_before=_floats(result.before),
            pose_meas_after=_floats(result.after),
            force_n=_floats(state.force_n or ()),
            t_settle_ns=result.settled_ns,
            robot_timestamp=[] if state.time_s is None else [state.time_s],
            frames_median=len(result.frames),
            looks=result.looks,
            brightness_mean=check.brightness,
            brightness_std=check.contrast,
            saturated=check.saturated,
            n_pins=check.pins,
        )
        draft = self._draft(press, result.scene, check.image, extra, attempt, check.t_ns)
        self._write(press, draft, reason)

    def _draft(
        self,
        press: Press,
        scene: Scene,
        image: Image,
        extra: dict[str, Any],
        attempt: int,
        t_frame_ns: int | None = None,
    ) -> Draft:
        return Draft(
            image,
            press.id,
            scene,
            press=press.name,
            session=self._session,
            t_frame_ns=t_frame_ns,
            extra=extra,
            status="ok" if extra["outcome"] == "ok" else "bad",
            attempt=attempt,
        )

    def _write(self, press: Press, draft: Draft, reason: str) -> None:
        """Write a sample.

        Raises:
            UserError: Too many samples in a row were bad.
        """
        self._writer.add_many([draft])
        self._touch.presses += 1
        self._callbacks.advance(1)
        if not reason:
            self._report.ok += 1
            self._bad_in_row = 0
            return
        self._report.bad += 1
        self._bad_in_row += 1
        self._callbacks.notify(f"press {press.id}: {reason}; written as bad")
        if self._bad_in_row >= self._settings.safety.give_up:
            raise UserError(
                f"{self._bad_in_row} presses in a row were bad, the last because of press "
                f"{press.id}: {reason}; fix that, then go on with the same command."
            )

    def _handle_stop(self, press: Press, error: ProtectiveStopError, attempt: int) -> None:
        """Handle a protective stop, which is released only where the configuration says so.

        Raises:
            ProtectiveStopError: A person has to release the stop, or the tool was left where it is.
        """
        report, robot = self._report, self._station.robot
        report.stops += 1
        self._stops[press.id] += 1
        self._event("protective-stop", press, str(error))
        if self._stops[press.id] >= STOPS_OF_PRESS:
            self._give_up(press, str(error), attempt)
        written = report.ok + report.bad
        allowed = report.stops <= self._settings.safety.auto_recover
        rare = written - self._recovered_at >= RECOVER_PRESSES
        if not allowed or not rare or not isinstance(robot, RecoverableRobot):
            raise ProtectiveStopError(
                f"{error} It was at press {press.id}. Look at the arm and the sensor, release the "
                "stop on the pendant, and go on with the same command."
            )
        self._recovered_at = written
        self._station.do(lambda _: robot.recover(), 60.0)
        problem = self._station.withdraw()
        if problem:
            raise ProtectiveStopError(f"after a protective stop: {problem}.")
        self._event("recovered", press, "released as safety.auto_recover allows")
        self._callbacks.notify(f"press {press.id}: a protective stop was released")
        if press.id not in self._writer.done:
            self._give_up(press, str(error), attempt)
        self._find_touch(first=False)

    def _event(self, kind: str, press: Press, reason: str) -> None:
        self._writer.event(kind, id=press.id, reason=reason, session=self._session)


def _extra(press: Press, **values: Any) -> dict[str, Any]:
    """Return the values of a press, and those of EXTRA for the keys that it lacks."""
    given = {"draw": press.draw, "depth_cmd_mm": float(press.scene.pose.depth), **values}
    assert given.keys() <= EXTRA.keys(), "keys of extra"  # noqa: S101
    empty = {key: [] if value == () else value for key, value in EXTRA.items()}
    return empty | given


def _floats(values: Iterable[float]) -> list[float]:
    return [float(value) for value in values]
