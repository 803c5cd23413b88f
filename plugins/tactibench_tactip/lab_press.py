"""One press with the look after it: what tells a camera that lags from one that does not."""

from __future__ import annotations

from tactibench import Scene
from tactibench_tactip.station import Pressed, Station


def one_press(station: Station, scene: Scene) -> tuple[Pressed, str]:
    """The press, and why its frame cannot be kept, "" when it can. Raises as ``Station.press``."""
    station.demand_undeformed()
    pressed = station.press(scene)
    reason = pressed.judged.reason
    if not station.looks_undeformed(pressed.judged.image) and not reason:
        reason = "the frame after it still shows a contact: the camera lags, or the skin sticks"
    return pressed, reason
