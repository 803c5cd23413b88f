"""A sensor, a camera and a robot at work together: rest frames, first touch, presses."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self, TypeVar

from tactibench import Scene, UserError
from tactibench_tactip.camera.driver import Camera, Shot
from tactibench_tactip.camera.gate import Judged, Reference, count_pins, judge
from tactibench_tactip.camera.source import Image
from tactibench_tactip.failures import CameraError, RobotError, StopNowError
from tactibench_tactip.geometry.envelope import outside
from tactibench_tactip.geometry.press import PressGeometry
from tactibench_tactip.motion import press_moves
from tactibench_tactip.motion.mover import Mover
from tactibench_tactip.motion.owner import Owner
from tactibench_tactip.motion.times import patience
from tactibench_tactip.robots.base import Homes, Robot, RobotState
from tactibench_tactip.robots.connect import robot_of
from tactibench_tactip.settings import IndenterKeys, Pose6, Settings

T = TypeVar("T")
REST_FRAMES = 20
LOOKS = 3
"""At the frames of one press, before it counts as bad."""
SAME_MM = 0.05
"""The tool may move by while frames are taken."""
RELAXED = 0.3
RELAXING_S = 5.0
"""Host seconds for a skin to come back, and for a camera to show it."""
LONG_S = 60.0


@dataclass(frozen=True, eq=False)
class Pressed:
    """One press as it came out. scene: with the pose reached. settled_ns: end of settling, on the
    clock of the frames; before, after: the tool in the work frame, around the frames. looks: how
    often frames were taken."""

    scene: Scene
    judged: Judged
    settled_ns: int
    commanded: Pose6
    before: Pose6
    after: Pose6
    state: RobotState
    z0: float
    looks: int
    frames: tuple[Shot, ...] = field(repr=False, default=())


class Station:
    """Opens the camera, then the robot; the tool is drawn back before the robot is let go.

    geometry: where presses are, with the z0 of the latest first touch. rest: the undeformed sensor.
    """

    def __init__(
        self, settings: Settings, robot: Robot | None = None, camera: Camera | None = None
    ) -> None:
        self.settings = settings
        self._opens_camera = camera is None
        self.camera = camera or Camera(settings.camera)
        self.owner = Owner(robot or robot_of(settings), settings)
        self.geometry = PressGeometry(
            settings.frames, settings.sensor.dome_radius_mm, settings.contact.fixed_mm
        )
        self.rest: Reference | None = None
        self._pressing: Scene | None = None
        self._still_seen: Image | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if self._opens_camera:
                stack.enter_context(self.camera)
            # The first look for pins compiles; nobody shall wait for it who holds a robot.
            count_pins(self.camera.now().image)
            stack.enter_context(self.owner)
            self.do(self._enter)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._stack:
            try:
                left = self.withdraw()
            except StopNowError:
                left = "the robot was stopped again; the tool was left where it is"
            if left and self._pressing is not None:
                told = f"{left}, at a press: look before anything moves."
                if error is None:
                    raise RobotError(told)
                error.add_note(told)

    def do(self, job: Callable[[Mover], T], expected_s: float = LONG_S) -> T:
        """Let the robot's thread do a job; expected_s: device seconds."""
        scale = self.settings.robot.time_scale
        return self.owner.do(job, 4.0 * patience(expected_s, scale))

    def stop_now(self) -> None:
        """From any thread: stop the robot at once."""
        self.owner.halt.set()

    def withdraw(self) -> str:
        """Stop, and retract where the robot is normal. Returns why it was left as it is, or ""."""
        scene = self._pressing

        def back(mover: Mover) -> str:
            self.owner.halt.clear()  # here: jobs before this one have seen it
            mover.stop()
            state = mover.state()
            if not state.normal:
                return f"{state.words}; the tool was left where it is"
            if scene is not None:
                press_moves.withdraw(mover, scene, self.geometry, self.settings)
            return ""

        try:
            left = self.do(back)
        except RobotError as error:
            return f"{error} The tool was left where it is"
        if not left:
            self._pressing = None
        return left

    def draw_back(self) -> None:
        """Withdraw. Raises RobotError when the tool was left where it is."""
        left = self.withdraw()
        if left:
            raise RobotError(f"{left}.")

    def make_room(self) -> None:
        """Go up as far as the envelope allows, so that somebody can change the indenter."""

        def up(mover: Mover) -> None:
            press_moves.raise_straight(mover, self.geometry, self.settings)
            high = -0.9 * self.settings.envelope.above_mm
            mover.go((0.0, 0.0, high, 0.0, 0.0, 0.0), self.settings.robot.approach_mm_s)

        self.do(up)

    def mount(self, keys: IndenterKeys) -> None:
        """Another indenter was mounted: first touch has to be found again."""
        self.settings = self.settings.model_copy(update={"indenter": keys})
        self.geometry = self.geometry.with_z0(self.settings.contact.fixed_mm)

    def look_at_rest(self) -> Reference:
        """Frames of the undeformed sensor, the tool well away; later ones are compared to them."""
        self.do(lambda m: press_moves.raise_straight(m, self.geometry, self.settings))
        shots = self.camera.after(time.monotonic_ns(), REST_FRAMES)
        found = Reference.of(shots)
        pins = self.settings.sensor.pins
        if pins is not None and abs(found.pins - pins) > self.settings.sensor.pins_tolerance:
            raise UserError(
                f"the undeformed sensor shows {found.pins} pins, sensor.pins says {pins}; look at "
                "light, focus and camera.crop (`tactibench hw live` shows the frame), or correct "
                "sensor.pins."
            )
        self.rest = found
        return found

    @contextlib.contextmanager
    def at(self, scene: Scene) -> Iterator[None]:
        """The tool is on the way of this press; an exception inside draws it back along it."""
        self._pressing = scene
        try:
            yield
        except BaseException:
            self.withdraw()
            raise
        self._pressing = None

    def way(self, scene: Scene) -> press_moves.Way:
        """Where a press goes. Raises UserError for one deeper than ``sensor.deepest_mm``."""
        deepest = self.settings.sensor.deepest_mm
        if scene.pose.depth > deepest:
            raise UserError(
                f"a press of {scene.pose.depth:.2f} mm was asked for, sensor.deepest_mm allows "
                f"{deepest:g} mm; nothing was moved."
            )
        return press_moves.way(scene, self.geometry, self.settings)

    def press(self, scene: Scene) -> Pressed:
        """Press once, take frames, go back. Raises RobotError, CameraError, StopNowError, and
        UserError as ``way``."""
        rest = self.rest or self.look_at_rest()
        trip = self.way(scene)
        expected = press_moves.seconds(trip, self.settings, 30.0)
        with self.at(scene):
            settled_ns, before, state = self.do(lambda m: self._settle(m, trip), expected)
            reached = self.geometry.reached(scene, before)
            shots, judged, looks = self._frames_of(settled_ns, rest, reached.pose.depth)
            after = self.do(lambda m: m.pose())
            moved = max(abs(a - b) for a, b in zip(before[:3], after[:3], strict=True))
            if moved > SAME_MM:
                judged = _because(judged, f"the tool moved by {moved:.2f} mm meanwhile")
            self.do(
                lambda m: press_moves.withdraw(m, scene, self.geometry, self.settings), expected
            )
        return Pressed(
            reached,
            judged,
            settled_ns,
            trip.down,
            before,
            after,
            state,
            self.geometry.z0,
            looks,
            tuple(shots),
        )

    def _frames_of(
        self, settled_ns: int, rest: Reference, depth: float
    ) -> tuple[list[Shot], Judged, int]:
        """Frames after the end of settling, again where they cannot be kept, and how often."""
        since = settled_ns
        for look in range(1, LOOKS + 1):
            shots = self.camera.after(since, self.settings.camera.burst)
            judged = judge(shots, rest, self.settings.sensor, depth)
            if not judged.reason or look == LOOKS:
                break
            since = shots[-1].t_ns
        return shots, judged, look

    def looks_undeformed(self, press: Image) -> bool:
        """Whether a frame taken now, the tool away, shows less than RELAXED of the change of the
        press: a camera that still shows it lags behind, a skin creeps back."""
        rest = self.rest or self.look_at_rest()
        most = rest.change + max(0.3, RELAXED * (rest.change_of(press) - rest.change))
        self._still_seen = press
        for _ in range(LOOKS):
            shot = self.camera.after(time.monotonic_ns(), 1)[0]
            if rest.change_of(shot.image) <= most:
                self._still_seen = None
                return True
        return False

    def demand_undeformed(self) -> None:
        """Wait for a press that was still seen after it to be gone, before the next one: a camera
        that shows old frames must not show them there. Raises CameraError after RELAXING_S."""
        end = time.monotonic() + RELAXING_S
        while self._still_seen is not None and not self.looks_undeformed(self._still_seen):
            if time.monotonic() > end:
                raise CameraError(
                    f"frames still show a contact {RELAXING_S:g} s after it: the camera lags, or "
                    "the skin sticks; look at both, then go on with the same command."
                )

    def _enter(self, mover: Mover) -> None:
        """Refuse to start where a straight way up is not known to be free."""
        robot = self.owner.robot
        if isinstance(robot, Homes) and robot.at_switches:
            mover.come_in(self.settings.robot.approach_mm_s)
        where = outside(self.settings.envelope, mover.pose())
        if where:
            raise UserError(
                f"the tool stands at {where}; drive it into the envelope above the sensor first, "
                "with the pendant or `tactibench hw jog`."
            )
        press_moves.raise_straight(mover, self.geometry, self.settings)

    def down(self, mover: Mover, trip: press_moves.Way) -> int:
        """A job: the descent of a press, which too much force or a camera without frames stops.
        Returns when it ended, ns on the clock of the frames. Raises as ``Mover.go``."""
        force = press_moves.force_guard(mover, self.settings.envelope.max_force_n)

        def guard(pose: Pose6) -> str:
            return force(pose) or ("" if self.camera.alive() else "the camera gives no frames")

        press_moves.descend(mover, trip, guard)
        return time.monotonic_ns()

    def _settle(self, mover: Mover, trip: press_moves.Way) -> tuple[int, Pose6, RobotState]:
        self.down(mover, trip)
        mover.rest(self.settings.timing.settle_s)
        return time.monotonic_ns(), mover.pose(), mover.state()


def _because(judged: Judged, reason: str) -> Judged:
    return replace(judged, reason=judged.reason or reason)
