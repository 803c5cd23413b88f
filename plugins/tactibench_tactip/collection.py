"""From a configuration and a plan to a data set on the disk, or to a dry run."""

from __future__ import annotations

import hashlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from types import FrameType

from tactibench import UserError, __version__
from tactibench.datasets import FRAMES, Header, Writer, is_dataset, open_dataset
from tactibench.lab import Press
from tactibench_tactip.camera import Camera, Image
from tactibench_tactip.collector import Callbacks, Collector, SessionReport
from tactibench_tactip.errors import RobotLostError, StopNowError
from tactibench_tactip.frame_check import Reference
from tactibench_tactip.plan import CollectionPlan, check_plan, with_smallest_turn
from tactibench_tactip.press_geometry import geometry_of
from tactibench_tactip.robots.base import make_robot
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station

RECONNECTS = 2
"""Most times that a UR is connected again without a press in between; its watchdog has stopped
it."""
NO_CALLBACKS = Callbacks()
FLAT = 0.02
"""Greatest relative change of the brightness between two groups of frames before a collection."""
ALIKE_LEVELS = 6.0
"""Mean difference, grey levels, that the undeformed sensor may have when a collection goes on."""


class StopSignals:
    """Handler of signals: the first Ctrl-C ends after the press, the second or SIGTERM at once.

    Attributes:
        end_requested: Set once the session shall end after this press.
        stop: Function that stops the robot; it does nothing until there is one.
    """

    def __init__(self, notify: Callable[[str], None]) -> None:
        self.end_requested = threading.Event()
        self.stop: Callable[[], None] = lambda: None
        self._notify = notify

    def interrupt(self, number: int = signal.SIGINT, _frame: FrameType | None = None) -> None:
        """Handle a signal."""
        if number == signal.SIGINT and not self.end_requested.is_set():
            self.end_requested.set()
            self._notify("ending after this press; Ctrl-C again stops the robot now")
            return
        self.end_requested.set()
        self._notify("stopping the robot")
        self.stop()

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Handle the signals of this process in the block, where it runs in the main thread."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {n: signal.signal(n, self.interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def collect(
    settings: Settings,
    plan: CollectionPlan,
    folder: Path,
    *,
    callbacks: Callbacks = NO_CALLBACKS,
    on_station: Callable[[Station], None] = lambda _: None,
    speed_scale: float = 1.0,
    emulated: bool = False,
) -> SessionReport:
    """Make the presses of a plan that the folder lacks, and close it when it has them all.

    In this order: the plan is checked, the camera opened and its settings compared with those of
    the data set, the robot connected; only then something moves.

    Args:
        settings: Configuration of the setup.
        plan: The presses.
        folder: Folder of the data set.
        callbacks: Functions that tell and ask a person.
        on_station: Function that is called with every station that is entered.
        speed_scale: Factor of this session's speeds; the data set's configuration stays as it is.
        emulated: Whether the devices are emulators. The data set says so, and no real device can go
            on with it.

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
    report = SessionReport()
    with ExitStack() as stack:
        camera = stack.enter_context(Camera(settings.camera))
        warm_up(camera, settings)
        header = _header(settings, plan, camera, folder, emulated=emulated)
        writer = stack.enter_context(Writer(folder, header, plan.rows()))
        for sentence in writer.repaired:
            callbacks.notify(f"{folder}: {sentence}")
        callbacks.advance(len(writer.done))
        if len(writer.done) == len(plan):
            return report
        signals = StopSignals(callbacks.notify)
        stack.enter_context(signals.installed())
        callbacks = replace(callbacks, should_end=signals.end_requested.is_set)
        losses = 0
        while True:
            before = len(writer.done)
            station = Station(settings.with_speed_scale(speed_scale), robot, camera)
            signals.stop = station.stop_now
            try:
                with station:
                    on_station(station)
                    if writer.done:
                        _check_same_sensor(station.look_at_rest(), folder)
                    Collector(station, plan, writer, report, callbacks).run()
                break
            except StopNowError:  # before the first press
                report.interrupted, report.left = True, len(plan) - len(writer.done)
                break
            except RobotLostError as error:
                writer.event("lost", reason=str(error))
                losses = losses + 1 if len(writer.done) == before else 1
                if (
                    settings.robot.driver != "ur"
                    or losses > RECONNECTS
                    or signals.end_requested.is_set()
                ):
                    raise
                callbacks.notify(f"{error} Connecting again.")
                robot = make_robot(settings)
            except UserError as error:
                writer.event("error", reason=str(error))
                raise
        if not report.left:
            _write_splits(writer, plan)
    return report


def dry_run(
    settings: Settings, presses: Sequence[Press], height: float, advance: Callable[[int], None]
) -> int:
    """Make all moves of presses higher up; nothing is touched and nothing is stored.

    Args:
        settings: Configuration of the setup.
        presses: The presses.
        height: Height above the real moves, mm.
        advance: Called with 1 after every press.

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
    station.geometry = station.geometry.with_z0(settings.contact.fixed_mm - height)
    station.check_plan(CollectionPlan("dry run", tuple(presses), {}))
    signals = StopSignals(lambda _: None)
    signals.stop = station.stop_now
    with suppress(StopNowError), signals.installed(), station:
        for press in presses:
            if signals.end_requested.is_set():
                break
            scene = with_smallest_turn(press.scene)
            path = station.path(scene)
            with station.at(scene):
                station.do(partial(station.down, path=path))
                station.draw_back()
            count += 1
            advance(1)
    return count


