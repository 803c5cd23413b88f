"""``tactibench hw settle-test``: the change of a held press's image with time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from tactibench import Pose, Scene
from tactibench_tactip.camera import CameraFrame
from tactibench_tactip.commands.output import (
    device_options,
    json_option,
    number_option,
    open_devices,
    picture_option,
    print_rows,
    write_figures,
)
from tactibench_tactip.errors import CameraError
from tactibench_tactip.poses import Array
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

TIMES_S = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
"""Device seconds after the move at which the change is printed."""
MEAN_OF = 5
"""Frames that are averaged against noise."""
LOOK_S = 0.2
"""Host seconds between two looks at the robot while it holds the press."""
SLOWER = 2.0
"""Factor on the expected time in which a camera must give the frames: a camera that slows down
during the press would otherwise hold it without end."""


@click.command("settle-test")
@device_options
@number_option("--depth", click.FloatRange(0.5, 6.0), 3.0, "Depth of the press, mm.")
@number_option("--seconds", click.FloatRange(0.5, 30), 3.0, "Time for which the press is held.")
@picture_option("Draw the change against time.")
@json_option
def command(
    depth: float, seconds: float, out: Path | None, json_file: Path | None, **device: Any
) -> None:
    """Hold a press and see how long its image still changes.

    Skin and gel creep after a press. timing.settle_s is well chosen when what still changes after
    it is less than the noise of a frame.
    """
    with open_devices(**device) as (settings, emulation):
        station = Station(settings)
        station.check_scenes("the test", [held_press(settings, depth)])
        with station:
            station.look_at_rest()
            find_touch(station, first=True)
            settling = measure_settling(station, depth, seconds)
    times = [t for t in TIMES_S if t <= seconds]
    rows = [(f"{t:.2f}", f"{settling.change_at(t):.3f}") for t in times]
    print_rows(("s after the move", "change to the end, grey levels"), rows)
    click.echo(
        f"the image is still within noise ({settling.noise:.3f}) after {settling.settled_s:.2f} s; "
        f"timing.settle_s is {settings.timing.settle_s:g}"
    )
    if emulation is not None:
        click.echo("emulated: a simulated skin does not creep, the figures show noise alone")
    if out is not None:
        draw_settling(out, settling, depth)
        click.echo(f"picture: {out}")
    figures = [
        ("settled", "all", settling.settled_s, "s"),
        ("noise", "all", settling.noise, "grey levels"),
    ]
    write_figures(json_file, figures)


@dataclass(frozen=True, eq=False)
class Settling:
    """The change of a held press.

    Attributes:
        times: (N,) device seconds after the end of the move.
        change: (N,) mean absolute difference of running means to the last one, grey levels.
        noise: The same difference of two running means at rest, grey levels.
    """

    times: Array
    change: Array
    noise: float

    def change_at(self, seconds: float) -> float:
        """Return the change at the sample nearest to a time, grey levels."""
        return float(self.change[int(np.argmin(np.abs(self.times - seconds)))])

    @property
    def settled_s(self) -> float:
        """Time from which on the change stays below twice the noise."""
        loud = np.flatnonzero(self.change > 2.0 * self.noise)
        if not len(loud):
            return float(self.times[0])
        return float(self.times[min(loud[-1] + 1, len(self.times) - 1)])


def held_press(settings: Settings, depth: float) -> Scene:
    """Return the press that is held: at the apex, ``depth`` mm deep."""
    return Scene(settings.indenter.indenter(), Pose(depth=depth))


def measure_settling(station: Station, depth: float, seconds: float) -> Settling:
    """Press at the apex, hold the press, and return the change of its frames with time.

    Args:
        station: An open station.
        depth: Depth of the press, mm.
        seconds: Device seconds for which it is held.

    Raises:
        RobotError: A move failed.
        CameraError: The camera gives no frames, or too few.
        StopNowError: Somebody asked to stop.
        UserError: The press is too deep for the sensor.
    """
    settings = station.settings
    scene = held_press(settings, depth)
    path = station.path(scene)
    rest = station.rest_reference()
    scale = settings.robot.time_scale
    count = max(3 * MEAN_OF, int(seconds / scale / station.camera.period_s))
    with station.at(scene):
        began = station.do(lambda m: station.down(m, path))
        frames = _frames_of_held(station, began, count)
        station.retract(scene)
    images = [frame.image for frame in frames]
    means = (
        np.mean(images[k : k + MEAN_OF], axis=0, dtype=np.float32)
        for k in range(count - MEAN_OF + 1)
    )
    last = np.mean(images[-MEAN_OF:], axis=0, dtype=np.float32)
    change = np.array([np.abs(mean - last).mean() for mean in means])
    # Means of n frames each differ by sqrt(2 / n) of the deviation; two frames by sqrt(2) of it.
    noise = rest.between / MEAN_OF**0.5
    times = np.array([(frame.t_ns - began) * 1e-9 * scale for frame in frames[: len(change)]])
    return Settling(times, change.astype(np.float64), noise)


def _frames_of_held(station: Station, since_ns: int, count: int) -> list[CameraFrame]:
    """Return ``count`` frames of a press that is held, and check the robot meanwhile.

    Raises:
        CameraError: The camera gives no frames, or is too slow.
        StopNowError: Somebody asked to stop.
        RobotError: The robot is not normal.
    """
    period = station.camera.period_s
    limit = SLOWER * count * period + station.settings.camera.stall_s
    end = time.monotonic() + limit
    frames: list[CameraFrame] = []
    while len(frames) < count:
        batch = min(count - len(frames), max(1, round(LOOK_S / period)))
        frames += station.camera.fresh(since_ns, batch)
        since_ns = frames[-1].t_ns + 1
        station.do(lambda mover: mover.check())
        if time.monotonic() > end and len(frames) < count:
            raise CameraError(
                f"the camera gave {len(frames)} of {count} frames in {limit:.0f} s; look at its "
                "rate (`tactibench hw doctor`), or hold the press for less with --seconds."
            )
    return frames


def draw_settling(path: Path, settling: Settling, depth: float) -> None:
    """Write a PNG of the change against time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(settling.times, settling.change, lw=1)
    axes.axhline(2 * settling.noise, ls="--", lw=0.8, color="0.5", label="twice the noise")
    axes.set(
        xlabel="seconds after the move",
        ylabel="change to the end, grey levels",
        title=f"held at {depth:g} mm",
    )
    axes.legend()
    figure.savefig(path, dpi=120)
