"""What should be answered to test frames, and how it is kept: part ``truth`` of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tactibench.contacts import Answer
from tactibench.frames.presses import Presses
from tactibench.protocols.schema import Protocol
from tactibench.records.answers import pack
from tactibench.records.store import Arrays


def true_answers(keys: Protocol, opened: Iterable[Presses]) -> list[Answer]:
    """Of every frame of several presses, in order, the answer that the protocol asks for."""
    radius = keys.workspace.dome_radius_mm
    return [answer for presses in opened for answer in presses.truth(keys.answer, radius)]


def truth_arrays(
    keys: Protocol, answers: Sequence[Answer], presses: Sequence[str], groups: Sequence[str]
) -> Arrays:
    """Packed answers with ``press`` and ``group`` of every frame."""
    return {
        **pack(answers, keys.answer),
        "press": np.array(presses),
        "group": np.array(groups),
    }
