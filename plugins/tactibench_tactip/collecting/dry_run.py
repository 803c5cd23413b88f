"""All the moves of a plan, well above the sensor: nothing is touched and nothing kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

from tactibench import UserError
from tactibench.lab import Press
from tactibench_tactip.collecting.plan import Plan, check, eased
from tactibench_tactip.collecting.stops import Stops
from tactibench_tactip.failures import StopNowError
from tactibench_tactip.settings import Settings
from tactibench_tactip.station import Station


def dry_run(
    settings: Settings, presses: Sequence[Press], height: float, advance: Callable[[int], None]
) -> int:
    """Go through the presses ``height`` mm higher; how many were gone through. Raises UserError."""
    room = settings.envelope.above_mm - settings.envelope.clearance_mm - 1.0
    if height > room:
        raise UserError(
            f"--dry-run-height is {height:g} mm, but envelope.above_mm leaves {room:g} mm above "
            "clearance; take less."
        )
    done = 0
    station = Station(settings)
    station.geometry = station.geometry.with_z0(settings.contact.fixed_mm - height)
    plan = Plan("dry run", tuple(presses), {})
    check(plan, settings, station.geometry, turns=station.owner.robot.turns)
    stops = Stops(lambda _: None)
    stops.stop = station.stop_now
    with suppress(StopNowError), stops.installed(), station:
        for press in presses:
            if stops.asked.is_set():
                break
            scene = eased(press.scene)
            trip = station.way(scene)
            with station.at(scene):
                station.do(partial(station.down, trip=trip))
                station.draw_back()
            done += 1
            advance(1)
    return done
