"""Collection of a plan's presses into a data set; it may be interrupted at any time.

An acknowledged sample is never lost and never made twice: the plan is written first, a sample is
written when it is complete, and a later session makes the presses that the data set lacks.
"""

from __future__ import annotations

import signal
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from tactibench import Indenter, UserError, __version__
from tactibench.datasets import FRAMES, Draft, Header, Writer, is_dataset, open_dataset
from tactibench.lab import Press
from tactibench_tactip.camera import Camera, CameraError, FrameCheck
from tactibench_tactip.geometry import geometry_of
from tactibench_tactip.plan import (
    CollectionPlan,
    by_indenter,
    check_plan,
    is_mounted,
    with_smallest_turn,
)
from tactibench_tactip.robots import (
    GuardError,
    ProtectiveStopError,
    RobotState,
    StopNowError,
    make_robot,
)
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import PressResult, Station
from tactibench_tactip.touch import find_touch

MountRequest = Callable[[Indenter, int], bool]
"""A function that asks a person to mount an indenter for a number of presses, and returns whether
it was done."""

ATTEMPTS = 2
"""Attempts at a press in a session before it is written as bad."""
STOPS_OF_PRESS = 2
"""Protective stops at one press, over all sessions, before it is given up."""
FLAT, FLAT_FRAMES = 0.02, 15
"""Greatest relative change of the brightness between two groups of frames before a collection."""
DRIFT_MM = 0.05
"""Drift of first touch between two searches above which a warning is given."""


@dataclass
class SessionReport:
    """The outcome of a session.

    Attributes:
        ok: Samples that may be used.
        bad: Samples that were written as bad.
        left: Presses that are still missing.
        interrupted: Whether a person ended it.
    """

    ok: int = 0
    bad: int = 0
    left: int = 0
    interrupted: bool = False


@dataclass(frozen=True)
class Callbacks:
    """Functions by which a session tells and asks a person.

    Attributes:
        notify: Takes a sentence for a person.
        advance: Takes the number of samples just written.
        mount: Asks for another indenter, and returns whether it is mounted.
    """

    notify: Callable[[str], None] = lambda _: None
    advance: Callable[[int], None] = lambda _: None
    mount: MountRequest = lambda _indenter, _count: False


