"""Scenes into arrays of tips on a flat pad, and the scenes that are no press of one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench import Scene, UserError
from tactibench_sim.contact import Tips

Array = npt.NDArray[np.float64]
DEEPEST_MM = 100.0
"""A greater depth is a mistake in units; the tables refuse smaller ones that are too deep."""


def pad_tips(scenes: Sequence[Scene], reach: float) -> Tips:
    """The tips of scenes: depth (S, K) is travel past the own first touch, -inf where is none.

    reach: how far from the middle a tip may press, mm. Raises UserError for what is no such press.
    """
    most = max(len(scene.indenter.offsets) for scene in scenes)
    offsets = np.zeros((len(scenes), most, 3))
    offsets[:, :, 2] = -np.inf
    pose = np.empty((len(scenes), 4))
    radius = np.empty(len(scenes))
    known: dict[int, Array] = {}
    for row, scene in enumerate(scenes):
        _check(scene)
        p, indenter = scene.pose, scene.indenter
        pose[row] = p.x, p.y, math.radians(p.yaw), p.depth
        radius[row] = indenter.radius
        if id(indenter) not in known:
            known[id(indenter)] = np.array(indenter.offsets, dtype=np.float64)
        offsets[row, : len(indenter.offsets)] = known[id(indenter)]
    x, y, yaw, depth = (column[:, None] for column in pose.T)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    dx, dy, high = np.moveaxis(offsets, -1, 0)
    xy = np.stack([x + cosine * dx - sine * dy, y + sine * dx + cosine * dy], axis=-1)
    tips = Tips(xy, depth - (high.max(axis=1, keepdims=True) - high), radius)
    _check_reach(tips, reach)
    return tips


def _check(scene: Scene) -> None:
    pose = scene.pose
    for name in ("x", "y", "yaw", "tilt", "depth"):
        value = getattr(pose, name)
        if not math.isfinite(value):
            raise UserError(f"the pose's {name} is {value}; a scene's pose must be finite.")
    if scene.indenter.is_plate:
        raise UserError(
            "a plate would touch all of the flat pad at once, which the planar sensor does not "
            "simulate; press spherical tips or take a sensor with a dome."
        )
    if pose.tilt != 0:
        raise UserError(
            f"the pose's tilt is {pose.tilt:g} deg; spherical tips on the pad need tilt 0."
        )
    if pose.depth < 0:
        raise UserError(f"the pose's depth is {pose.depth:g} mm; it must be 0 or more.")
    if pose.depth > DEEPEST_MM:
        raise UserError(f"the pose's depth is {pose.depth:g} mm; no pad is that thick.")


def _check_reach(tips: Tips, reach: float) -> None:
    far = (tips.depth > 0) & (abs(tips.xy).max(axis=-1) > reach)
    if far.any():
        x, y = tips.xy[far][0]
        raise UserError(
            f"a tip presses the pad at x {x:.2f} mm, y {y:.2f} mm; the simulator knows it within "
            f"{reach:g} mm of its middle, beyond which its edge matters: press nearer to it."
        )
