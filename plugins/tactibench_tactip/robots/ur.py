"""A UR arm through ``ur_rtde``, which runs in a process of its own.

Moves are asynchronous and bounded: ``moveUntilContact`` has no limit of travel (and does nothing on
CB3), and a blocking ``moveL`` beside a watchdog kick loses the handshake that ends it.
"""

from __future__ import annotations

import time

from tactibench_tactip.failures import ProtectiveStopError, RobotError
from tactibench_tactip.geometry.frames import apart, from_ur, to_ur, turned_by
from tactibench_tactip.robots.base import RobotState
from tactibench_tactip.robots.ur_dashboard import Dashboard
from tactibench_tactip.robots.ur_link import UrLink
from tactibench_tactip.robots.ur_safety import normal, protective, safety_words
from tactibench_tactip.settings import Pose6, Settings

GRACE_S = 1.5
"""Host seconds of standing short of the target, with no word of a move, that end one."""
NEAR_MM, NEAR_DEG = 0.05, 0.1
RUNNING = 7
RECOVERY_S = 15.0
UNLOCK_AFTER_S = 5.0


class UrRobot:
    """The base frame is the controller's; the TCP is that of the configuration."""

    turns = True

    def __init__(self, settings: Settings) -> None:
        self._keys = settings.robot
        self._tcp = settings.frames.tcp_pose
        self._link: UrLink | None = None
        self._dashboard: Dashboard | None = None
        self._closed = False
        self._target: Pose6 | None = None
        self._stands: tuple[Pose6, float] = ((0.0,) * 6, 0.0)

    def connect(self) -> None:
        keys = self._keys
        self._dashboard = Dashboard(keys.address)
        self._dashboard.demand_ready()
        self._link = UrLink(keys.address, to_ur(self._tcp), keys.watchdog_hz, keys.connect_s)
        if self._closed:  # nobody waited for it
            self._link.close()

    def start(self, pose: Pose6, speed: float, acceleration: float) -> None:
        self._must(self._there.ask("start", to_ur(pose), 1e-3 * speed, 1e-3 * acceleration))
        self._target, self._stands = pose, (self.pose(), time.monotonic())

    def moving(self) -> bool:
        """Also until it is where it was sent, for a while: the word that a move goes on comes a
        little after its begin."""
        now, here = time.monotonic(), self.pose()
        if self._there.facts()["moving"]:
            self._stands = here, now
            return True
        if self._target is None or _same(here, self._target):
            return False
        if not _same(here, self._stands[0]):
            self._stands = here, now
        return now - self._stands[1] < GRACE_S

    def pose(self) -> Pose6:
        return from_ur(self._there.facts()["pose"])

    def stop(self) -> None:
        self._target = None
        self._must(self._there.ask("stop"))

    def state(self) -> RobotState:
        facts = self._there.facts()
        bits, mode = facts["bits"], facts["mode"]
        words = safety_words(bits, mode)
        good = normal(bits) and mode == RUNNING
        if good and not facts["program"]:
            good, words = False, "its control program ended (watchdog, pendant or another client)"
        fx, fy, fz = facts["force"]
        return RobotState(
            good, f"the UR says: {words}", protective(bits), (fx, fy, fz), facts["time"]
        )

    def tick(self) -> None:
        """The process that holds the arm kicks its watchdog."""

    def recover(self) -> None:
        """Release a protective stop: wait, unlock, load the program again. Raises RobotError for
        every other kind of stop, and when the controller refuses."""
        assert self._dashboard is not None, "connected"  # noqa: S101
        facts = self._there.facts()
        if not protective(facts["bits"]):
            words = safety_words(facts["bits"], facts["mode"])
            raise RobotError(f"only a protective stop is released; the UR says: {words}.")
        time.sleep(UNLOCK_AFTER_S / self._keys.time_scale)
        end = time.monotonic() + RECOVERY_S
        self._dashboard.unlock(end, 1.0 / self._keys.time_scale)
        while not normal(self._there.facts()["bits"]):
            if time.monotonic() > end:
                raise RobotError("the protective stop was not released; do it on the pendant.")
            time.sleep(0.01)
        self._must(self._there.ask("reload", 2.0, wait_s=RECOVERY_S))
        self._target = None

    def close(self) -> None:
        self._closed = True
        if self._link is not None:
            self._link.close()
        if self._dashboard is not None:
            self._dashboard.close()

    def describe(self) -> dict[str, str]:
        version = "" if self._dashboard is None else self._dashboard.version
        return {"driver": "ur", "polyscope": version}

    @property
    def _there(self) -> UrLink:
        assert self._link is not None, "connected"  # noqa: S101
        return self._link

    def _must(self, wrong: str) -> None:
        if not wrong:
            return
        state = self.state()
        kind = ProtectiveStopError if state.stopped else RobotError
        raise kind(f"the UR refuses: {wrong} ({state.words}).")


def _same(one: Pose6, other: Pose6) -> bool:
    return apart(one, other) < NEAR_MM and turned_by(one, other) < NEAR_DEG