def warm_up(camera: Camera, settings: Settings) -> None:
    """Skip the first frames, and check that the brightness is steady.

    Raises:
        UserError: The brightness changes, because the exposure is automatic or the light is cold.
    """
    for _ in range(settings.camera.warmup_frames):
        camera.now()
    means = []
    for _ in range(2):
        frames = camera.fresh(time.monotonic_ns(), 10)
        means.append(sum(float(frame.image.mean()) for frame in frames) / len(frames))
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
    dataset = open_dataset(folder, repair=False)
    return dataset.header.status == "closed" and list(dataset.plan()) == plan.rows()


def _header(
    settings: Settings, plan: CollectionPlan, camera: Camera, folder: Path, *, emulated: bool
) -> Header:
    """Return the header of a collection.

    To go on with a data set, the camera must be the same, and so must the configuration except for
    the keys that change neither labels nor frames.
    """
    height, width = camera.now().image.shape
    configuration = settings.record()
    if is_dataset(folder):
        begun = open_dataset(folder, repair=False).header.sensor.get("configuration", {})
        configuration = settings.record_for(begun)
    actual = camera.read_back
    assert actual is not None, "the camera is open"  # noqa: S101
    text = json.dumps(configuration, sort_keys=True)
    return Header(
        name="tactip",
        sensor={
            "name": settings.sensor.name,
            **({"origin": "simulated"} if emulated else {}),
            "plugin": f"tactibench_tactip {__version__}",
            "configuration": configuration,
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
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


def _check_same_sensor(rest: Reference, folder: Path) -> None:
    """Raise UserError where the undeformed sensor differs from the rest image of the data set."""
    before: Image | None = open_dataset(folder, repair=False).rest_image
    if before is None:
        return
    difference = float(abs(rest.mean - before).mean())
    if difference > ALIKE_LEVELS:
        raise UserError(
            f"the undeformed sensor differs by {difference:.1f} grey levels from the one that "
            f"{folder} was begun with ({ALIKE_LEVELS:g} are allowed); put camera, light and sensor "
            "back as they were, or begin another data set."
        )


def _write_splits(writer: Writer, plan: CollectionPlan) -> None:
    """Write the protocol's splits of the samples that may be used, unless a subset is empty."""
    good = {sample.id for sample in writer.samples if sample.status == "ok"}
    for name, parts in plan.splits.items():
        usable = {part: [i for i in ids if i in good] for part, ids in parts.items()}
        if all(usable.values()):
            writer.split(name, **usable)
