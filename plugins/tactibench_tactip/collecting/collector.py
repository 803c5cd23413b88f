"""A collection: the presses of a plan into a data set, so that any of it may be interrupted.

What was acknowledged is never lost and never made twice: the plan is written first, a sample is
written when it is whole, and going on takes what the plan has and the data set has not.
"""

from __future__ import annotations

import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from tactibench import Indenter, UserError
from tactibench.datasets import Writer
from tactibench.lab import Press
from tactibench_tactip.collecting import plan as plans
from tactibench_tactip.collecting.plan import Plan, eased, fits
from tactibench_tactip.collecting.rows import aborted_draft, draft_of
from tactibench_tactip.failures import ProtectiveStopError, StopNowError, TrippedError
from tactibench_tactip.lab_press import one_press
from tactibench_tactip.robots.base import Recovers
from tactibench_tactip.settings import IndenterKeys, Settings
from tactibench_tactip.station import Station
from tactibench_tactip.touch.search import Touch, find_touch

Mount = Callable[[Indenter, int], bool]
"""Asks somebody to mount an indenter for so many presses; whether it was done."""

ATTEMPTS = 2
"""Of one press in a session, before it is written as bad."""
STOPS_OF_ONE = 2
"""Protective stops at one press, over all sessions, before it is given up."""
RECOVER_PRESSES = 500
DRIFT_MM = 0.05
"""Of first touch between two searches, from which on the drift is a warning."""


@dataclass
class Report:
    """What a session did. left: presses that are still missing; unmounted: of those, the ones that
    need another indenter."""

    ok: int = 0
    bad: int = 0
    touches: list[Touch] = field(default_factory=list)
    stops: int = 0
    left: int = 0
    unmounted: int = 0
    interrupted: bool = False


