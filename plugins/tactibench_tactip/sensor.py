"""The real sensor: its ``press`` moves the robot."""

from __future__ import annotations

from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError, __version__
from tactibench_tactip.plan import describe_indenter, is_mounted, with_smallest_turn
from tactibench_tactip.settings import Settings, read_settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch import find_touch


class TacTip(Sensor):
    """A TacTip under a robot: camera and robot are opened on entry.

    First touch is found before the first press and again as the configuration says. A frame's pose
    is the pose that was reached.
    """

    def __init__(self, context: SensorContext, config: str = "") -> None:  # noqa: ARG002
        self._config = config
        self._stack = ExitStack()
        self._station: Station | None = None

    @cached_property
    def settings(self) -> Settings:
        """The configuration.

        Raises:
            UserError: No configuration is named, or it has a mistake.
        """
        if not self._config:
            raise UserError(
                "sensor 'tactip' is a real one and needs a configuration: --param "
                "sensor.config=FILE.toml (`tactibench hw example` writes one)."
            )
        return read_settings(Path(self._config))

    @property
    def dome_radius_mm(self) -> float:  # type: ignore[override]
        """Radius of the dome."""
        return self.settings.sensor.dome_radius_mm

    @property
    def deepest_mm(self) -> float:  # type: ignore[override]
        """Greatest depth of a press, mm."""
        return self.settings.sensor.deepest_mm

    def __enter__(self) -> Self:
        self._station = self._stack.enter_context(Station(self.settings))
        return self

    def __exit__(self, *_: object) -> None:
        self._station = None
        self._stack.close()

    def rest(self) -> Frame:
        """Return a frame of the undeformed sensor, the mean of several frames."""
        image = self._open.rest_reference().image
        return Frame(image, self._open.camera.now().t_ns * 1e-9, Pose(), image)

    def press(self, scene: Scene) -> Frame:
        """Press once and return the frame, with the pose that was reached.

        Raises:
            UserError: The scene lies outside the envelope, is deeper than ``sensor.deepest_mm``,
                goes sideways after first touch or needs an indenter that is not mounted.
            DeviceError: A device failed, or the frames cannot be kept.
        """
        station = self._open
        self._check(scene)
        if station.touch_is_due:
            find_touch(station)
        result = station.press_well(with_smallest_turn(scene))
        check, rest = result.check, station.rest_reference()
        return Frame(check.image, check.t_ns * 1e-9, result.scene.pose, rest.image)

    def describe(self) -> dict[str, Any]:
        """Return the tables of the configuration that a data set keeps."""
        origin = {"origin": "simulated"} if self.settings.simulated else {}
        return {"plugin": f"tactibench_tactip {__version__}", **origin, **self.settings.record()}

    @property
    def _open(self) -> Station:
        if self._station is None:
            raise UserError("sensor 'tactip' is closed; use it in a `with` block.")
        return self._station

    def _check(self, scene: Scene) -> None:
        station, mounted = self._open, self._open.indenter
        if not is_mounted(mounted, scene.indenter):
            raise UserError(
                f"the press needs {describe_indenter(scene.indenter)}, mounted is "
                f"{describe_indenter(mounted)}; change the indenter and [indenter], "
                "or collect with `tactibench hw collect`."
            )
        if scene.pose.moved:
            raise UserError(
                "the pose went sideways after first touch (dx, dy, dyaw), but this sensor presses "
                "straight down; leave them out."
            )
        station.check_scenes("the scene", [scene])