class Collector:
    """One session at an open station.

    Attributes:
        report: Outcome so far.
    """

    def __init__(
        self, station: Station, plan: CollectionPlan, writer: Writer, callbacks: Callbacks
    ) -> None:
        self.report = SessionReport()
        self._station, self._plan, self._writer = station, plan, writer
        self._callbacks = callbacks
        self._session = uuid.uuid4().hex[:12]
        self._bad_in_row = 0
        self._stops: Counter[int] = Counter(
            int(event["id"]) for event in writer.events if event.get("kind") == "protective-stop"
        )

    def run(self, ended: threading.Event) -> None:
        """Make the presses that are missing, until ``ended`` is set.

        Presses that need another indenter are made when ``mount`` says that it is mounted.

        Raises:
            UserError: A device failed, a press may not be made, or too many presses in a row were
                bad.
        """
        writer, settings = self._writer, self._station.settings
        todo = [press for press in self._plan.presses if press.id not in writer.done]
        writer.event(
            "session",
            session=self._session,
            todo=len(todo),
            configuration=settings.record(),
            robot=self._station.robot.describe(),
        )
        mounted = self._station.indenter
        groups = sorted(
            by_indenter(todo).items(), key=lambda item: not is_mounted(mounted, item[0])
        )
        for indenter, presses in groups:
            if ended.is_set():
                self.report.interrupted = True
            elif self._mount(indenter, len(presses)):
                self._press_all(presses, ended)

    def _mount(self, indenter: Indenter, count: int) -> bool:
        """Return whether the indenter is mounted; where it is not, a person is asked to do it."""
        station = self._station
        if is_mounted(station.indenter, indenter):
            return True
        station.make_room()
        if not station.robot.mount(indenter) and not self._callbacks.mount(indenter, count):
            return False
        station.mount(indenter)
        return True

    def _press_all(self, presses: Iterable[Press], ended: threading.Event) -> None:
        """Make the presses of one indenter, whose length is not known before it first touches."""
        for press in presses:
            if ended.is_set():
                self.report.interrupted = True
                return
            if self._station.touch_is_due:
                self._find_touch()
            self._press(press)

    def _find_touch(self) -> None:
        """Take a new rest frame, find first touch from it, and check all planned poses again."""
        station = self._station
        before = station.touch
        touch = find_touch(station)
        drift = 0.0 if before is None else touch.z0_mm - before.z0_mm
        rest = station.rest_reference()
        self._writer.reference(rest.image)
        self._writer.event(
            "touch",
            session=self._session,
            z0_mm=touch.z0_mm,
            spread_mm=touch.spread_mm,
            drift_mm=drift,
            method=station.settings.contact.method,
            brightness=rest.brightness,
            pins=rest.pins,
        )
        if abs(drift) > DRIFT_MM:
            self._callbacks.notify(f"first touch drifted by {drift:+.3f} mm")
        station.check_plan(self._plan)

    def _press(self, press: Press) -> None:
        """Make one press until it is written.

        Where the whole setup has a fault, nothing is written, so that the next session makes this
        press.

        Raises:
            UserError: The setup has a fault, or too many presses in a row were bad.
        """
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result = self._station.press_checked(with_smallest_turn(press.scene))
            except ProtectiveStopError as error:
                self._event("protective-stop", press, str(error))
                self._stops[press.id] += 1
                if self._stops[press.id] >= STOPS_OF_PRESS:
                    self._write_aborted(press, attempt, str(error))
                raise ProtectiveStopError(
                    f"{error} It was at press {press.id}. Look at the arm and the sensor, release "
                    "the stop on the pendant, and go on with the same command."
                ) from None
            except CameraError as error:
                self._event("camera", press, str(error))
                if attempt == ATTEMPTS:
                    raise
                self._station.camera.now()  # reopens the camera, or raises where it is gone
                continue
            except GuardError as error:
                self._event("tripped", press, str(error))
                if attempt == ATTEMPTS:
                    self._write_aborted(press, attempt, str(error))
                    return
                continue
            if not result.check.reason or attempt == ATTEMPTS:
                break
            self._event("bad-frame", press, result.check.reason)
        if result.check.reason:
            self._station.check_undeformed()
        self._write(press, result, attempt)

    def _write_aborted(self, press: Press, attempt: int, reason: str) -> None:
        """Write the undeformed sensor for a press that was aborted, see ``_write``."""
        image = self._station.rest_reference().image
        check = FrameCheck(reason, image, t_ns=0, saturated=0.0, pins=-1)
        state = RobotState(normal=False)
        self._write(press, PressResult(press.scene, check, 0, (), (), (), state, looks=0), attempt)

    def _write(self, press: Press, result: PressResult, attempt: int) -> None:
        """Write a press, whose frame is bad where its check has a reason.

        Args:
            press: The press.
            result: Its outcome; one without looks was aborted.
            attempt: Number of the attempt, from 1.

        Raises:
            UserError: Too many samples in a row were bad.
        """
        station, check, state = self._station, result.check, result.state
        reason, image = check.reason, check.image
        bad = "bad_frame" if result.looks else "aborted"
        extra: dict[str, Any] = {  # every row has every key, with a value of the same type
            "draw": press.draw,
            "outcome": bad if reason else "ok",
            "reason": reason,
            "depth_cmd_mm": float(press.scene.pose.depth),
            "depth_meas_mm": float(result.scene.pose.depth) if result.looks else 0.0,
            "z0_mm": station.geometry.z0,
            "z0_method": station.settings.contact.method,
            "pose_cmd": list(result.commanded),
            "pose_meas_before": list(result.before),
            "pose_meas_after": list(result.after),
            "force_n": list(state.force_n or ()),
            "t_settle_ns": result.settled_ns,
            "robot_timestamp": [] if state.time_s is None else [state.time_s],
            "looks": result.looks,
            "brightness_mean": float(image.mean()),
            "brightness_std": float(image.std()),
            "saturated": check.saturated,
            "n_pins": check.pins,
        }
        draft = Draft(
            image,
            press.id,
            result.scene,
            press=press.name,
            session=self._session,
            t_frame_ns=check.t_ns or None,
            extra=extra,
            status="bad" if reason else "ok",
            attempt=attempt,
        )
        self._writer.add_many([draft])
        self._callbacks.advance(1)
        if not reason:
            self.report.ok += 1
            self._bad_in_row = 0
            return
        self.report.bad += 1
        self._bad_in_row += 1
        self._callbacks.notify(f"press {press.id}: {reason}; written as bad")
        if self._bad_in_row >= station.settings.safety.give_up:
            raise UserError(
                f"{self._bad_in_row} presses in a row were bad, the last because of press "
                f"{press.id}: {reason}; fix that, then go on with the same command."
            )

    def _event(self, kind: str, press: Press, reason: str) -> None:
        self._writer.event(kind, id=press.id, reason=reason, session=self._session)


