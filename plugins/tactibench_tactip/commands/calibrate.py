"""``tactibench hw calibrate``: the sensor's place, and how long a press settles.

A tip whose axis passes the dome's at distance rho touches sqrt((R_d + R)^2 - rho^2) above its
centre, so heights of first touch at known places w_i of the work frame fit

    z_i = z_0 + (R_d + R) - sqrt((R_d + R)^2 - |w_i - w_0|^2)

with the centre w_0 and the height z_0 unknown. In the image a press shows at m_i, the middle of the
squared change, against the middle of all presses: m_i = (s + k |u_i|^2) R(yaw) F u_i + c, where
u_i = w_i - w_0, F turns y about (the sensor's z looks against the work frame's), s and k are the
camera's scale and its first distortion, c what is left of the centre.

Skin and gel creep after a press: at last one press is held, and the time is told after which its
image changes no more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import click
import numpy as np
from scipy.optimize import least_squares

from tactibench import Pose, Scene, UserError
from tactibench_tactip.camera import CameraFrame, Image
from tactibench_tactip.commands.output import (
    device_options,
    number_option,
    open_devices,
    progress_bar,
)
from tactibench_tactip.geometry import Array
from tactibench_tactip.robots import make_robot
from tactibench_tactip.simulation import OFFSET, SimulatedRobot
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch

HOLD_S = 3.0
"""Time for which the last press is held: what creeps longer, creeps for minutes."""
MEAN_OF = 5
"""Frames of the held press that are averaged against noise."""


@click.command("calibrate")
@device_options
@number_option("--radius", click.FloatRange(1, 8), 4.0, "Radius of the circle of presses, mm.")
@number_option("--depth", click.FloatRange(0.5, 5), 2.0, "Depth of the presses, mm.")
@number_option("--points", click.IntRange(4, 24), 8, "Presses on the circle.")
def calibrate(radius: float, depth: float, points: int, **device: Any) -> None:
    """Find where the sensor sits, from presses of one tip: centre, yaw of the image, height.

    First touch is found at every place: the heights lie on the dome, whose top is the centre. The
    place of every press in the image, against where the tool was, gives the yaw. Prints the line
    for [frames]. At last a press is held: timing.settle_s is well chosen when its image no longer
    changes after it.
    """
    with open_devices(**device) as settings:
        if settings.indenter.kind != "single":
            raise UserError(
                'a calibration needs one tip; mount it and say indenter.kind = "single".'
            )
        robot = make_robot(settings)
        if isinstance(robot, SimulatedRobot):
            robot.misplace()
        with Station(settings, robot) as station, progress_bar("press", points + 2) as advance:
            result = measure_place(station, radius, depth, points, advance)
            settled_s = measure_settling(station, depth, HOLD_S)
            advance(1)
    click.echo(station.place, err=True)
    x, y, yaw = result.sensor
    click.echo(f"sensor = [{x:.3f}, {y:.3f}, {yaw:.2f}]    # in [frames]")
    click.echo(
        f"one sigma {result.centre_std_mm:.3f} mm and {result.yaw_std_deg:.2f} deg from "
        f"{points + 1} presses; heights lie {result.height_rms_mm:.3f} mm from the dome; first "
        f"touch at z {result.z0_mm:+.3f} mm of the work frame"
    )
    click.echo(
        f"the image of a press changes no more after {settled_s:.2f} s; timing.settle_s is "
        f"{settings.timing.settle_s:g}"
    )
    if settings.simulated:
        click.echo(
            f"simulated: the sensor sits at {OFFSET[0]}, {OFFSET[1]} mm and {OFFSET[2]:g} deg from "
            "[frames], and its skin does not creep"
        )


@dataclass(frozen=True)
class Calibration:
    """The place of the sensor.

    Attributes:
        sensor: x, y mm and yaw deg for [frames].
        z0_mm: First touch over the apex.
        centre_std_mm: One sigma of the centre.
        yaw_std_deg: One sigma of the yaw.
        height_rms_mm: Distance of first touches from the dome, rms.
    """

    sensor: tuple[float, float, float]
    z0_mm: float
    centre_std_mm: float
    yaw_std_deg: float
    height_rms_mm: float


def measure_place(
    station: Station, radius: float, depth: float, points: int, advance: Callable[[int], None]
) -> Calibration:
    """Find first touch and press at the middle and on a circle, and return the sensor's place.

    Args:
        station: An open station with one tip mounted.
        radius: Radius of the circle, mm.
        depth: Depth of the presses, mm.
        points: Number of presses on the circle.
        advance: Called with 1 after every press.

    Raises:
        UserError: A search or a press failed, or may not be made.
    """
    indenter = station.indenter
    angles = [2.0 * math.pi * k / points for k in range(points)]
    spots = [(0.0, 0.0), *((radius * math.cos(t), radius * math.sin(t)) for t in angles)]
    deep = [Scene(indenter, Pose(x, y, depth=depth)) for x, y in spots]
    station.check_scenes("the calibration", deep)
    places, heights, seen = [], [], []
    for scene in deep:
        place = replace(scene, pose=replace(scene.pose, depth=0.0))
        find_touch(station, place)
        tool = station.geometry.tool_pose(place)
        places.append(tool[:2])
        heights.append(tool[2])
        result = station.press_well(scene)
        seen.append(middle_of(result.check.image, station.rest_reference().mean))
        advance(1)
    reach = station.settings.sensor.dome_radius_mm + indenter.radius
    centre, z0, std, rms = fit_centre(np.array(places), np.array(heights), reach)
    yaw, yaw_std = fit_yaw(np.array(places) - centre, np.array(seen))
    return Calibration((float(centre[0]), float(centre[1]), yaw), z0, std, yaw_std, rms)


def middle_of(image: Image, rest: Array) -> tuple[float, float]:
    """Return column and row of the middle of the squared change, px.

    Args:
        image: (H, W) image of a press.
        rest: (H, W) image of the undeformed sensor.
    """
    energy = np.square(image - rest)
    energy = np.maximum(0.0, energy - np.percentile(energy, 75))  # noise is everywhere
    rows, columns = np.indices(energy.shape)
    total = float(energy.sum())
    return float((energy * columns).sum() / total), float((energy * rows).sum() / total)


def fit_centre(places: Array, heights: Array, reach: float) -> tuple[Array, float, float, float]:
    """Return the centre (2,), z_0, one sigma of the centre and rms of the heights, mm.

    Args:
        places: (N, 2) places w_i of first touch, mm.
        heights: (N,) heights z_i of first touch, mm.
        reach: R_d + R, mm.
    """

    def misfit(p: Array) -> Array:
        square = np.maximum(1e-9, reach**2 - ((places - p[:2]) ** 2).sum(axis=1))
        return np.asarray(p[2] + reach - np.sqrt(square) - heights)

    start = np.array([*places.mean(axis=0), heights.min()])
    fit = least_squares(misfit, start)
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    spread = np.linalg.pinv(fit.jac.T @ fit.jac) * (fit.fun**2).sum()
    spread = spread / max(1, len(heights) - 3)
    return fit.x[:2], float(fit.x[2]), float(np.sqrt(np.diag(spread)[:2].mean())), rms


def fit_yaw(from_centre: Array, seen: Array) -> tuple[float, float]:
    """Return the yaw of the image's x axis in the work frame and its one sigma, deg.

    Args:
        from_centre: (N, 2) places u_i of presses, mm.
        seen: (N, 2) places m_i of presses in the image, px.
    """
    flipped = from_centre * [1.0, -1.0]
    square = (flipped**2).sum(axis=1, keepdims=True)

    def misfit(p: Array) -> Array:
        angle, scale, cubic, cx, cy = p
        c, s = math.cos(angle), math.sin(angle)
        turned = flipped @ np.array([[c, s], [-s, c]])
        return np.asarray(((scale + cubic * square) * turned + [cx, cy] - seen).ravel())

    best = None
    for start in np.arange(0.0, 2.0 * math.pi, math.pi / 4):
        first = np.array([start, 3.0, 0.0, *seen.mean(axis=0)])
        fit = least_squares(misfit, first)
        middle = fit.x[1] + fit.x[2] * float(square.mean())  # scale where the presses are
        if middle > 0 and (best is None or fit.cost < best.cost):
            best = fit
    assert best is not None, "one of eight starts has a positive scale"  # noqa: S101
    spread = np.linalg.pinv(best.jac.T @ best.jac) * 2.0 * best.cost / max(1, len(seen) * 2 - 5)
    yaw = math.degrees(float(best.x[0]))
    return (yaw + 180.0) % 360.0 - 180.0, math.degrees(float(np.sqrt(spread[0, 0])))


def measure_settling(station: Station, depth: float, seconds: float) -> float:
    """Press at the apex, hold the press, and return the time after which it changes no more, s.

    That is when running means of its frames stay within twice their noise of the last one.

    Args:
        station: An open station that found first touch.
        depth: Depth of the press, mm.
        seconds: Time for which it is held.

    Raises:
        RobotError: A move failed.
        CameraError: The camera gives no frames.
        StopNowError: Somebody asked to stop.
        UserError: The press is too deep for the sensor.
    """
    scene = Scene(station.indenter, Pose(depth=depth))
    path, rest = station.path(scene), station.rest_reference()
    frames: list[CameraFrame] = []
    with station.at(scene):
        since_ns = began_ns = station.do(lambda m: station.down(m, path)).ended_ns
        while len(frames) <= MEAN_OF or time.monotonic_ns() < began_ns + 1e9 * seconds:
            frames += station.camera.fresh(since_ns)
            since_ns = frames[-1].t_ns + 1
            station.do(lambda m: m.check())
    images = [frame.image for frame in frames]
    last = np.mean(images[-MEAN_OF:], axis=0)
    starts = range(len(images) - MEAN_OF + 1)
    change = [np.abs(np.mean(images[k : k + MEAN_OF], axis=0) - last).mean() for k in starts]
    # Means of n frames each differ by sqrt(2 / n) of the deviation; two frames by sqrt(2) of it.
    loud = np.flatnonzero(np.array(change) > 2.0 * rest.between / MEAN_OF**0.5)
    first = min(int(loud[-1]) + 1, len(change) - 1) if len(loud) else 0
    return max(0.0, (frames[first].t_ns - began_ns) * 1e-9)
