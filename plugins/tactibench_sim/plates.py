"""Plate presses: tables of a dome under a plate, and the pins' displacements in the frame.

The tables hold the response of the dome to a plate that is pressed on it, and to one that drags its
skin sideways. Camera, lever, drag and slip are numbers that were fitted to recorded presses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import files

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim.camera import Optics
from tactibench_sim.compiled import jit
from tactibench_sim.renderer import project
from tactibench_sim.tables import shipped_file

Array = npt.NDArray[np.float64]
FILE = "plates.npz"
FINE_DEG = 0.25
"""Step of the polar angle of the refined tables, fine enough for linear look-ups."""
INNER_MM = 19.0
"""Radius of the inner skin, on which the pins stand."""
APEX_MM = 20.0
"""Radius of the outer skin."""
_STEEPEST = math.radians(88.0)
"""Polar angle, rad, up to which pins are looked for, just short of the clamped rim."""
_ABOVE_WINDOW_MM = 1e-3
"""Height above the window at which a tip is seen that would lie below it."""


@dataclass(frozen=True)
class Unknowns:
    """The fitted numbers, all of them global: none belongs to a single press.

    The fit begins at the defaults. With t the tilt label,

        travel = depth label + depth_offset_mm + pivot_mm (1 - cos t) + pivot_side_mm sin t,
        d = travel (1 - give_per_mm travel),

    where d is the indentation, mm: what holds the dome gives way. The plate's normal leaves the
    axis by t + tilt_offset_deg, in the plane at yaw_deg to the frame's x axis. The plate drags the
    skin, mm relative to the dome, in every press by

        drag_offset_mm + drag_per_depth d + drag_per_tilt d sin t,

    and in a press that was dragged also by drag_per_mm move + drag_per_deg turn, but at most by
    slip_mm d**slip_power, beyond which the plate slips.

    Attributes:
        depth_offset_mm: Travel at a depth label and a tilt of 0.
        pivot_mm: Height above the dome's centre of the point about which the robot turns the
            sensor (20: the apex).
        pivot_side_mm: Distance of that point from the dome's axis.
        tilt_offset_deg: Tilt of the plate at a tilt label of 0.
        yaw_deg: Direction on the frame in which the plate tilts.
        pin_length_mm: Effective lever; pins dragged along by the gel turn less than their base.
        air_mm: Distance from the camera to the window.
        gel_mm: Distance from the window to the apex (refraction at an index of 1.41; the window's
            thickness counts as gel).
        focal_px: Focal length.
        centre_x: Place of the optical axis in the frame, px.
        centre_y: Likewise.
        drag_per_mm: Drag per mm that the robot moved along the plate (label ``move``).
        drag_per_deg: Drag, mm, per deg that the robot turned (label ``turn``).
        drag_offset_mm: Drag of every press.
        drag_per_depth: Drag per mm of indentation.
        drag_per_tilt: Drag per mm of indentation and sine of the tilt.
        slip_mm: Drag at which the plate slips, at an indentation of 1 mm.
        slip_power: Exponent with which that drag grows with the indentation.
        give_per_mm: Share of the travel by which the dome gives way, per mm of travel.
        rest_x: Drift of all pins since the rest frame was taken, px.
        rest_y: Likewise.
    """

    depth_offset_mm: float = 5.0
    pivot_mm: float = 20.0
    pivot_side_mm: float = 0.0
    tilt_offset_deg: float = 0.0
    yaw_deg: float = 90.0
    pin_length_mm: float = 0.5
    air_mm: float = 2.0
    gel_mm: float = 24.0
    focal_px: float = 110.0
    centre_x: float = 0.0
    centre_y: float = 0.0
    drag_per_mm: float = -0.5
    drag_per_deg: float = 0.0
    drag_offset_mm: float = 0.0
    drag_per_depth: float = 0.0
    drag_per_tilt: float = 0.0
    slip_mm: float = 0.35
    slip_power: float = 1.0
    give_per_mm: float = 0.03
    rest_x: float = 0.0
    rest_y: float = 0.0

    def optics(self, side: int) -> Optics:
        """Return the camera, whose frames have ``side`` px.

        Raises:
            UserError: The unknowns fit no camera (``Optics``).
        """
        middle = (side - 1) / 2
        return Optics(
            size=side,
            camera_distance_mm=self.air_mm + self.gel_mm,
            lens="fisheye",
            focal=self.focal_px / side,
            principal_x=(self.centre_x - middle) / side,
            principal_y=(self.centre_y - middle) / side,
            gel_mm=self.gel_mm,
            window_mm=0.0,
        )


@dataclass(frozen=True)
class LabelFit:
    """Numbers of `tactibench data fit` on the fitted recording, which define all true indentations.

    ``depth_offset_mm``, ``pivot_mm`` and ``pivot_side_mm`` of ``Unknowns`` say where simulated
    fields meet the real ones best. Sensors and recordings state indentation as this fit does, so a
    fitted sensor is pressed deeper by the difference.

    Attributes:
        depth_offset_mm: As in ``Unknowns``.
        pivot_mm: As in ``Unknowns``.
        pivot_side_mm: As in ``Unknowns``.
    """

    depth_offset_mm: float
    pivot_mm: float
    pivot_side_mm: float


@dataclass(frozen=True, eq=False)
class Plate:
    """The tables of one dome.

    Attributes:
        deepest: Greatest tabulated depth, mm.
        polar_step: Step of the polar angle, rad.
        press: Depth, mm -> (T, 3) displacement w inward and t away from the contact, mm, and turn
            omega of the inner normal, rad.
        drag: Patch radius, rad -> (T, 5) displacement inward, away and around, mm, and two turns,
            rad, per mm of drag.
        patches: Nodes of the patch radius in ``drag``, rad.
        delta: (D,) nodes of the depth, mm.
        patch: (D,) angular radius of the part that touches at each depth, rad.
    """

    deepest: float
    polar_step: float
    press: CubicSpline
    drag: CubicSpline
    patches: Array
    delta: Array
    patch: Array

    def meridians(self, depth: Array) -> Array:
        """Return (S, T, 8): the columns of ``press`` and ``drag`` at S depths, mm."""
        radius = np.interp(depth, self.delta, self.patch).clip(self.patches[0], self.patches[-1])
        return np.concatenate([self.press(depth), self.drag(radius)], axis=-1)


@cache
def plate_of(kind: str) -> Plate:
    """Return the tables of one dome, refined in the polar angle.

    Raises:
        UserError: There are no tables of such a dome.
    """
    content = shipped_file(FILE).arrays
    if f"{kind}_press" not in content:
        kinds = ", ".join(n.removesuffix("_press") for n in content if n.endswith("_press"))
        raise UserError(f"the calibration is of a dome {kind!r}, but there are tables of {kinds}.")
    delta, polar, patches = content["delta"], content["polar"], content["patches"]
    fine = np.radians(np.arange(round(90 / FINE_DEG) + 1) * FINE_DEG)
    press = CubicSpline(polar, content[f"{kind}_press"], axis=1)(fine)
    drag = CubicSpline(polar, content[f"{kind}_drag"], axis=1)(fine)
    return Plate(
        deepest=float(delta[-1]),
        polar_step=float(fine[1]),
        press=CubicSpline(delta, press, axis=0),
        drag=CubicSpline(patches, drag, axis=0),
        patches=patches,
        delta=delta,
        patch=content[f"{kind}_patch"],
    )


@cache
def plates_digest() -> str:
    """Return the hash of the shipped tables' file."""
    return sha256((files(__package__) / "data" / FILE).read_bytes()).hexdigest()


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of S presses by the robot.

    Attributes:
        depth: (S,) mm.
        tilt: (S,) deg.
        move: (S,) ways along the plate, mm.
        turn: (S,) turns, deg.
    """

    depth: Array
    tilt: Array
    move: Array
    turn: Array

    def __len__(self) -> int:
        return len(self.depth)

    def take(self, rows: npt.NDArray[np.intp]) -> Labels:
        """Return the labels of some presses."""
        return Labels(self.depth[rows], self.tilt[rows], self.move[rows], self.turn[rows])


@dataclass(frozen=True, eq=False)
class Rig:
    """The parts of the simulation that are not fitted.

    Attributes:
        plate: The tables of a dome.
        rest: (P, 2) places of the pins at rest, px.
        side: Side of the frames, px.
    """

    plate: Plate
    rest: Array
    side: int


def indentation(x: Unknowns, labels: Labels) -> Array:
    """Return the (S,) depth of the plate in the undeformed dome, mm; below 0: no touch.

    What holds the dome gives way under the force, which grows a little faster than the depth.
    """
    t = np.radians(labels.tilt)
    lifted = x.pivot_mm * (1 - np.cos(t)) + x.pivot_side_mm * np.sin(t)
    way = labels.depth + x.depth_offset_mm + lifted
    return np.asarray(way - x.give_per_mm * way.clip(0.0) ** 2, dtype=np.float64)


def drag_mm(x: Unknowns, labels: Labels, depth: Array, dragged: Array) -> Array:
    """Return the (S,) ways by which the plate pulled the skin, mm.

    The skin follows a plate up to a limit that grows with the load, as Coulomb's friction does, and
    beyond it the plate slips.

    Args:
        x: The unknowns.
        labels: Labels of S presses.
        depth: (S,) indentations, mm.
        dragged: (S,) 1 for presses that were dragged, 0 for others.
    """
    limit = x.slip_mm * depth**x.slip_power
    moved = (x.drag_per_mm * labels.move + x.drag_per_deg * labels.turn).clip(-limit, limit)
    always = x.drag_offset_mm + x.drag_per_depth * depth
    always = always + x.drag_per_tilt * depth * np.sin(np.radians(labels.tilt))
    return np.asarray(dragged * moved + always, dtype=np.float64)


def directions(rig: Rig, x: Unknowns) -> Array:
    """Return the (P, 3) unit vectors of the pins that the camera sees at their rest places."""
    polar = np.linspace(0.0, _STEEPEST, 700)
    tip = INNER_MM - x.pin_length_mm
    line = np.stack([tip * np.sin(polar), 0 * polar, tip * np.cos(polar)], axis=-1)
    radius = _seen(rig, x, line)[:, 0] - x.centre_x
    away = rig.rest - [x.centre_x, x.centre_y]
    last = int(np.argmax(radius)) + 1
    angle = np.interp(np.hypot(*away.T), radius[:last], polar[:last])
    azimuth = np.arctan2(away[:, 1], away[:, 0])
    sine = np.sin(angle)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(angle)], axis=1)


def changes(rig: Rig, x: Unknowns, labels: Labels, dragged: Array) -> Array:
    """Return (S, P, 3): displacements of the pins in the frame, px, and the factor on their size.

    A pressed pin is nearer to the camera, which magnifies it more. Presses deeper than the tables
    get the greatest tabulated depth.

    Args:
        rig: The parts that are not fitted.
        x: The unknowns.
        labels: Labels of S presses.
        dragged: (S,) 1 for presses that were dragged, 0 for others.

    Raises:
        UserError: The unknowns fit no camera (``Optics``).
    """
    depth = indentation(x, labels).clip(0.0, rig.plate.deepest)
    yaw, tilt = math.radians(x.yaw_deg), np.radians(labels.tilt + x.tilt_offset_deg)
    across = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    axis = np.array([0.0, 0.0, 1.0])
    normal = np.sin(tilt)[:, None] * across + np.cos(tilt)[:, None] * axis
    along = np.cos(tilt)[:, None] * across - np.sin(tilt)[:, None] * axis
    pins = directions(rig, x)
    pull = drag_mm(x, labels, depth, dragged)
    tips = _tips(
        pins, normal, along, pull, rig.plate.meridians(depth), rig.plate.polar_step, x.pin_length_mm
    )
    rest = (INNER_MM - x.pin_length_mm) * pins
    seen, before = _seen(rig, x, tips), _seen(rig, x, rest)
    out = seen - before + [x.rest_x, x.rest_y, 0.0]
    out[..., 2] = seen[..., 2] / before[..., 2]
    return out


def _seen(rig: Rig, x: Unknowns, tips: Array) -> Array:
    """Return the (..., 3) place and radius in the frame, px, of pin tips at (..., 3) mm.

    A tip below the window is seen on it.
    """
    inside = tips.copy()
    inside[..., 2] = np.maximum(inside[..., 2], APEX_MM - x.gel_mm + _ABOVE_WINDOW_MM)
    seen = project(x.optics(rig.side), inside, x.gel_mm + x.air_mm - APEX_MM)
    return np.stack(seen, axis=-1)


@jit
def _tips(pins, normal, along, pull, meridian, step, length):  # type: ignore[no-untyped-def]
    """Return (S, P, 3) pin tips, mm from the dome's centre.

    At a pin b = cos(th) n + sin(th) h the frame is b, e = (cos(th) h - sin(th) n) away from the
    contact and f = n x h around it; h = cos(phi) a + sin(phi) n x a with the drag along a.
    """
    scenes, count = normal.shape[0], pins.shape[0]
    last = meridian.shape[1] - 1
    out = np.empty((scenes, count, 3))
    at = np.empty(8)
    for s in range(scenes):
        n, a = normal[s], along[s]
        c = np.cross(n, a)
        for p in range(count):
            b = pins[p]
            cosine = min(1.0, max(-1.0, n[0] * b[0] + n[1] * b[1] + n[2] * b[2]))
            sine = math.sqrt(1.0 - cosine * cosine)
            place = math.acos(cosine) / step
            left = int(place)
            if left >= last:  # beyond the clamped rim
                at[:] = 0.0
            else:
                part = place - left
                for k in range(8):
                    at[k] = (1 - part) * meridian[s, left, k] + part * meridian[s, left + 1, k]
            h = a if sine < 1e-9 else (b - cosine * n) / sine
            e, f = cosine * h - sine * n, np.cross(n, h)
            cos_part = pull[s] * (h[0] * a[0] + h[1] * a[1] + h[2] * a[2])
            sin_part = pull[s] * (h[0] * c[0] + h[1] * c[1] + h[2] * c[2])
            w, t, v = at[0] + cos_part * at[3], at[1] + cos_part * at[4], sin_part * at[5]
            turn_e, turn_f = at[2] + cos_part * at[6], sin_part * at[7]
            angle = math.sqrt(turn_e * turn_e + turn_f * turn_f)
            share = 1.0 if angle < 1e-12 else math.sin(angle) / angle
            lever = b * math.cos(angle) + (turn_e * e + turn_f * f) * share
            for k in range(3):
                tip = INNER_MM * b[k] - w * b[k] + t * e[k] + v * f[k] - length * lever[k]
                out[s, p, k] = tip
    return out
