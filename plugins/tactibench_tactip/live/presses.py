"""Presses that are made while somebody watches."""

from __future__ import annotations

import threading
from functools import partial
from types import TracebackType
from typing import Self

from tactibench_tactip.camera.gate import Reference
from tactibench_tactip.collecting.plan import check, eased, fits, plan_of
from tactibench_tactip.failures import RobotError, StopNowError
from tactibench_tactip.motion import press_moves
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch.search import find_touch

HELD_S = 1.0


class Presses:
    """The singles of exp1, in turn, each held for a second, in a thread of its own."""

    def __init__(self, settings: Settings) -> None:
        self.station = Station(settings)
        self._plan = plan_of("exp1", settings, draws=("singles",), count=100)
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self.station.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join(30.0)
        self.station.__exit__(kind, error, trace)

    @property
    def rest(self) -> Reference:
        return self.station.rest or self.station.look_at_rest()

    def begin(self) -> None:
        """Find first touch and press from then on. Raises UserError."""
        station = self.station
        find_touch(station, first=True)
        check(self._plan, station.settings, station.geometry, turns=station.owner.robot.turns)
        self._thread = threading.Thread(target=self._run, name="tactip presses", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        station = self.station
        for press in self._plan.presses:
            scene = eased(press.scene)
            if self._end.is_set() or not fits(station.settings.indenter, scene.indenter):
                return
            trip = press_moves.way(scene, station.geometry, station.settings)
            try:
                with station.at(scene):
                    station.do(partial(press_moves.descend, trip=trip, guard=_free))
                    self._end.wait(HELD_S / station.settings.robot.time_scale)
                    station.withdraw()
            except (RobotError, StopNowError):
                return


def _free(_: object) -> str:
    return ""
