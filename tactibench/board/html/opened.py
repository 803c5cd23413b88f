"""Answers of the rows of a board, wherever they lie, and frames of their test presses."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench.board.committed import press_errors_of, read_answers_file, split_ranked
from tactibench.board.html.answers import Answered, Truth, answered, unpacked_truth
from tactibench.board.html.drawn import Drawer, Drawn
from tactibench.board.html.material import Board
from tactibench.board.ranking import RANKING
from tactibench.errors import UserError
from tactibench.frames.cache import folder_of
from tactibench.records.identity import canonical
from tactibench.records.record import Record
from tactibench.records.store import StoredRun

TOLERANCE_MM = 1e-6
"""By which errors may differ that are computed again, as in ``tactibench board verify``."""


class Opened:
    """Reads and draws what a board's figures need, each thing once."""

    def __init__(self, board: Board, drawer: Drawer, cache: Path) -> None:
        self.board, self._drawer, self._cache = board, drawer, cache
        self._answers: dict[str, Answered | None] = dict(board.answers)
        self._truths: dict[int, Truth] = {}
        self._agreed: dict[str, bool] = {}
        self._kept: dict[str, dict[int, npt.NDArray[np.uint8]]] = {}

    def of(self, record: Record) -> Answered | None:
        name = record.name
        if name not in self._answers:
            self._answers[name] = self._committed(record)
        return self._answers[name]

    def _committed(self, record: Record) -> Answered | None:
        path, board = self.board.answers_of(record), self.board
        if path is None or record.protocol.hash != board.protocol.hash:
            return None
        drawn = self._drawer.drawn(record)
        if isinstance(drawn, str):
            return None
        try:
            predicted, _ = split_ranked(read_answers_file(path))
            found = answered(board.protocol.keys, self._truth(drawn), predicted)
        except (UserError, KeyError, IndexError, ValueError):
            return None
        key = canonical([record.sensor.json_values(), record.identity.data])
        if key not in self._agreed:  # equal test frames have equal truth
            self._agreed[key] = self._agrees(record, found)
        return found if self._agreed[key] else None

    def _truth(self, drawn: Drawn) -> Truth:
        if id(drawn) not in self._truths:
            self._truths[id(drawn)] = unpacked_truth(self.board.protocol.keys, drawn.truth)
        return self._truths[id(drawn)]

    def _agrees(self, record: Record, found: Answered) -> bool:
        """Whether the drawn truth gives the errors that stand beside the record."""
        stated = self.board.errors.get(record.name)
        if stated is None or self.board.name not in RANKING:
            return False
        again = press_errors_of(found.keys, found.trials)
        return np.array_equal(again.press, stated.press) and np.allclose(
            again.error, stated.error, rtol=0, atol=TOLERANCE_MM
        )

    def why(self, record: Record) -> str:
        """Why there is no truth for the answers of a record, after "which"."""
        if record.name in self.board.runs:
            return "these runs do not have with the present version of the protocol"
        if self.board.answers_of(record) is None:
            return "is not committed"
        drawn = self._drawer.drawn(record)
        return f"is not here ({drawn})" if isinstance(drawn, str) else "does not fit the record"

    def frames(self, record: Record, rows: Sequence[int]) -> dict[int, npt.NDArray[np.uint8]]:
        """Images of some test frames; those that are nowhere to be had are left out.

        From the frame cache, or what a stored run kept, or pressed anew by the sensor.
        """
        found = self._cached(record, rows)
        kept = self._examples(record)
        found |= {row: kept[row] for row in rows if row in kept and row not in found}
        drawn = self._pressing(record)
        lacking = [row for row in rows if row not in found]
        if lacking and isinstance(drawn, Drawn):
            with suppress(UserError):
                found |= drawn.frames(lacking)
        return found

    def frames_key(self, record: Record) -> str:
        """Equal for records whose frames come from one place: stored runs keep some of their own,
        unless all are in the cache."""
        kept = record.name in self.board.runs and self._folders(record) is None
        return canonical([record.identity.test_frames, record.name if kept else ""])

    def at_hand(self, record: Record) -> Sequence[int] | None:
        """Rows of the test frames that there are images of, ascending; None: of all."""
        if self._folders(record) is not None or isinstance(self._pressing(record), Drawn):
            return None
        return sorted(self._examples(record))

    def _pressing(self, record: Record) -> Drawn | str:
        """Only where the presses had to be drawn for the truth already: that takes seconds."""
        if record.name in self.board.runs:
            return "the run keeps frames of its own"
        if self.board.protocol.keys.families:
            return "hard cases are faults of frames, or frames of other sensors"
        return self._drawer.drawn(record)

    def _folders(self, record: Record) -> list[Path] | None:
        keys = record.identity.test_frames or ()
        folders = [folder_of(self._cache, str(key)) for key in keys]
        return folders if folders and all((f / "frames.npy").is_file() for f in folders) else None

    def _cached(self, record: Record, rows: Sequence[int]) -> dict[int, npt.NDArray[np.uint8]]:
        found: dict[int, npt.NDArray[np.uint8]] = {}
        start = 0
        for folder in self._folders(record) or ():
            try:
                images = np.load(folder / "frames.npy", mmap_mode="r")
            except (OSError, ValueError):
                return {}
            inside = (row for row in rows if start <= row < start + len(images))
            found |= {row: np.array(images[row - start], dtype=np.uint8) for row in inside}
            start += len(images)
        return found

    def _examples(self, record: Record) -> dict[int, npt.NDArray[np.uint8]]:
        """Row -> image of the test frames that a stored run kept."""
        name = record.name
        if name not in self._kept:
            self._kept[name] = _examples(self.board.runs.get(name))
        return self._kept[name]


def _examples(run: StoredRun | None) -> dict[int, npt.NDArray[np.uint8]]:
    if run is None:
        return {}
    try:
        kept = run.arrays("examples")
        rows, images = kept["index"].tolist(), kept["images"]
    except (UserError, KeyError):
        return {}
    if images.dtype != np.uint8 or images.ndim not in (3, 4) or len(images) != len(rows):
        return {}
    return dict(zip(rows, images, strict=True))
