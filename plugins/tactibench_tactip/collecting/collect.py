"""From a configuration and a plan to a data set on the disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tactibench import UserError
from tactibench.datasets import Writer, is_dataset, open_dataset
from tactibench_tactip.camera.driver import Camera
from tactibench_tactip.collecting import plan as plans
from tactibench_tactip.collecting.collector import Collector, Mount, Report
from tactibench_tactip.collecting.header import check_same_sensor, header_of
from tactibench_tactip.collecting.plan import Plan
from tactibench_tactip.collecting.stops import Stops
from tactibench_tactip.failures import RobotLostError, StopNowError
from tactibench_tactip.geometry.press import PressGeometry
from tactibench_tactip.robots.connect import robot_of
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station

RECONNECTS = 2
"""Times that a UR is connected again without a press between; its watchdog has stopped it."""
FLAT = 0.02
"""Share by which the brightness may change from one second to the next."""


def nobody(_indenter: object, _count: int) -> bool:
    """Nobody is there to mount anything."""
    return False


def collect(
    settings: Settings,
    plan: Plan,
    folder: Path,
    *,
    told: Callable[[str], None] = lambda _: None,
    advance: Callable[[int], None] = lambda _: None,
    mount: Mount = nobody,
    entered: Callable[[Station], None] = lambda _: None,
    speed_scale: float = 1.0,
) -> Report:
    """Make the presses of a plan that the folder has not, and close it when it has them all.

    In this order: the plan is checked, the camera opened and its settings compared with those of
    the data set, the robot connected; only then something moves. entered: told of the station.
    speed_scale: of this session's motion; the data set's configuration stays what it is. Raises
    UserError.
    """
    if _complete(folder, plan):
        advance(len(plan))
        return Report()
    robot = robot_of(settings)
    plans.check(plan, settings, _nominal(settings), turns=robot.turns)
    with ExitStack() as stack:
        camera = stack.enter_context(Camera(settings.camera))
        warm_up(camera, settings)
        height, width = camera.now().image.shape
        header = header_of(settings, plan, camera, (height, width))
        writer = stack.enter_context(Writer(folder, header, plan.rows()))
        for sentence in writer.repaired:
            told(f"{folder}: {sentence}")
        advance(len(writer.done))
        if len(writer.done) == len(plan):
            return Report()
        report = Report()
        stops = Stops(told)
        stack.enter_context(stops.installed())
        lost = 0
        while True:
            before = len(writer.done)
            station = Station(settings.slowed(speed_scale), robot, camera)
            stops.stop = station.stop_now
            try:
                with station:
                    entered(station)
                    if writer.done:
                        rest = open_dataset(folder, repair=False).rest
                        check_same_sensor(station.look_at_rest(), rest, str(folder))
                    Collector(
                        station,
                        plan,
                        writer,
                        report=report,
                        told=told,
                        advance=advance,
                        asked_to_end=stops.asked.is_set,
                        mount=mount,
                    ).run()
                break
            except StopNowError:  # before the first press
                report.interrupted, report.left = True, len(plan) - len(writer.done)
                break
            except RobotLostError as error:
                writer.event("lost", reason=str(error))
                lost = lost + 1 if len(writer.done) == before else 1
                if settings.robot.driver != "ur" or lost > RECONNECTS or stops.asked.is_set():
                    raise
                told(f"{error} Connecting again.")
                robot = robot_of(settings)
            except UserError as error:
                writer.event("error", reason=str(error))
                raise
        if not report.left:
            _split(writer, plan)
        return report


def _complete(folder: Path, plan: Plan) -> bool:
    """Whether the folder holds just these presses, closed."""
    if not is_dataset(folder):
        return False
    dataset = open_dataset(folder, repair=False)
    return dataset.header.status == "closed" and list(dataset.plan()) == plan.rows()


def _nominal(settings: Settings) -> PressGeometry:
    return PressGeometry(settings.frames, settings.sensor.dome_radius_mm, settings.contact.fixed_mm)


def warm_up(camera: Camera, settings: Settings) -> None:
    """Let the first frames go by, and see that the brightness stands still.

    Raises UserError for a camera that changes it: its exposure is automatic, or its light is cold.
    """
    for _ in range(settings.camera.warmup_frames):
        camera.now()
    means = []
    for _ in range(2):
        shots = camera.fresh(time.monotonic_ns(), 10)
        means.append(sum(float(shot.image.mean()) for shot in shots) / len(shots))
    change = abs(means[1] - means[0]) / max(1.0, means[0])
    if change > FLAT:
        raise UserError(
            f"the camera's brightness changed by {change:.1%} in a moment ({means[0]:.1f} to "
            f"{means[1]:.1f} grey levels); switch its automatic exposure off (camera.exposure) and "
            "let the light warm up."
        )


def _split(writer: Writer, plan: Plan) -> None:
    """The protocol's splits, of the samples that may be used."""
    good = {sample.id for sample in writer.samples if sample.status == "ok"}
    for name, parts in plan.splits.items():
        kept = {part: [i for i in ids if i in good] for part, ids in parts.items()}
        if all(kept.values()):
            writer.split(name, **kept)
