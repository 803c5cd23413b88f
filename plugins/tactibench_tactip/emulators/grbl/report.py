"""Status reports, with GRBL's rules for what stands in which of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from tactibench_tactip.emulators.grbl.modes import INCH
from tactibench_tactip.emulators.grbl.planner import BLOCKS

if TYPE_CHECKING:
    from tactibench_tactip.emulators.grbl.controller import Controller

OFFSET_EVERY = {True: 30, False: 10}
OVERRIDES_EVERY = {True: 20, False: 10}
"""Reports while it is busy, and while it is not (config.h of 1.1h)."""


class Report:
    """Counts reports since a reset: offsets and overrides come in some of them only."""

    def __init__(self) -> None:
        self._offset_in, self._overrides_in = 0, 0

    def overrides_due(self) -> None:
        """They changed."""
        self._overrides_in = 0

    def offset_due(self) -> None:
        self._offset_in = 0

    def status(self, grbl: Controller) -> str:
        """``<State|MPos:x,y,z|...>``."""
        mask, inches = int(grbl.settings["$10"]), bool(grbl.settings["$13"])
        place = grbl.stage.place(grbl.t)
        offset = grbl.systems[grbl.modes.system] + grbl.modes.shift
        if mask & 1:
            fields = [_state(grbl), f"MPos:{axes(place, inches)}"]
        else:
            fields = [_state(grbl), f"WPos:{axes(place - offset, inches)}"]
        if mask & 2:
            fields.append(f"Bf:{BLOCKS - len(grbl.planner)},{grbl.free_bytes}")
        speed = grbl.speed_mm_min() / (INCH if inches else 1.0)
        fields.append(f"FS:{speed:.0f},{grbl.modes.speed:.0f}")
        if grbl.touching():
            fields.append("Pn:P")
        busy = grbl.moving or grbl.state in {"Hold", "Door"}
        if self._offset_in == 0:
            fields.append(f"WCO:{axes(offset, inches)}")
            self._offset_in = OFFSET_EVERY[busy] - 1
            self._overrides_in = max(self._overrides_in, 1)
        else:
            self._offset_in -= 1
            if self._overrides_in == 0:
                feed, rapid = grbl.planner.feed_share, grbl.planner.rapid_share
                fields.append(f"Ov:{feed * 100:.0f},{rapid * 100:.0f},100")
                self._overrides_in = OVERRIDES_EVERY[busy]
        self._overrides_in = max(self._overrides_in - 1, 0)
        return f"<{'|'.join(fields)}>"


def axes(values: Iterable[float], inches: bool = False) -> str:
    """``x,y,z`` with three decimals, in inches four; no minus zero."""
    if inches:
        return ",".join(f"{value / INCH + 0.0:.4f}" for value in values)
    return ",".join(f"{round(float(value), 3) + 0.0:.3f}" for value in values)


def _state(grbl: Controller) -> str:
    if grbl.state in {"Hold", "Door"}:
        return f"{grbl.state}:{'0' if grbl.held else {'Hold': '1', 'Door': '2'}[grbl.state]}"
    return grbl.state