class Collector:
    """One session at an open station. report: of earlier ones, to be gone on with. told: sentences
    for a person; advance: samples written."""

    def __init__(
        self,
        station: Station,
        plan: Plan,
        writer: Writer,
        *,
        report: Report | None = None,
        told: Callable[[str], None] = lambda _: None,
        advance: Callable[[int], None] = lambda _: None,
        asked_to_end: Callable[[], bool] = lambda: False,
        mount: Mount = lambda _indenter, _count: False,
    ) -> None:
        self.station = station
        self.plan = plan
        self.writer = writer
        self.report = report or Report()
        self._told, self._advance, self._asked, self._mount = told, advance, asked_to_end, mount
        self._session = uuid.uuid4().hex[:12]
        self._method = station.settings.contact.method
        self._since, self._touched_at = 0, 0.0
        self._given_up = 0
        self._recovered_at = -RECOVER_PRESSES
        self._stopped: Counter[int] = Counter(
            int(event["id"]) for event in writer.events if event.get("kind") == "protective-stop"
        )

    @property
    def settings(self) -> Settings:
        return self.station.settings

    def run(self) -> Report:
        """Make what is missing. Raises UserError when it cannot go on.

        Presses that need another indenter are made when ``mount`` says that it is mounted.
        """
        todo = [press for press in self.plan.presses if press.id not in self.writer.done]
        self.report.unmounted = 0
        self.writer.event(
            "session",
            session=self._session,
            todo=len(todo),
            press_mm_s=self.settings.robot.press_mm_s,
            robot=self.station.owner.robot.describe(),
        )
        try:
            for indenter, presses in _mounts(todo, self.settings.indenter):
                if self.report.interrupted or not self._mounted(indenter, len(presses)):
                    self.report.unmounted += len(presses)
                else:
                    self._presses(presses)
        except StopNowError:
            self.report.interrupted = True
        finally:
            self.report.left = len(self.plan) - len(self.writer.done)
        return self.report

    def _mounted(self, indenter: Indenter, count: int) -> bool:
        """Whether it is mounted, if need be by somebody now."""
        if fits(self.settings.indenter, indenter):
            return True
        keys = plans.keys_of(indenter)
        if keys is None:
            return False
        self.station.make_room()
        if not self._mount(indenter, count):
            return False
        self.station.mount(keys)
        return True

    def _presses(self, presses: Iterable[Press]) -> None:
        """With one indenter; its length is not known before it first touches."""
        first = True
        for press in presses:
            if self._asked():
                self.report.interrupted = True
                return
            if first or self._due():
                self._find_touch(first=first)
                first = False
            self._one(press)

    def _due(self) -> bool:
        keys = self.settings.contact
        age_s = (time.monotonic() - self._touched_at) * self.settings.robot.time_scale
        return self._since >= keys.every_presses or age_s >= 60.0 * keys.every_minutes

    def _find_touch(self, *, first: bool) -> None:
        """A new rest frame, and first touch relative to it; all planned poses are checked again."""
        station = self.station
        rest = station.look_at_rest()
        self.writer.reference(rest.image)
        before = station.geometry.z0
        touch = find_touch(station, first=first)
        drift = touch.z0_mm - before
        self.writer.event(
            "touch",
            session=self._session,
            z0_mm=touch.z0_mm,
            spread_mm=touch.spread_mm,
            drift_mm=0.0 if first else drift,
            method=touch.method,
            power=touch.power,
            brightness=rest.brightness,
            pins=rest.pins,
        )
        if not first and abs(drift) > DRIFT_MM:
            self._told(f"first touch drifted by {drift:+.3f} mm")
        plans.check(self.plan, self.settings, station.geometry, turns=station.owner.robot.turns)
        self.report.touches.append(touch)
        self._since, self._touched_at = 0, time.monotonic()

    def _one(self, press: Press) -> None:
        """One press until it is written. Raises UserError after too many bad ones in a row."""
        for attempt in range(1, ATTEMPTS + 1):
            try:
                pressed, reason = one_press(self.station, eased(press.scene))
            except ProtectiveStopError as error:
                self._stop(press, error, attempt)
                return
            except TrippedError as error:
                self._event_of(press, "tripped", str(error))
                if attempt == ATTEMPTS:
                    self._give_up(press, "aborted", str(error), attempt)
                    return
                continue
            if not reason or attempt == ATTEMPTS:
                break
            self._event_of(press, "bad-frame", reason)
        draft = draft_of(
            press,
            pressed,
            session=self._session,
            attempt=attempt,
            method=self._method,
            reason=reason,
        )
        self.writer.add_many([draft])
        self._written(bad=bool(reason), why=f"press {press.id}: {reason}")

    def _written(self, *, bad: bool, why: str = "") -> None:
        self._since += 1
        self._advance(1)
        if not bad:
            self.report.ok += 1
            self._given_up = 0
            return
        self.report.bad += 1
        self._given_up += 1
        self._told(f"{why}; written as bad")
        if self._given_up >= self.settings.safety.give_up:
            raise UserError(
                f"{self._given_up} presses in a row were bad, the last because of {why}; mend "
                "that, then go on with the same command."
            )

    def _give_up(self, press: Press, outcome: str, reason: str, attempt: int) -> None:
        rest = self.station.rest
        assert rest is not None, "looked at before the first press"  # noqa: S101
        self.writer.add_many(
            [
                aborted_draft(
                    press,
                    rest.image,
                    press.scene,
                    outcome="aborted",
                    reason=reason,
                    session=self._session,
                    attempt=attempt,
                    z0=self.station.geometry.z0,
                    method=self._method,
                )
            ]
        )
        self._written(bad=True, why=f"press {press.id}: {outcome}, {reason}")

    def _stop(self, press: Press, error: ProtectiveStopError, attempt: int) -> None:
        """A protective stop: ask by default; release it only where the configuration says so."""
        self.report.stops += 1
        self._stopped[press.id] += 1
        self._event_of(press, "protective-stop", str(error))
        if self._stopped[press.id] >= STOPS_OF_ONE:
            self._give_up(press, "aborted", str(error), attempt)
        robot = self.station.owner.robot
        allowed = self.settings.safety.auto_recover
        enough = self.report.ok + self.report.bad - self._recovered_at >= RECOVER_PRESSES
        if self.report.stops > allowed or not enough or not isinstance(robot, Recovers):
            raise ProtectiveStopError(
                f"{error} It was at press {press.id}. Look at the arm and the sensor, release the "
                "stop on the pendant, and go on with the same command."
            )
        self._recovered_at = self.report.ok + self.report.bad
        recover = robot.recover
        self.station.do(lambda _: recover(), 60.0)
        left = self.station.withdraw()
        if left:
            raise ProtectiveStopError(f"after a protective stop: {left}.")
        self._event_of(press, "recovered", "released as safety.auto_recover allows")
        self._told(f"press {press.id}: a protective stop was released")
        if press.id not in self.writer.done:
            self._give_up(press, "aborted", str(error), attempt)
        self._find_touch(first=False)

    def _event_of(self, press: Press, kind: str, reason: str) -> None:
        self.writer.event(kind, id=press.id, reason=reason, session=self._session)


def _mounts(todo: Iterable[Press], mounted: IndenterKeys) -> list[tuple[Indenter, list[Press]]]:
    """Presses by what they need, what is mounted first."""
    found: dict[Indenter, list[Press]] = {}
    for press in todo:
        found.setdefault(press.scene.indenter, []).append(press)
    return sorted(found.items(), key=lambda item: not fits(mounted, item[0]))
