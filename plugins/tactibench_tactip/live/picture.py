"""One picture of a turn: the frame with its pins, the heatmap with the contacts, the figures."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactibench import Contacts, PlatePose
from tactibench.markers import Tracker
from tactibench_tactip.camera.source import Image
from tactibench_tactip.live.loop import Seen

SIDE = 480
HALF_MM = 12.8
"""Of the heatmap's grid."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
_RED, _GREEN, _WHITE = (60, 60, 255), (80, 220, 80), (235, 235, 235)

Picture = npt.NDArray[np.uint8]


class Painter:
    """rest: of the undeformed sensor; pins are followed from there where there are any."""

    def __init__(self, rest: Image) -> None:
        from tactibench import UserError

        try:
            self._tracker: Tracker | None = Tracker(rest, refine="centroid")
        except UserError:
            self._tracker = None

    def draw(self, seen: Seen, label: str) -> Picture:
        """(SIDE + 60, 2 SIDE, 3) uint8, blue, green, red."""
        text = np.zeros((60, 2 * SIDE, 3), np.uint8)
        words = (
            f"{label}   {seen.latency_ms:5.1f} ms from frame to answer   {describe(seen.answer)}"
        )
        cv2.putText(text, words[:110], (10, 36), FONT, 0.5, _WHITE, 1, cv2.LINE_AA)
        panels = np.hstack([self._frame(seen.shot.image), _map(seen)])
        return np.vstack([panels, text])

    def _frame(self, image: Image) -> Picture:
        big = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
        panel: Any = cv2.cvtColor(big, cv2.COLOR_GRAY2BGR)
        if self._tracker is not None:
            tracks = self._tracker.track(image[None])
            scale = np.array([SIDE / image.shape[1], SIDE / image.shape[0]])
            starts = ((self._tracker.rest + 0.5) * scale).astype(int)
            ends = ((tracks.xy[0] + 0.5) * scale).astype(int)
            for start, end, good in zip(starts, ends, tracks.seen[0], strict=True):
                cv2.line(panel, start.tolist(), end.tolist(), _GREEN if good else _RED, 1)
                cv2.circle(panel, end.tolist(), 2, _GREEN if good else _RED, -1)
        return np.asarray(panel, dtype=np.uint8)


def describe(answer: Contacts | PlatePose | None) -> str:
    """Contacts in words."""
    if isinstance(answer, PlatePose):
        return f"plate {answer.depth:.2f} mm deep, tilted {answer.tilt:.1f} deg"
    if answer is None or not len(answer):
        return "no contact"
    found = zip(answer.xy.tolist(), answer.depth.tolist(), strict=True)
    return "; ".join(f"({x:+.2f}, {y:+.2f}) {depth:.2f} mm" for (x, y), depth in found)


def _map(seen: Seen) -> Picture:
    panel: Any = np.zeros((SIDE, SIDE, 3), np.uint8)
    if seen.maps is not None:
        heat = np.clip(255.0 * seen.maps[0], 0, 255).astype(np.uint8)
        big = cv2.resize(heat, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
        panel = cv2.applyColorMap(big, cv2.COLORMAP_VIRIDIS)
    if isinstance(seen.answer, Contacts):
        for x, y in seen.answer.xy.tolist():
            at = tuple(int(SIDE / 2 * (1 + value / HALF_MM)) for value in (x, y))
            cv2.drawMarker(panel, at, _WHITE, cv2.MARKER_CROSS, 22, 2)
    return np.asarray(panel, dtype=np.uint8)
