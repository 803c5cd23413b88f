"""Scenes of hard cases: one value of a family changes the scene, everything else stays the same.

All cases of a family draw press k from the same random numbers, so that a case differs from the
easy one in its value alone wherever the workspace allows it, and errors can be paired press by
press.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from tactibench.contacts import FloatArray, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.protocols import PATIENCE, Family, Workspace

Tips = tuple[FloatArray, FloatArray]
"""(K, 2) axes and (K,) depths of the tips, mm."""
Candidate = Callable[[Family, float, Workspace, np.random.Generator], Tips]


def case_scene(
    family: Family, value: float, workspace: Workspace, seed: np.random.SeedSequence
) -> Scene:
    """Return one press of a case.

    Args:
        family: Family of the case.
        value: Value of the case, graded from easy to hard.
        workspace: Workspace in which the tips lie.
        seed: Seed of the press, the same for every value of the family.

    Raises:
        UserError: The workspace leaves (almost) no room for the press.
    """
    rng = np.random.default_rng(seed)
    kind = str(family.press)
    radius = value if kind == "tip-radius" else family.radius_mm or math.nan
    for _ in range(PATIENCE):
        xy, depth = CANDIDATES[kind](family, value, workspace, rng)
        inside = kind == "off-axis" or float(np.abs(xy).max()) <= workspace.half_width_mm + 1e-9
        inside &= float(np.hypot(*xy.T).max()) < workspace.dome_radius_mm + radius
        if inside and (kind != "distance" or float(depth.min()) >= workspace.depth_min_mm):
            scene = scene_of_depths(xy, depth, radius, workspace.dome_radius_mm, kind)
            return _moved(scene, value, rng) if kind == "sheared" else scene
    raise UserError(
        f"family {family.name!r}: none of {PATIENCE:,} candidates of {value:g} fitted the "
        "workspace; make the workspace larger or the indenter smaller."
    )


def scene_of_depths(
    xy: FloatArray, depth: FloatArray, radius: float, dome_radius: float, name: str
) -> Scene:
    """Return the scene in which all tips reach the given depths at once.

    A tip at distance rho from the axis first touches at sqrt((R_d + R)^2 - rho^2) (on a flat pad at
    0), so it is made longer by depth_k minus that, up to a constant that all tips share.

    Args:
        xy: (K, 2) axis of every tip, mm.
        depth: (K,) depth of every tip, mm.
        radius: Radius R of the tips, mm.
        dome_radius: Radius R_d of the dome, mm; inf: a flat pad.
        name: Name of the indenter.
    """
    longer = depth - _first_touch(xy, dome_radius + radius)
    middle = xy.mean(axis=0)
    offsets = np.column_stack([xy - middle, longer - longer.max()])
    tips = tuple((float(x), float(y), float(z)) for x, y, z in offsets)
    x, y = (float(value) for value in middle)
    return Scene(Indenter(radius, tips, name), Pose(x, y, depth=float(depth.max())))


def _moved(scene: Scene, way: float, rng: np.random.Generator) -> Scene:
    """Return the scene reached by moving ``way`` mm sideways, in a direction that is drawn."""
    turn = rng.uniform(0, 2 * math.pi)
    pose = replace(scene.pose, dx=way * math.cos(turn), dy=way * math.sin(turn))
    return replace(scene, pose=pose)


def _first_touch(xy: FloatArray, reach: float) -> FloatArray:
    """Return the (K,) height at which each tip of equal length first touches, mm.

    It is 0 beside the dome.

    Args:
        xy: (K, 2) axis of every tip, mm.
        reach: Sum of the radii of dome and tip, mm; inf: a flat pad.
    """
    if math.isinf(reach):
        return np.zeros(len(xy))
    height: FloatArray = np.sqrt(np.maximum(reach**2 - (xy**2).sum(axis=1), 0.0))
    return height


def _anywhere(space: Workspace, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(-space.half_width_mm, space.half_width_mm, 2)


def _depth(family: Family, rng: np.random.Generator) -> float:
    low, high = family.depth_mm or (math.nan, math.nan)
    return float(rng.uniform(low, high))


def _pair(middle: FloatArray, apart: float, turn: float) -> FloatArray:
    half = apart / 2 * np.array([math.cos(turn), math.sin(turn)])
    return np.stack([middle - half, middle + half])


def _nothing(_: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return a tip that touches the skin and does not press it."""
    return _anywhere(space, rng)[None], np.zeros(1)


def _single(_: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip, as `exp1` presses: place and depth uniform over the workspace."""
    xy = _anywhere(space, rng)[None]
    return xy, rng.uniform(space.depth_min_mm, space.depth_max_mm, 1)


def _at_depth(_: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip of depth ``value``, mm."""
    return _anywhere(space, rng)[None], np.array([value])


def _between(family: Family, _value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip of a depth in a range; the value is its radius or its way sideways, mm."""
    return _anywhere(space, rng)[None], np.array([_depth(family, rng)])


def _off_axis(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return one tip whose axis is ``value`` times the dome's radius away from the dome's axis."""
    turn = rng.uniform(0, 2 * math.pi)
    away = value * space.dome_radius_mm * np.array([[math.cos(turn), math.sin(turn)]])
    return away, np.array([_depth(family, rng)])


def _distance(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal height, as `exp2` presses, at distance ``value``, mm."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, math.pi)
    deepest = rng.uniform(space.depth_min_mm, space.depth_max_mm)
    xy = _pair(middle, value, turn)
    radius = space.dome_radius_mm + (family.radius_mm or math.nan)
    touch = _first_touch(xy, radius)
    return xy, deepest - (touch.max() - touch)


def _equal(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal depth at distance ``value``, mm."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, math.pi)
    return _pair(middle, value, turn), np.full(2, _depth(family, rng))


def _symmetric(family: Family, value: float, _: Workspace, rng: np.random.Generator) -> Tips:
    """Return two tips of equal depth around the apex at distance ``value``, mm.

    They lie along a row, a column or a diagonal of the image.
    """
    turn = float(rng.integers(4)) * math.pi / 4
    return _pair(np.zeros(2), value, turn), np.full(2, _depth(family, rng))


def _beside(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return a deep tip and another one, whose depth is ``value`` times that of the first."""
    middle, turn = _anywhere(space, rng), rng.uniform(0, 2 * math.pi)
    return _pair(middle, family.apart_mm or math.nan, turn), _depth(family, rng) * np.array(
        [1.0, value]
    )


def _ring(family: Family, value: float, space: Workspace, rng: np.random.Generator) -> Tips:
    """Return ``value`` tips at equal steps of a circle, each of its own depth."""
    count, ring = round(value), family.ring_mm or math.nan
    room = max(space.half_width_mm - ring, 0.0)
    middle, turn = rng.uniform(-room, room, 2), rng.uniform(0, 2 * math.pi)
    turns = turn + 2 * math.pi * np.arange(count) / count
    depth = np.array([_depth(family, rng) for _ in range(count)])
    return middle + ring * np.column_stack([np.cos(turns), np.sin(turns)]), depth


CANDIDATES: Mapping[str, Candidate] = {
    "nothing": _nothing,
    "anywhere": _single,
    "depth": _at_depth,
    "tip-radius": _between,
    "sheared": _between,
    "off-axis": _off_axis,
    "distance": _distance,
    "equal-depths": _equal,
    "symmetric": _symmetric,
    "beside": _beside,
    "ring": _ring,
}
"""Kind of press in a protocol -> function that draws the tips of a candidate."""
