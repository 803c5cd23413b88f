"""First touch: by the tactile image, or as the configuration says.

Depth is counted from where the sensor is first touched, not from where a pose says that it should
be. The search by image goes down in small steps until two frames in a row change by more than
noise. Then, from before that place, it makes a ramp of steps and measures the change of every frame
along the change of the deepest one. The change begins at first touch and grows with a power of the
depth: the beginning of the best such curve is first touch, which is then known to much less than
the step and the threshold of detection.
"""

from __future__ import annotations

import time

import numpy as np

from tactibench import Pose, Scene, UserError
from tactibench_tactip.camera import Image, Reference
from tactibench_tactip.geometry import NEAR_MM, Array
from tactibench_tactip.motion import Guard, Mover
from tactibench_tactip.robots import GuardError, RobotError
from tactibench_tactip.station import FirstTouch, Station

STEP_MM = 0.1
"""Step of a search by eye: smaller than a press that is seen (``SEEN_MM`` of frame_check)."""
BEFORE_MM, BEYOND_MM = 0.25, 0.6
"""Distances of the start and the end of the ramp from the place at which a change was noticed."""
FRAMES, NOTICE_FRAMES = 3, 2
"""Frames taken at a step of the ramp, and at a step on the way down."""
AGAIN_MM = 1.0
"""Distance before the last first touch at which a later search begins."""
POWERS = np.arange(1.0, 2.01, 0.1)
"""Powers to try: from the displacement of a pin under the tip (1) to a Hertzian force (1.5) and
beyond."""
GRID_MM = 0.002
"""Grid on which the beginning of the ramp is sought, far below what frames can tell."""
ASIDE_MM = 0.2
"""Distance beside the approach of a place above which the tool goes up before it goes there."""


def find_touch(station: Station, scene: Scene | None = None) -> FirstTouch:
    """Take a new rest frame, find first touch from it, and set it in the station.

    After the first time the camera is checked there by a press.

    The first search is over all of ``contact.travel_mm``; a later one begins a little before the
    last first touch.

    Args:
        station: An open station.
        scene: Place of the search; None: ``contact.at_mm``.

    Raises:
        RobotError: Nothing was touched, or a move failed.
        CameraError: The camera shows no contact, or shows it too late.
        UserError: Two searches differ by more than ``contact.spread_mm``.
    """
    contact, is_first = station.settings.contact, station.touch is None
    place = scene or Scene(station.indenter, Pose(*contact.at_mm))
    station.look_at_rest()
    if contact.method == "fixed":
        touch = FirstTouch(contact.fixed_mm, 0.0)
    else:
        touch = _search(station, place)
    station.set_touch(touch)
    if is_first:
        station.check_camera(place)
    return touch


def _search(station: Station, place: Scene) -> FirstTouch:
    """Search twice at one place, and return the mean."""
    contact = station.settings.contact
    with station.at(place):
        search = _Search(station, place)
        once = search.find(-contact.travel_mm if station.touch is None else -AGAIN_MM)
        twice = search.find(once - AGAIN_MM)
    spread = abs(once - twice)
    if spread > contact.spread_mm:
        station.check_undeformed()  # other light, which names itself, looks like a touch
        raise UserError(
            f"two searches for first touch differ by {spread:.2f} mm, contact.spread_mm "
            f"allows {contact.spread_mm:g}; tighten the mounts, let the light warm up, or lengthen "
            "timing.settle_s."
        )
    return FirstTouch(station.geometry.z0 + 0.5 * (once + twice), spread)


def projections(images: Array, rest: Array) -> Array:
    """Return (N,) shares of the last image's change that (N, H, W) images show.

    q_i = <I_i - I_0, t> / <t, t> with t = I_N - I_0 without its mean: every pixel counts as much as
    it changes, so that noise of a frame adds little, and a change of brightness nothing.
    """
    change = (images - rest).reshape(len(images), -1)
    change = change - change.mean(axis=1, keepdims=True)
    template = change[-1]
    shares: Array = change @ template / max(float(template @ template), 1e-12)
    return shares


