"""Answers to the test frames: asked once, kept in the cache under the identity of the whole run.

A second store, or a run that was stopped while it was timed, does not ask the model again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer
from tactibench.errors import UserError
from tactibench.records.answers import pack, unpack_contacts, unpack_plates
from tactibench.records.files import arrays_hash, read_arrays, write_arrays

Arrays = dict[str, npt.NDArray[Any]]
SEAL, HEAT, ANSWER = "seal", "heat", "answer."


@dataclass(frozen=True, eq=False)
class Answered:
    """predicted: packed answers, as stored with a run. heat: (N, H, W) heatmaps, or None."""

    predicted: Arrays
    heat: npt.NDArray[np.float16] | None

    def answers(self, kind: str) -> list[Answer | None]:
        """The answers themselves."""
        unpack = unpack_plates if kind == "plate" else unpack_contacts
        return list(unpack(self.predicted))


def answered(
    path: Path,
    weights_hash: str,
    kind: str,
    ask: Callable[[], tuple[list[Answer | None], npt.NDArray[np.float16] | None]],
    *,
    fresh: bool,
    beside: Callable[[], Arrays] = dict,
) -> Answered:
    """The kept answers of these very weights, or what ``ask`` gives; ``fresh`` always asks.

    beside: what is kept and stored beside the answers, asked for after them.
    """
    kept = None if fresh else _kept(path, weights_hash)
    if kept is not None:
        return kept
    answers, heat = ask()
    made = Answered({**pack(answers, kind), **beside()}, heat)
    arrays = _arrays(made)
    write_arrays(path, {**arrays, SEAL: np.array(_seal(arrays, weights_hash))})
    return made


def _kept(path: Path, weights_hash: str) -> Answered | None:
    """What the file holds, when it is whole and was made with these weights."""
    try:
        arrays = read_arrays(path)
        seal = str(arrays.pop(SEAL))
    except (UserError, KeyError):
        return None
    if seal != _seal(arrays, weights_hash):
        return None
    heat = arrays.pop(HEAT, None)
    return Answered({name.removeprefix(ANSWER): a for name, a in arrays.items()}, heat)


def _arrays(made: Answered) -> Arrays:
    arrays = {f"{ANSWER}{name}": array for name, array in made.predicted.items()}
    return arrays if made.heat is None else {**arrays, HEAT: made.heat}


def _seal(arrays: Arrays, weights_hash: str) -> str:
    return f"{weights_hash} {arrays_hash(arrays)}"
