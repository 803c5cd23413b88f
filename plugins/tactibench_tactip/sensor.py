"""The real sensor: its ``press`` moves the robot."""

from __future__ import annotations

from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError, __version__
from tactibench_tactip.collecting.plan import check_scenes, eased, fits, words
from tactibench_tactip.configuration import read_settings
from tactibench_tactip.failures import DeviceError
from tactibench_tactip.lab_press import one_press
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch.search import find_touch


class TacTip(Sensor):
    """Camera and robot are opened on entry; first touch is found before the first press and again
    as the configuration says. A frame's pose is the one that was reached.

    Raises UserError for a scene outside the envelope, deeper than ``sensor.deepest_mm``, or of an
    indenter that is not mounted, and for frames that cannot be kept.
    """

    def __init__(self, context: SensorContext, config: str = "") -> None:  # noqa: ARG002
        self._config = config
        self._stack = ExitStack()
        self._station: Station | None = None
        self._since: int | None = None

    @cached_property
    def settings(self) -> Settings:
        if not self._config:
            raise UserError(
                "sensor 'tactip' is a real one and needs a configuration: --param "
                "sensor.config=FILE.toml (`tactibench hw emulate --write FILE.toml` makes one)."
            )
        return read_settings(Path(self._config))

    @property
    def dome_radius_mm(self) -> float:  # type: ignore[override]
        return self.settings.sensor.dome_radius_mm

    @property
    def deepest_mm(self) -> float:  # type: ignore[override]
        return self.settings.sensor.deepest_mm

    def __enter__(self) -> Self:
        self._station = self._stack.enter_context(Station(self.settings))
        self._since = None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._station = None
        self._stack.close()

    def rest(self) -> Frame:
        """The undeformed sensor, the mean of some frames."""
        found = self._open.rest or self._open.look_at_rest()
        return Frame(found.image, self._open.camera.now().t_ns * 1e-9, Pose(), found.image)

    def press(self, scene: Scene) -> Frame:
        """Press once."""
        station = self._open
        self._check(scene)
        if self._since is None or self._since >= self.settings.contact.every_presses:
            station.look_at_rest()
            find_touch(station, first=self._since is None)
            self._since = 0
        self._since += 1
        pressed, reason = one_press(station, eased(scene))
        if reason:
            raise DeviceError(f"the frames of a press cannot be kept: {reason}.")
        rest = station.rest
        assert rest is not None, "looked at before the first press"  # noqa: S101
        judged = pressed.judged
        return Frame(judged.image, judged.t_ns * 1e-9, pressed.scene.pose, rest.image)

    def describe(self) -> dict[str, Any]:
        """What the configuration says of sensor, camera and frames."""
        return {"plugin": f"tactibench_tactip {__version__}", **self.settings.lasting()}

    @property
    def _open(self) -> Station:
        if self._station is None:
            raise UserError("sensor 'tactip' is closed; use it in a `with` block.")
        return self._station

    def _check(self, scene: Scene) -> None:
        station = self._open
        if not fits(self.settings.indenter, scene.indenter):
            raise UserError(
                f"the press needs {words(scene.indenter)}, mounted is "
                f"{words(self.settings.indenter.indenter())}; change the indenter and [indenter], "
                "or collect with `tactibench hw collect`."
            )
        turns = station.owner.robot.turns
        check_scenes("the scene", [scene], self.settings, station.geometry, turns=turns)
