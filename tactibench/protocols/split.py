"""Division into training, validation and test presses. A press is in one part only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.protocols.schema import Recorded, Split

SPLIT_STREAM = 0
"""Spawn key of the data seed that permutes presses; draws use 1 and above."""
FIT, VALIDATION, TEST, WHOLE = 0, 1, 2, 3
"""Parts of a draw; the frames of each have noise of their own."""
CHUNK = 250
"""Presses that a sensor makes with one seed: about a fifth of a second of work is lost by an
interruption. Another number would make other frames."""


class PressSplit(NamedTuple):
    """Indices of the presses that train, validate and test."""

    fit: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]


def split_presses(count: int, split: Split, data_seed: int) -> PressSplit:
    """Divide ``count`` drawn presses by a seeded permutation."""
    order = permutation(count, data_seed)
    return _parts(order, split.test, split.validation)


def split_recorded(
    names: Sequence[str], spec: Recorded, data_seed: int, published: Sequence[str] | None
) -> PressSplit:
    """Divide recorded presses.

    Args:
        names: Name of every press.
        spec: Shares of the parts.
        data_seed: Seed of the permutation.
        published: Names of published test frames, which are taken as they are; None: there are
            none.

    Raises:
        UserError: A part would have no press.
    """
    if published is not None:
        index = {name: i for i, name in enumerate(names)}
        test = [index[name] for name in published]
        left = sorted(set(range(len(names))) - set(test))
        order = np.array(left, dtype=np.int64)[permutation(len(left), data_seed)]
        parts = _parts(order, 0, round(spec.validation_share * len(left)))
        return _trainable(PressSplit(parts.fit, parts.validation, tuple(sorted(test))), len(names))
    test_count = round(spec.test_share * len(names))
    validation = round(spec.validation_share * (len(names) - test_count))
    order = permutation(len(names), data_seed)
    return _trainable(_parts(order, test_count, validation), len(names))


def _trainable(parts: PressSplit, count: int) -> PressSplit:
    if not (parts.fit and parts.validation and parts.test):
        raise UserError(
            f"the data folder holds {count:,} presses, of which {len(parts.fit):,} would train, "
            f"{len(parts.validation):,} validate and {len(parts.test):,} test a model; each part "
            "needs at least one: record more presses."
        )
    return parts


def permutation(count: int, data_seed: int) -> npt.NDArray[np.int64]:
    """Return the seeded order, (count,), in which presses are divided."""
    seed = np.random.SeedSequence(data_seed, spawn_key=(SPLIT_STREAM,))
    return np.random.default_rng(seed).permutation(count)


def _parts(order: npt.NDArray[np.int64], test: int, validation: int) -> PressSplit:
    return PressSplit(
        fit=tuple(sorted(order[test + validation :].tolist())),
        validation=tuple(sorted(order[test : test + validation].tolist())),
        test=tuple(sorted(order[:test].tolist())),
    )
