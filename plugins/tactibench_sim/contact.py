"""Scenes as arrays of tips, by the closed-form geometry of tactibench.geometry, vectorised.

A *tip* here is one spherical tip of one scene, or a plate's contact: n is the direction from the
dome's centre to the tip's centre, delta the penetration along it (mm, negative: a gap).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from tactibench import Scene, UserError
from tactibench.geometry import DOME_RADIUS_MM

Array = npt.NDArray[np.float64]
STEEPEST_DEG = 55.0
"""Polar angle beyond which the clamped rim affects a contact more than the tables include."""
FARTHEST_MM = 100.0
"""A pose farther from the axis, or a longer move, is a mistake in units."""
FARTHEST_TURN_DEG = 180.0
MOST_TIPS = 12
"""Tips of one indenter: the time of a scene grows with their cube, to 0.02 s for 12 with
friction."""
SLACK = 0.01
"""mm and deg that bounds may step beyond a limit to take differences."""


@dataclass(frozen=True, eq=False)
class Tips:
    """S scenes with up to K tips each.

    Attributes:
        xy: (S, K, 2) places, mm, as in tactibench.Contacts.
        depth: (S, K) depths, mm, as in tactibench.Contacts; -inf: no tip, or one beside the dome.
        radius: (S,) radii, mm; inf for a plate.
        move: (S, K, 2) ways that tips moved sideways after they touched, to where they are, mm;
            None: no tip moved.
        friction: (S,) coefficients of friction; None: that of the mechanics.
    """

    xy: Array
    depth: Array
    radius: Array
    move: Array | None = None
    friction: Array | None = None

    def __len__(self) -> int:
        return len(self.radius)

    def take(self, rows: npt.NDArray[np.intp]) -> Tips:
        """Return some of the scenes."""
        move = None if self.move is None else self.move[rows]
        friction = None if self.friction is None else self.friction[rows]
        return Tips(self.xy[rows], self.depth[rows], self.radius[rows], move, friction)

    def directions(self) -> tuple[Array, Array]:
        """Return n (S, K, 3) and delta (S, K); a missing tip gets delta -inf."""
        square = (self.xy**2).sum(axis=-1)
        plate = np.isinf(self.radius)[:, None]
        reach = DOME_RADIUS_MM + np.where(plate, 0.0, self.radius[:, None])
        exists = np.isfinite(self.depth)
        sunk = np.where(exists & ~plate, self.depth, 0.0)
        height = np.sqrt(np.maximum(reach**2 - square, 0.0)) - sunk
        distance = np.sqrt(square + height**2)
        n = np.concatenate([self.xy, height[..., None]], axis=-1) / distance[..., None]
        delta = np.where(plate, self.depth, reach - distance)
        return n, np.where(exists, delta, -np.inf)


def tips_of(scenes: Sequence[Scene]) -> Tips:
    """Return the tips of scenes on the dome.

    Raises:
        UserError: A pose or move is not finite or out of range, the depth is negative or not less
            than the dome's radius, a spherical tip is tilted, or a plate by 90 deg or more; or an
            indenter has more than MOST_TIPS tips.
    """
    offsets, pose, radius = pose_arrays(scenes)
    if offsets.shape[1] > MOST_TIPS:
        raise UserError(
            f"an indenter has {offsets.shape[1]} tips; the simulated dome takes at most "
            f"{MOST_TIPS} at once: press fewer."
        )
    plate = np.isinf(radius)
    check_poses(
        scenes,
        pose,
        (
            abs(pose[:, :2]).max(axis=1) > FARTHEST_MM,
            f"the pose is at x {{x:g}} mm, y {{y:g}} mm; the dome is {DOME_RADIUS_MM:g} mm wide, a "
            f"pose must be within {FARTHEST_MM:g} mm of its axis.",
        ),
        (
            pose[:, 4] >= DOME_RADIUS_MM,
            "the pose's depth is {depth:g} mm; it must be less than the dome's radius, "
            f"{DOME_RADIUS_MM:g} mm.",
        ),
        (plate & (abs(pose[:, 3]) >= 90), "the plate's tilt is {tilt:g} deg; use less than 90."),
        (
            ~plate & (pose[:, 3] != 0),
            "the pose's tilt is {tilt:g} deg; the simulated sensor tilts plates only, spherical "
            "tips need tilt 0.",
        ),
        (
            (abs(pose[:, 5:7]).max(axis=1) > FARTHEST_MM) | (abs(pose[:, 7]) > FARTHEST_TURN_DEG),
            "the pose moved by dx {dx:g} mm, dy {dy:g} mm, dyaw {dyaw:g} deg; a move must be "
            f"within {FARTHEST_MM:g} mm and {FARTHEST_TURN_DEG:g} deg.",
        ),
    )
    x, y, yaw, tilt, depth = pose[:, :5].T
    cosine, sine = np.cos(np.radians(yaw))[:, None], np.sin(np.radians(yaw))[:, None]
    away = np.where(plate, DOME_RADIUS_MM * np.sin(np.radians(tilt)), 0.0)[:, None]
    dx, dy = offsets[..., 0] + away, offsets[..., 1]
    xy = np.stack([cosine * dx - sine * dy, sine * dx + cosine * dy], axis=-1)
    axis = np.where(plate, 0.0, [x, y]).T[:, None, :]  # a plate's way begins at the dome's axis
    xy += axis
    reach = DOME_RADIUS_MM + np.where(plate, 0.0, radius)[:, None]
    square = reach**2 - (xy**2).sum(axis=-1)
    exists = (square > 0) & np.isfinite(offsets[..., 2])
    touch = np.where(plate[:, None], 0.0, np.sqrt(np.maximum(square, 0.0)) + offsets[..., 2])
    touch = np.where(exists, touch, -np.inf)
    first = touch.max(axis=1, keepdims=True)
    behind = np.where(np.isfinite(first), first, 0.0) - touch
    return Tips(xy, depth[:, None] - behind, radius, _moves(pose[:, 5:], xy, axis))


def _moves(move: Array, xy: Array, axis: Array) -> Array | None:
    """Return the (S, K, 2) ways that tips at xy moved sideways, mm; None where no pose moved.

    In a pose that turned by w about its axis, a tip at r from the axis came from R(-w) r.
    """
    if not move.any():
        return None
    dx, dy, turn = move.T
    arm = xy - axis
    cosine, sine = np.cos(np.radians(turn))[:, None], np.sin(np.radians(turn))[:, None]
    before_x = cosine * arm[..., 0] + sine * arm[..., 1]
    before_y = cosine * arm[..., 1] - sine * arm[..., 0]
    out: Array = arm - np.stack([before_x, before_y], axis=-1)
    out += np.stack([dx, dy], axis=-1)[:, None, :]
    return out


def pose_arrays(scenes: Sequence[Scene]) -> tuple[Array, Array, Array]:
    """Return tip offsets (S, K, 3), height -inf for no tip, poses (S, 8) and radii (S,) mm.

    The columns of a pose are x, y, yaw, tilt, depth, dx, dy, dyaw, in mm and deg.
    """
    most = max(len(scene.indenter.offsets) for scene in scenes)
    offsets = np.zeros((len(scenes), most, 3))
    offsets[:, :, 2] = -np.inf
    pose = np.empty((len(scenes), 8))
    radius = np.empty(len(scenes))
    arrays: dict[int, Array] = {}  # thousands of scenes share a few indenters
    for row, scene in enumerate(scenes):
        p, indenter = scene.pose, scene.indenter
        pose[row] = p.x, p.y, p.yaw, p.tilt, p.depth, p.dx, p.dy, p.dyaw
        radius[row] = indenter.radius
        if id(indenter) not in arrays:
            arrays[id(indenter)] = np.array(indenter.offsets, dtype=np.float64)
        offsets[row, : len(indenter.offsets)] = arrays[id(indenter)]
    return offsets, pose, radius


def check_poses(
    scenes: Sequence[Scene], pose: Array, *rules: tuple[npt.NDArray[np.bool_], str]
) -> None:
    """Refuse tips of unknown radius, poses that are not finite or too high, and what a rule names.

    Args:
        scenes: S scenes.
        pose: (S, 8) their poses, as of ``pose_arrays``.
        *rules: (S,) which scenes are wrong, and a sentence about one, with ``{x}`` and so on for
            the numbers of its pose.

    Raises:
        UserError: There is such a scene.
    """
    unknown = np.array([math.isnan(scene.indenter.radius) for scene in scenes])
    for wrong, sentence in (
        (unknown, "the indenter's radius is not known; a simulated sensor needs it."),
        (~np.isfinite(pose).all(axis=1), "the pose has {given}; each of them must be finite."),
        (pose[:, 4] < 0, "the pose's depth is {depth:g} mm; it must be 0 or more."),
        *rules,
    ):
        if wrong.any():
            numbers = asdict(scenes[int(wrong.argmax())].pose)
            given = ", ".join(f"{name} {value:g}" for name, value in numbers.items())
            raise UserError(sentence.format(**numbers, given=given))


def check_reach(n: Array, delta: Array, deepest: float) -> None:
    """Raise UserError for a touching tip that is too deep or too steep for the tables, or NaN.

    Args:
        n: (S, K, 3) directions of the tips.
        delta: (S, K) penetrations, mm.
        deepest: Greatest tabulated penetration, mm.
    """
    touching = delta > 0
    if np.isnan(n).any() or np.isnan(delta).any():
        raise UserError("a tip's place or depth is not a number; give x, y and depth in mm.")
    if (delta > deepest + SLACK).any():
        raise UserError(
            f"a tip penetrates {delta.max():.2f} mm; for a tip of its size the simulator's tables "
            f"end at {deepest:g} mm, press less deep (of a protocol: depth_max_mm)."
        )
    low = math.cos(math.radians(STEEPEST_DEG + SLACK))
    if (touching & (n[..., 2] < low)).any():
        steepest = math.degrees(math.acos(max(-1.0, float(n[..., 2][touching].min()))))
        raise UserError(
            f"a tip touches {steepest:.1f} deg from the apex; beyond {STEEPEST_DEG:g} deg the rim "
            "matters, which the simulator does not know: press nearer to the apex."
        )