def fit_onset(depths: Array, signal: Array) -> float:
    """Return s0, mm, of the least-squares fit of q = a max(0, s - s0)^p + b.

    b is what the noise of the rest frame, which is in all changes, adds to every q: without it the
    fit begins too early.

    Args:
        depths: (N,) s, mm, ascending.
        signal: (N,) q.
    """
    last, signal = float(depths[-1]), signal - signal.mean()
    starts = np.arange(float(depths[0]), last - STEP_MM, GRID_MM)
    best = (np.inf, float(depths[0]))
    for power in POWERS:
        base = np.maximum(0.0, depths[None, :] - starts[:, None]) ** power
        base -= base.mean(axis=1, keepdims=True)
        scale = base @ signal / np.maximum((base**2).sum(axis=1), 1e-12)
        errors = ((scale[:, None] * base - signal) ** 2).sum(axis=1)
        k = int(np.argmin(errors))
        best = min(best, (float(errors[k]), float(starts[k])))
    return best[1]


class _Search:
    """A search at one place; its results are depths in the present geometry, mm.

    Its guard compares with the force before the search, when nothing was touched. A guard made anew
    at every step would not see a force that grows with the steps.

    Args:
        station: An open station, whose tool ``look_at_rest`` raised.
        place: Place of the search.
    """

    def __init__(self, station: Station, place: Scene) -> None:
        self._station, self._place = station, place
        self._guard: Guard = station.do(lambda m: m.force_guard())

    def find(self, start: float) -> float:
        """Return the depth at which the image begins to change."""
        rest = self._station.rest_reference()
        noticed = self._go_down(start, rest)
        steps = np.arange(noticed - BEFORE_MM - STEP_MM, noticed + BEYOND_MM + 1e-9, STEP_MM)
        self._station.do(lambda m: self._step(m, float(steps[0]) - 0.2))
        depths, images = [], []
        for depth in steps:
            reached, frames = self._look(float(depth), FRAMES)
            depths.append(reached)
            images.append(np.mean(frames, axis=0))
        # Without the deepest: projected on itself its noise adds up, and bends the curve.
        shares = projections(np.array(images), rest.mean)
        return fit_onset(np.array(depths[:-1]), shares[:-1])

    def _go_down(self, start: float, rest: Reference) -> float:
        """Go down in steps, and return the depth at which the sensor was touched.

        Raises:
            RobotError: Nothing was touched.
        """
        end = max(self._station.settings.contact.travel_mm, start + AGAIN_MM)
        self._station.do(self._go_above)
        for depth in np.arange(start, end + 1e-9, STEP_MM):
            reached, images = self._look(float(depth), NOTICE_FRAMES)
            if all(rest.change_of(image) > rest.threshold for image in images):
                return reached
        raise RobotError(
            f"nothing was touched from {-start:.1f} mm before the expected place to {end:.1f} mm "
            "beyond it; check frames.work_frame and frames.tcp_pose, or allow more with "
            "contact.travel_mm."
        )

    def _look(self, depth: float, count: int) -> tuple[float, list[Image]]:
        """Go to a depth and settle; return the depth reached, and frames there."""
        station = self._station

        def arrive(mover: Mover) -> tuple[int, float]:
            self._step(mover, depth)
            mover.rest(station.settings.timing.settle_s)
            reached = station.geometry.reached(self._place, mover.pose())
            return time.monotonic_ns(), reached.pose.depth

        settled_ns, reached = station.do(arrive)
        return reached, [frame.image for frame in station.camera.after(settled_ns, count)]

    def _go_above(self, mover: Mover) -> None:
        """Move to clearance above the place."""
        mover.raise_straight(self._station.geometry)
        above = self._station.geometry.path(self._place).above
        mover.go(above, self._station.settings.robot.approach_mm_s)

    def _step(self, mover: Mover, depth: float) -> None:
        """Move straight to a depth on the approach of the place, sideways only at clearance."""
        place, settings, geometry = self._place, self._station.settings, self._station.geometry
        pose = geometry.reached(place, mover.pose()).pose
        if max(abs(pose.x - place.pose.x), abs(pose.y - place.pose.y)) > ASIDE_MM:
            self._go_above(mover)
        if pose.depth < -settings.contact.travel_mm - 0.5 and depth > -NEAR_MM:
            near = geometry.at_depth(place, min(depth, -NEAR_MM))
            mover.go(near, settings.robot.approach_mm_s, self._guard)
        mover.go_in_touch(geometry.at_depth(place, depth), settings.robot.press_mm_s, self._guard)
        reason = self._guard(mover.pose())  # a step may have ended before the guard looked
        if reason:
            raise GuardError(reason)
