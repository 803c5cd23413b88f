"""A robot and a camera that exist in this program only, around a simulated sensor.

They let a person rehearse every command without a device. The robot is where it was sent, a little
later; the camera shows the simulated sensor as the robot's tool presses it. They report no force
and have no faults, and they share the geometry of the drivers: a rehearsal shows how the program is
used, and proves nothing for a table.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache

import numpy as np

from tactibench import Indenter, Pose, Scene, SensorContext, UserError, open_sensor
from tactibench_tactip.camera import Camera, Image
from tactibench_tactip.geometry import PressGeometry, inverse, matrix, pose_of
from tactibench_tactip.motion import move_seconds
from tactibench_tactip.robots import Purpose, Robot, RobotState
from tactibench_tactip.settings import CameraSettings, FrameSettings, Pose6, Settings

SENSOR = "tactip-127"
FASTER = 20.0
"""Factor by which the robot moves faster than a real one: nobody waits for a rehearsal."""
HIGHER_MM = 0.8
"""Distance of first touch behind the place in the configuration, which has to be found."""
OFFSET = (0.4, -0.3, 6.0)
"""x, y mm and yaw deg by which the sensor lies off its place, for a calibration to find."""
NOISE = 1.5
"""Noise of a small camera, grey levels rms (assumed)."""
SHOWN = 64
"""Images that are remembered, so that a held press is drawn once."""


class SimulatedRobot(Robot):
    """A robot that moves along its line without acceleration, and a camera beside it.

    Attributes:
        frames: The true place of the sensor.
    """

    def __init__(self, settings: Settings) -> None:
        self.turns = settings.robot.driver != "grbl"
        self.frames: FrameSettings = settings.frames
        self._dome = settings.sensor.dome_radius_mm
        self._indenter = settings.indenter.indenter()
        self._work = matrix(settings.frames.work_frame)
        high = -0.8 * settings.envelope.above_mm
        self._end = self._start = pose_of(self._work @ matrix((0.0, 0.0, high, 0.0, 0.0, 0.0)))
        self._began_s, self._lasts_s = 0.0, 0.0

    def misplace(self) -> None:
        """Move the sensor by OFFSET from where the configuration says that it is."""
        place = tuple(a + b for a, b in zip(self.frames.sensor, OFFSET, strict=True))
        self.frames = self.frames.model_copy(update={"sensor": place})

    def connect(self, purpose: Purpose = "move") -> None:
        """Do nothing: there is no device."""

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        """Begin a straight move."""
        self._start, self._end = self.pose(), pose
        self._lasts_s = move_seconds(self._start, pose, speed, acceleration) / FASTER
        self._began_s = time.monotonic()

    def moving(self) -> bool:
        """Return whether the move goes on."""
        return time.monotonic() < self._began_s + self._lasts_s

    def pose(self) -> Pose6:
        """Return the pose of the tool; the angles change at the end of a move."""
        if not self.moving():
            return self._end
        share = (time.monotonic() - self._began_s) / self._lasts_s
        x, y, z = (a + share * (b - a) for a, b in zip(self._start[:3], self._end[:3], strict=True))
        return x, y, z, *self._start[3:]

    def stop(self) -> None:
        """Stop at once."""
        self._end, self._lasts_s = self.pose(), 0.0

    def state(self) -> RobotState:
        """Return a normal state."""
        return RobotState(normal=True, description="simulated")

    def close(self) -> None:
        """Do nothing: there is no device."""

    def describe(self) -> dict[str, str]:
        """Return that it is simulated."""
        return {"driver": "simulated"}

    def mount(self, indenter: Indenter) -> bool:
        """Mount an indenter at once."""
        self._indenter = indenter
        return True

    def camera(self, settings: CameraSettings) -> Camera:
        """Return a camera that looks at the simulated sensor, which is compiled at first."""
        capture = SimulatedCapture(self, settings.fps)
        return SimulatedCamera(settings, lambda _: capture)

    def scene(self) -> Scene:
        """Return the scene that the sensor shows now; its depth is negative without a contact."""
        geometry = PressGeometry(self.frames, self._dome, HIGHER_MM)
        tool = pose_of(inverse(self._work) @ matrix(self.pose()))
        return geometry.reached(Scene(self._indenter, Pose()), tool)


class SimulatedCamera(Camera):
    """A camera whose frames come as fast as this machine draws them."""

    def check_rate(self) -> float:
        """Return the rate that the configuration asks for."""
        return self._settings.fps


class SimulatedCapture:
    """What a ``cv2.VideoCapture`` offers: frames of the simulated sensor under a robot's tool."""

    def __init__(self, robot: SimulatedRobot, fps: float) -> None:
        self._robot, self._period_s = robot, 1.0 / fps
        self._rng = np.random.default_rng(0)
        # The camera's own noise makes every frame another one, also of a press that is held.
        context = SensorContext(np.random.SeedSequence(0))
        self._sensor = open_sensor(SENSOR, context, {}, preferred={"noise": "false"})
        self._draw = lru_cache(SHOWN)(self._draw_image)
        self._draw_image(Scene(Indenter.single(), Pose(depth=1.0)))

    def grab(self) -> bool:
        """Wait for the next frame."""
        time.sleep(self._period_s)
        return True

    def retrieve(self) -> tuple[bool, Image]:
        """Return the present frame, (H, W) uint8."""
        scene = self._robot.scene()
        pose = scene.pose
        names = ("x", "y", "yaw", "tilt", "depth")
        rounded = replace(pose, **{name: round(getattr(pose, name), 3) for name in names})
        image = self._draw(replace(scene, pose=rounded) if pose.depth > 0.0 else None)
        noisy = image + self._rng.normal(0.0, NOISE, image.shape)
        return True, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def _draw_image(self, scene: Scene | None) -> Image:
        """Return the image of a scene; where the sensor refuses its depth, of a shallower one."""
        while scene is not None and scene.pose.depth > 0.01:
            try:
                return self._sensor.press(scene).image
            except UserError:
                scene = replace(scene, pose=replace(scene.pose, depth=0.95 * scene.pose.depth))
        return self._sensor.rest().image

    def set(self, _name: int, _value: float) -> bool:
        """Accept every setting."""
        return True

    def get(self, _name: int) -> float:
        """Return 0 for every setting."""
        return 0.0

    def getBackendName(self) -> str:  # noqa: N802 - OpenCV's name
        """Return the name of what gives the frames."""
        return "simulated"

    def release(self) -> None:
        """Do nothing: there is no device."""
