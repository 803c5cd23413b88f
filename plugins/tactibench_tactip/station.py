"""A sensor, a camera and a robot at work together: rest frames, presses, the way back."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeVar

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.lab import Press
from tactibench_tactip.camera import (
    Camera,
    CameraError,
    FrameCheck,
    Image,
    Reference,
    check_frames,
    count_pins,
)
from tactibench_tactip.geometry import (
    NEAR_MM,
    PressGeometry,
    PressPath,
    distance_between,
    geometry_of,
)
from tactibench_tactip.motion import Mover, RobotThread
from tactibench_tactip.plan import CollectionPlan, check_plan
from tactibench_tactip.robots import Robot, RobotError, RobotState, StopNowError, make_robot
from tactibench_tactip.settings import Pose6, Settings

T = TypeVar("T")

REST_FRAMES = 20
"""Frames of a rest image: their mean has a fifth of the noise of one."""
LOOKS = 3
"""Number of times that frames of a press are taken before the press counts as bad."""
SAME_MM = 0.05
"""Distance that the tool may move while frames are taken."""
RELAXING_S = 5.0
"""Time within which a skin comes back and a camera shows it."""
TRIAL_MM = 1.0
"""Depth of the press that shows at the start how far the camera lags: every camera sees it."""
SLACK_MM = 0.3
"""Depth within which a press begins to show, with what the place of first touch may be off."""
BEFORE_S = 0.3
"""Time before first touch whose frames show the sensor as it was then."""


@dataclass(frozen=True)
class FirstTouch:
    """A place of first touch that was found.

    Attributes:
        z0_mm: First touch along the work frame's z.
        spread_mm: Difference of two searches.
        found_s: Moment of ``time.monotonic`` at which it was found.
    """

    z0_mm: float
    spread_mm: float
    found_s: float = field(default_factory=lambda: time.monotonic())


@dataclass(frozen=True)
class Descent:
    """A descent to a press, on the clock of the frames.

    Attributes:
        touched_ns: Moment at which the tool passed first touch.
        ended_ns: Moment at which it stood.
        mm_s: Speed.
    """

    touched_ns: int
    ended_ns: int
    mm_s: float


@dataclass(frozen=True, eq=False)
class PressResult:
    """The outcome of one press.

    Attributes:
        scene: Scene with the pose that was reached.
        check: Check of its frames; its reason says why they cannot be kept.
        settled_ns: End of settling, on the clock of the frames.
        commanded: Pose of the tool in the work frame that was commanded.
        before: Pose of the tool before the frames were taken.
        after: Pose of the tool after the frames were taken.
        state: State of the robot before the frames were taken.
        looks: Number of times that frames were taken.
    """

    scene: Scene
    check: FrameCheck
    settled_ns: int
    commanded: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    state: RobotState
    looks: int


class Station:
    """The camera and the robot of a setup, opened in this order.

    On exit the tool is withdrawn before the robot is released.

    Args:
        settings: Configuration of the setup.
        robot: A robot that is not connected; None: the robot of the configuration.
        camera: A camera, which is opened on entry where it is not open; None: that of the
            configuration.

    Attributes:
        indenter: The mounted indenter.
        geometry: Geometry of presses, with the z0 of the latest first touch.
        touch: The latest first touch of the mounted indenter; None until one was found.
        rest: The undeformed sensor; None until ``look_at_rest``.
        place: Where the tool was left, in a sentence; "" until the end.
    """

    def __init__(
        self, settings: Settings, robot: Robot | None = None, camera: Camera | None = None
    ) -> None:
        self.settings = settings
        robot = robot or make_robot(settings)
        self.camera = camera or robot.camera(settings.camera)
        self.robot_thread = RobotThread(robot, settings)
        self.indenter = settings.indenter.indenter()
        self.geometry = geometry_of(settings)
        self.rest: Reference | None = None
        self.touch: FirstTouch | None = None
        self._presses_since_touch = 0
        self.place = ""
        self._stop_asked = False
        self._pressed: Scene | None = None
        self._afterimage: Image | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if not self.camera.is_open:
                stack.enter_context(self.camera)
            # The first count of pins compiles code: this must not delay a robot that is connected.
            count_pins(self.camera.now().image)
            stack.enter_context(self.robot_thread)
            stack.push(self._leave)
            self.do(self._enter)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def _leave(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        """Withdraw the tool, and say where it is."""
        problem = ""
        try:
            self.withdraw()
        except RobotError as failure:
            problem = f"{failure} ".removeprefix(f"{error} ")  # which is told already
        except StopNowError:
            problem = "The robot was stopped again; the tool was left where it is. "
        scene = self._pressed or Scene(self.indenter, Pose())
        slack = SAME_MM if self.touch else self.settings.contact.travel_mm
        self.place = problem + describe_place(self.robot_thread, self.geometry, scene, slack)
        if error is not None:
            error.add_note(self.place)
        elif problem and self._pressed is not None:
            raise RobotError(self.place)

    @property
    def robot(self) -> Robot:
        """The robot; only its own thread may move it."""
        return self.robot_thread.robot

    def do(self, job: Callable[[Mover], T]) -> T:
        """Return the result of a job of the robot's thread."""
        return self.robot_thread.do(job)

    def stop_now(self) -> None:
        """Stop the robot at once, from any thread; from now on it is only drawn back."""
        self._stop_asked = True
        self.robot_thread.halt.set()

    # The way back

    def withdraw(self) -> None:
        """Stop, and retract the tool. Raise RobotError where it was left where it is."""
        scene = self._pressed

        def back(mover: Mover) -> None:
            self.robot_thread.halt.clear()  # here: jobs before this one have seen it
            mover.stop()
            mover.check()
            if scene is not None:
                mover.withdraw(scene, self.geometry)

        try:
            self.do(back)
        except RobotError as error:
            raise RobotError(f"{error} The tool was left where it is.") from None
        self._pressed = None

    def make_room(self) -> None:
        """Move up as far as the envelope allows, so that somebody can change the indenter."""

        def up(mover: Mover) -> None:
            mover.raise_straight(self.geometry)
            high = -0.9 * self.settings.envelope.above_mm
            mover.go((0.0, 0.0, high, 0.0, 0.0, 0.0), self.settings.robot.approach_mm_s)

        self.do(up)

    def mount(self, indenter: Indenter) -> None:
        """Note that another indenter was mounted; first touch has to be found again."""
        self.indenter, self.geometry = indenter, geometry_of(self.settings, indenter)
        self.touch = None

    # First touch

    @property
    def touch_is_due(self) -> bool:
        """Return whether first touch is to be found before the next press, or found again."""
        if self.touch is None:
            return True
        contact = self.settings.contact
        old = time.monotonic() - self.touch.found_s >= 60.0 * contact.every_minutes
        return old or self._presses_since_touch >= contact.every_presses

    def set_touch(self, touch: FirstTouch) -> None:
        """Count depths from a first touch that was found just now."""
        self.touch, self._presses_since_touch = touch, 0
        self.geometry = self.geometry.with_z0(touch.z0_mm)

    # Checks

    def check_plan(self, plan: CollectionPlan) -> None:
        """Raise UserError where a press of a plan may not be made with this setup."""
        check_plan(plan, self.settings, self.geometry, turns=self.robot.turns)

    def check_scenes(self, source: str, scenes: Iterable[Scene]) -> None:
        """Raise UserError where presses of no protocol, called ``source``, may not be made here."""
        presses = tuple(Press(k, f"press {k + 1}", scene) for k, scene in enumerate(scenes))
        self.check_plan(CollectionPlan(source, presses, {}))

    # Rest frames

    def look_at_rest(self) -> Reference:
        """Raise the tool and return the undeformed sensor, with which later frames are compared.

        Raises:
            UserError: The count of pins is not the configuration's.
        """
        self.do(lambda m: m.raise_straight(self.geometry))
        rest = Reference.of(self.camera.after(time.monotonic_ns(), REST_FRAMES))
        rest.check_pins(self.settings.sensor)
        self.rest = rest
        return rest

    def rest_reference(self) -> Reference:
        """Return the latest look at the undeformed sensor, or a new one where there is none."""
        return self.rest or self.look_at_rest()

    def check_undeformed(self) -> None:
        """Check that no fault of the setup spoils all presses.

        Raises:
            CameraError: The undeformed sensor looks otherwise than at the latest look.
            UserError: The count of pins is not the configuration's.
        """
        before, now = self.rest_reference(), self.look_at_rest()
        self.rest = before  # the reference that the data set holds
        now.check_alike(before.mean, "before")

    # Presses

    @contextlib.contextmanager
    def at(self, scene: Scene) -> Iterator[None]:
        """Draw the tool back at the end of the block, in which it is on the path of a press.

        Raises:
            RobotError: The tool was left at a press before, and cannot be drawn back from there.
            StopNowError: Somebody asked to stop; its context is the error of the block.
        """
        if self._stop_asked:
            raise StopNowError
        left = self._pressed
        if left is not None:  # not ``withdraw``, which takes back a request to stop
            self.do(lambda m: m.withdraw(left, self.geometry))
        self._pressed = scene
        try:
            yield
            self.do(lambda m: m.withdraw(scene, self.geometry))
        except BaseException:
            with contextlib.suppress(RobotError):  # the error of the block is the one that is shown
                self.withdraw()
            if self._stop_asked:  # also where the way back took the request to stop for done
                raise StopNowError from None
            raise
        self._pressed = None

    def path(self, scene: Scene) -> PressPath:
        """Return the path of a press.

        Raises:
            UserError: The press is too deep for the sensor.
        """
        deepest = self.settings.sensor.deepest_mm
        if scene.pose.depth > deepest:
            raise UserError(
                f"a press of {scene.pose.depth:.2f} mm was asked for, sensor.deepest_mm allows "
                f"{deepest:g} mm; nothing was moved."
            )
        return self.geometry.path(scene)

    def down(self, mover: Mover, path: PressPath) -> Descent:
        """Descend, as a job of the robot's thread.

        Raises:
            RobotError: A move failed, see ``Mover.go``.
            GuardError: The force is too great, or the tool left its line.
            CameraError: The camera gave no frames in the descent.
            StopNowError: Somebody asked to stop.
        """
        force = mover.force_guard()

        def guard(pose: Pose6) -> str:
            self.camera.check_alive()
            return force(pose)

        left_ns = mover.descend(path, guard)
        ended_ns = time.monotonic_ns()
        way = distance_between(path.near, path.down)
        before_touch = min(1.0, NEAR_MM / max(way, NEAR_MM))
        touched_ns = left_ns + int(before_touch * (ended_ns - left_ns))
        return Descent(touched_ns, ended_ns, 1e9 * way / max(1, ended_ns - left_ns))

    def press(self, scene: Scene) -> PressResult:
        """Press once, take frames, and go back.

        Raises:
            RobotError: A move failed, or was stopped by a guard.
            CameraError: The camera gives no frames, or shows the press too late.
            StopNowError: Somebody asked to stop.
            UserError: The press is too deep for the sensor, or the undeformed sensor shows another
                count of pins than the configuration.
        """
        self.camera.check_rate()
        rest = self.rest_reference()
        path = self.path(scene)
        self._presses_since_touch += 1
        with self.at(scene):
            descent, settled_ns, before, state = self.do(lambda m: self._settle(m, path))
            reached = self.geometry.reached(scene, before)
            check, looks = self._check_frames(settled_ns, rest, reached.pose.depth)
            if not check.reason:  # of a press that is not seen, no moment tells the lag
                self._check_lag(descent, rest)
            after = self.do(lambda m: m.pose())
            moved = max(abs(a - b) for a, b in zip(before[:3], after[:3], strict=True))
            if moved > SAME_MM and not check.reason:
                check = replace(check, reason=f"the tool moved by {moved:.2f} mm meanwhile")
        return PressResult(reached, check, settled_ns, path.down, before, after, state, looks)

    def press_checked(self, scene: Scene) -> PressResult:
        """Press between two undeformed frames, which show a camera that lags.

        Raises:
            RobotError: A move failed, or was stopped by a guard.
            CameraError: The camera gives no frames, or still shows the press before.
            StopNowError: Somebody asked to stop.
            UserError: The press is too deep for the sensor, or the undeformed sensor shows another
                count of pins than the configuration.
        """
        self._wait_undeformed()
        result = self.press(scene)
        if not self._looks_undeformed(result.check.image) and not result.check.reason:
            reason = "the frame after it still shows a contact: the camera lags, or the skin sticks"
            return replace(result, check=replace(result.check, reason=reason))
        return result

    def press_well(self, scene: Scene) -> PressResult:
        """Press as ``press_checked`` does.

        Raises:
            CameraError: The frames cannot be kept, or show the press too late.
        """
        result = self.press_checked(scene)
        if result.check.reason:
            raise CameraError(
                f"the frames of a press of {scene.pose.depth:.1f} mm cannot be kept: "
                f"{result.check.reason}; look at the camera, and whether the indenter is loose."
            )
        return result

    def check_camera(self, place: Scene) -> None:
        """Press a little at a place of first touch: the camera must show it, and in time.

        Raises:
            CameraError: The frames cannot be kept, or show the press too late.
        """
        depth = min(TRIAL_MM, self.settings.sensor.deepest_mm)
        self.press_well(replace(place, pose=replace(place.pose, depth=depth)))

    def _check_lag(self, descent: Descent, rest: Reference) -> None:
        """Raise CameraError where frames began to show a press later than they may.

        What a slow drift of the light changes since the rest frame was there before, too.
        """
        touched_ns = descent.touched_ns
        frames = self.camera.since(touched_ns - int(1e9 * BEFORE_S))
        before = [rest.change_of(f.image) for f in frames if f.t_ns <= touched_ns]
        if not before:  # so slow a press that a lag moves it little
            return
        least = min(before) + rest.threshold - rest.change
        shown = (f.t_ns for f in frames[len(before) :] if rest.change_of(f.image) > least)
        lag_s = 1e-9 * (next(shown, touched_ns) - touched_ns)
        if lag_s > self.camera.late_s + SLACK_MM / descent.mm_s:
            raise CameraError(
                f"a press showed {lag_s:.2f} s after first touch, camera.lag_s allows "
                f"{self.settings.camera.lag_s:g}: the camera lags, or first touch lies deeper than "
                "assumed; take MJPG and a port without a hub, or find first touch again."
            )

    def _settle(self, mover: Mover, path: PressPath) -> tuple[Descent, int, Pose6, RobotState]:
        descent = self.down(mover, path)
        mover.rest(self.settings.timing.settle_s)
        return descent, time.monotonic_ns(), mover.pose(), mover.check()

    def _check_frames(
        self, settled_ns: int, rest: Reference, depth: float
    ) -> tuple[FrameCheck, int]:
        """Return frames after the end of settling, checked, and how often they were taken.

        They are taken again, up to LOOKS times, where they cannot be kept.
        """
        since = settled_ns
        for look in range(1, LOOKS + 1):
            frames = self.camera.after(since, self.settings.camera.burst)
            check = check_frames(frames, rest, self.settings.sensor, depth)
            if not check.reason or look == LOOKS:
                break
            since = frames[-1].t_ns
        return check, look

    def _looks_undeformed(self, press: Image) -> bool:
        """Return whether a frame taken now, with the tool away, shows little of the press.

        A camera that still shows the press lags behind; a skin may creep back slowly.
        """
        rest = self.rest_reference()
        most = rest.change_after(press)
        self._afterimage = press
        for _ in range(LOOKS):
            if rest.change_of(self.camera.after(time.monotonic_ns(), 1)[0].image) <= most:
                self._afterimage = None
                return True
        return False

    def _wait_undeformed(self) -> None:
        """Wait until frames no longer show the press before.

        A camera that shows old frames must not show them in the next press.

        Raises:
            CameraError: Frames still show a contact after RELAXING_S, or the light changed.
        """
        end = time.monotonic() + RELAXING_S
        while self._afterimage is not None and not self._looks_undeformed(self._afterimage):
            if time.monotonic() > end:
                self.check_undeformed()  # other light looks like a contact, too
                raise CameraError(
                    f"frames still show a contact {RELAXING_S:g} s after it: the camera lags, or "
                    "the skin sticks; look at both, then go on with the same command."
                )

    def _enter(self, mover: Mover) -> None:
        """Raise the tool, unless a straight way up is not known to be free.

        Raises:
            UserError: The tool stands outside the envelope.
        """
        if self.robot.at_switches:
            mover.come_in(self.settings.robot.approach_mm_s)
        mover.check_inside()
        mover.raise_straight(self.geometry)


def describe_place(
    thread: RobotThread, geometry: PressGeometry, scene: Scene, slack_mm: float
) -> str:
    """Return a sentence about where the tool is, and whether it is in contact. Never raises.

    Args:
        thread: Thread of the robot.
        geometry: Geometry of presses.
        scene: A press with the mounted indenter.
        slack_mm: Distance by which first touch may lie nearer than the geometry says.
    """
    told = "The tool is"
    try:
        thread.do(lambda mover: mover.pose())
    except (RobotError, StopNowError):
        told, slack_mm = "Look before anything moves: the tool was last seen", math.inf
    pose = thread.mover.last_pose
    if pose is None:
        return "Where the tool is, is not known: look before anything moves."
    depth = geometry.reached(scene, pose).pose.depth
    x, y, z = (f"{value:z.2f}" for value in pose[:3])
    contact = "clear of the sensor"
    if depth > -slack_mm:
        contact = "in contact" if depth > 0.0 else "perhaps in contact"
    touch = f"{abs(depth):.2f} mm {'past' if depth > 0.0 else 'before'} first touch, {contact}"
    if math.isinf(depth):
        touch = "beside the sensor"
    return f"{told} at x {x}, y {y}, z {z} mm of the work frame, {touch}{thread.robot.proviso}."
