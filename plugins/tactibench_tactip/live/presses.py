"""Presses that are made while somebody watches."""

from __future__ import annotations

import threading
from functools import partial
from types import TracebackType
from typing import Self

from tactibench_tactip.camera.gate import Reference
from tactibench_tactip.collecting.plan import check, eased, fits, plan_of
from tactibench_tactip.failures import StopNowError
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch.search import find_touch

HELD_S = 1.0
END_S = 15.0
"""Host seconds for a press to come to its end, before the robot is stopped."""


class Presses:
    """The singles of exp1, in turn, each held for a second, in a thread of its own.

    Raises on exit what ended them.
    """

    def __init__(self, settings: Settings) -> None:
        self.station = Station(settings)
        self._plan = plan_of("exp1", settings, draws=("singles",), count=100)
        self._end = threading.Event()
        self._thread: threading.Thread | None = None
        self._failed: Exception | None = None

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
            self._thread.join(END_S)
            if self._thread.is_alive():
                self.station.stop_now()
                self._thread.join(END_S)
        if error is not None or self._failed is None:
            self.station.__exit__(kind, error, trace)
            return
        self.station.__exit__(type(self._failed), self._failed, self._failed.__traceback__)
        raise self._failed

    @property
    def failed(self) -> bool:
        """Whether something ended them."""
        return self._failed is not None

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
            try:
                trip = station.way(scene)
                with station.at(scene):
                    station.do(partial(station.down, trip=trip))
                    self._end.wait(HELD_S / station.settings.robot.time_scale)
                    station.draw_back()
            except StopNowError:
                return
            except Exception as error:  # noqa: BLE001 - raised again on exit
                self._failed = error
                return
