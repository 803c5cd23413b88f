"""Pin displacements in the frame of plate presses, from the tables and the unknowns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from tactibench_sim.lens import project
from tactibench_sim.optics import Optics
from tactibench_sim.real.plates import INNER_MM, Plate
from tactibench_sim.real.unknowns import Unknowns

Array = npt.NDArray[np.float64]
APEX_MM = 20.0
_STEEPEST = math.radians(88.0)
_ABOVE_WINDOW_MM = 1e-3


@dataclass(frozen=True, eq=False)
class Labels:
    """What the robot was told, (S,) each: depth mm, tilt deg, move mm, turn deg."""

    depth: Array
    tilt: Array
    move: Array
    turn: Array

    def __len__(self) -> int:
        return len(self.depth)

    def take(self, rows: npt.NDArray[np.intp]) -> Labels:
        """Labels of some presses."""
        return Labels(self.depth[rows], self.tilt[rows], self.move[rows], self.turn[rows])


@dataclass(frozen=True, eq=False)
class Rig:
    """What is not fitted: tables, rest positions (P, 2) px, frame side px, lens and its index."""

    plate: Plate
    rest: Array
    side: int
    lens: str = "fisheye"
    gel_index: float = 1.41

    def optics(self, x: Unknowns) -> Optics:
        """The camera. Raises UserError for one that cannot be."""
        return x.optics(self.side, self.lens, self.gel_index)


def indentation(x: Unknowns, labels: Labels) -> Array:
    """(S,) depth of the plate in the undeformed dome, mm; below 0 it does not touch."""
    t = np.radians(labels.tilt)
    lifted = x.pivot_mm * (1 - np.cos(t)) + x.pivot_side_mm * np.sin(t)
    return np.asarray(labels.depth + x.depth_offset_mm + lifted, dtype=np.float64)


def drag_mm(x: Unknowns, labels: Labels, depth: Array, dragged: Array) -> Array:
    """(S,) by how much the plate pulled the skin along; dragged: (S,) 1 for presses that were."""
    moved = x.drag_per_mm * labels.move + x.drag_per_deg * labels.turn
    always = x.drag_offset_mm + x.drag_per_depth * depth
    always = always + x.drag_per_tilt * depth * np.sin(np.radians(labels.tilt))
    return np.asarray(dragged * moved + always, dtype=np.float64)


def directions(rig: Rig, x: Unknowns) -> Array:
    """(P, 3) unit vectors of the pins that the camera sees at rest where they were seen."""
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


def displacements(rig: Rig, x: Unknowns, labels: Labels, dragged: Array) -> Array:
    """(S, P, 2) displacements of the pins in the frame, px; dragged: (S,) 1 or 0.

    Presses deeper than the tables are given their last depth. Raises UserError for a camera that
    cannot be.
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
    return _seen(rig, x, tips) - _seen(rig, x, rest)


def _seen(rig: Rig, x: Unknowns, tips: Array) -> Array:
    """(..., 2) px of pin tips (..., 3) mm; what lies below the window is seen on it."""
    inside = tips.copy()
    inside[..., 2] = np.maximum(inside[..., 2], APEX_MM - x.gel_mm + _ABOVE_WINDOW_MM)
    seen = project(rig.optics(x), inside, x.gel_mm + x.air_mm - APEX_MM)
    return np.stack(seen[:2], axis=-1)


@njit(cache=True, nogil=True, error_model="numpy")
def _tips(pins, normal, along, pull, meridian, step, length):  # type: ignore[no-untyped-def]
    """(S, P, 3) pin tips, mm from the dome's centre.

    At a pin b = cos(th) n + sin(th) h the frame is b, e = (cos(th) h - sin(th) n) away from the
    contact and f = n x h round it; h = cos(phi) a + sin(phi) n x a with the drag along a.
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
            one = pull[s] * (h[0] * a[0] + h[1] * a[1] + h[2] * a[2])
            two = pull[s] * (h[0] * c[0] + h[1] * c[1] + h[2] * c[2])
            w, t, v = at[0] + one * at[3], at[1] + one * at[4], two * at[5]
            turn_e, turn_f = at[2] + one * at[6], two * at[7]
            angle = math.sqrt(turn_e * turn_e + turn_f * turn_f)
            share = 1.0 if angle < 1e-12 else math.sin(angle) / angle
            lever = b * math.cos(angle) + (turn_e * e + turn_f * f) * share
            out[s, p] = INNER_MM * b - w * b + t * e + v * f - length * lever
    return out