@contextmanager
def stop_signals(
    notify: Callable[[str], None], stop: Callable[[], None]
) -> Iterator[threading.Event]:
    """Handle the signals of this process in the block, which runs in the main thread.

    Args:
        notify: Function that takes a sentence for a person.
        stop: Function that stops the robot, at the second Ctrl-C and at SIGTERM.

    Yields:
        An event that is set at the first Ctrl-C: the session shall end after this press.
    """
    ended = threading.Event()

    def handle(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT and not ended.is_set():
            ended.set()
            notify("ending after this press; Ctrl-C again stops the robot now")
            return
        ended.set()
        notify("stopping the robot")
        stop()

    before = {n: signal.signal(n, handle) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def collect(
    settings: Settings,
    plan: CollectionPlan,
    folder: Path,
    *,
    callbacks: Callbacks,
    speed_scale: float = 1.0,
) -> SessionReport:
    """Make the presses of a plan that the folder lacks, and close it when it has them all.

    In this order: the plan is checked, the camera opened and its settings compared with those of
    the data set, the robot connected; only then something moves.

    Args:
        settings: Configuration of the setup. A data set of simulated devices says so, and no real
            device can go on with it.
        plan: The presses.
        folder: Folder of the data set.
        callbacks: Functions that tell and ask a person.
        speed_scale: Factor of this session's speeds; the data set's configuration stays as it is.

    Returns:
        The outcome of this session.

    Raises:
        UserError: The plan, the configuration or the folder allows no collection, or a device
            failed.
    """
    if _is_complete(folder, plan):
        callbacks.advance(len(plan))
        return SessionReport()
    robot = make_robot(settings)
    check_plan(plan, settings, geometry_of(settings), turns=robot.turns)
    with ExitStack() as stack:
        camera = stack.enter_context(robot.camera(settings.camera))
        warm_up(camera, settings)
        writer = stack.enter_context(Writer(folder, _header(settings, plan, camera), plan.rows()))
        callbacks.advance(len(writer.done))
        if len(writer.done) == len(plan):
            return SessionReport()
        station = Station(settings.with_speed_scale(speed_scale), robot, camera)
        session = Collector(station, plan, writer, callbacks)
        try:
            with stop_signals(callbacks.notify, station.stop_now) as ended, station:
                if writer.done:
                    first = open_dataset(folder).rest
                    if first is not None:
                        station.look_at_rest().check_alike(first, f"the first one of {folder}")
                session.run(ended)
        except StopNowError as stop:
            session.report.interrupted = True
            if before := str(stop.__context__ or ""):  # an error, after which somebody stopped it
                callbacks.notify(before)
                writer.event("error", reason=before)
        except UserError as error:
            writer.event("error", reason=str(error))
            raise
        except OSError as error:
            error.filename = error.filename or str(folder)  # for the sentence about a full disk
            raise
        session.report.left = len(plan) - len(writer.done)
        if station.place:  # "": it was stopped before there was a tool
            callbacks.notify(station.place)
        if not session.report.left:
            _write_splits(writer, plan)
    return session.report


def dry_run(
    settings: Settings, presses: Sequence[Press], height: float, callbacks: Callbacks
) -> int:
    """Make all moves of presses higher up; nothing is touched and nothing is stored.

    Args:
        settings: Configuration of the setup.
        presses: The presses.
        height: Height above the real moves, mm.
        callbacks: Functions that tell a person.

    Returns:
        The number of presses that were made.

    Raises:
        UserError: The envelope leaves no room for the height, a press may not be made, or a device
            failed.
    """
    room = settings.envelope.above_mm - settings.envelope.clearance_mm - 1.0
    if height > room:
        raise UserError(
            f"--dry-run-height is {height:g} mm, but envelope.above_mm leaves {room:g} mm above "
            "clearance; take less."
        )
    count = 0
    station = Station(settings)
    real, high = station.geometry, station.geometry.with_z0(settings.contact.fixed_mm - height)
    station.geometry = high
    station.check_plan(CollectionPlan("dry run", tuple(presses), {}))
    signals = stop_signals(callbacks.notify, station.stop_now)
    with suppress(StopNowError), signals as ended, station:
        try:
            for press in presses:
                if ended.is_set():
                    break
                scene = with_smallest_turn(press.scene)
                path = station.path(scene)
                with station.at(scene):
                    station.do(partial(station.down, path=path))
                count += 1
                callbacks.advance(1)
        finally:
            station.geometry = real  # for the sentence about the place of the tool
    callbacks.notify(station.place)
    return count


def warm_up(camera: Camera, settings: Settings) -> None:
    """Skip the first frames, and check that their rate and brightness are as they should be.

    Raises:
        CameraError: The rate is not the configuration's.
        UserError: The brightness changes, because the exposure is automatic or the light is cold.
    """
    for _ in range(settings.camera.warmup_frames):
        camera.now()
    means = []
    for _ in range(2):
        frames = camera.fresh(time.monotonic_ns(), FLAT_FRAMES)
        means.append(sum(float(frame.image.mean()) for frame in frames) / len(frames))
    camera.check_rate()
    change = abs(means[1] - means[0]) / max(1.0, means[0])
    if change > FLAT:
        raise UserError(
            f"the camera's brightness changed by {change:.1%} in a moment ({means[0]:.1f} to "
            f"{means[1]:.1f} grey levels); switch its automatic exposure off (camera.exposure) and "
            "let the light warm up."
        )


def _is_complete(folder: Path, plan: CollectionPlan) -> bool:
    """Return whether the folder holds a closed data set of exactly these presses."""
    if not is_dataset(folder):
        return False
    dataset = open_dataset(folder)
    return dataset.header.status == "closed" and list(dataset.plan()) == plan.rows()


def _header(settings: Settings, plan: CollectionPlan, camera: Camera) -> Header:
    """Return the header of a collection: to go on with a data set, it must be the same."""
    height, width = camera.now().image.shape
    actual = camera.read_back
    assert actual is not None, "the camera is open"  # noqa: S101
    return Header(
        name="tactip",
        sensor={
            "name": settings.sensor.name,
            **({"origin": "simulated"} if settings.simulated else {}),
            "plugin": f"tactibench_tactip {__version__}",
            "configuration": settings.binding(),
            "camera": {**asdict(actual), "fps": round(actual.fps, 1)},
        },
        image=(height, width),
        dome_radius_mm=settings.sensor.dome_radius_mm,
        frames={
            **FRAMES,
            "work": "z into the object; tool poses are in it: x, y, z mm, alpha, beta, gamma deg",
        },
        source={"importer": "tactibench hw collect", "presses": plan.source},
    )


def _write_splits(writer: Writer, plan: CollectionPlan) -> None:
    """Write the protocol's splits of the samples that may be used, unless a subset is empty."""
    good = {sample.id for sample in writer.samples if sample.status == "ok"}
    for name, parts in plan.splits.items():
        usable = {part: [i for i in ids if i in good] for part, ids in parts.items()}
        if all(usable.values()):
            writer.split(name, **usable)
