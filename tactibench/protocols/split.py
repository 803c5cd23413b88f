"""Dividing presses into training, validation and test presses. A press is in one part only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactibench.errors import UserError
from tactibench.protocols.schema import Recorded, Split

SPLIT_STREAM = 0
"""Spawn key of the data seed that permutes presses; draws use 1 and above."""


@dataclass(frozen=True)
class Parts:
    """Indices of presses, each sorted."""

    fit: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]


def split_presses(count: int, split: Split, data_seed: int) -> Parts:
    """Divide ``count`` drawn presses by a seeded permutation."""
    order = _permutation(count, data_seed)
    return _parts(order, split.test, split.validation)


def split_recorded(
    names: Sequence[str], keys: Recorded, data_seed: int, published: Sequence[str] | None
) -> Parts:
    """Divide recorded presses; ``published`` test frames are taken as they are.

    Raises UserError when the folder has too few presses to train, validate and test.
    """
    if published is not None:
        index = {name: i for i, name in enumerate(names)}
        test = [index[name] for name in published]
        left = sorted(set(range(len(names))) - set(test))
        order = np.array(left)[_permutation(len(left), data_seed)]
        n = round(keys.validation_share * len(left))
        parts = _parts(order, 0, n)
        return Parts(parts.fit, parts.validation, tuple(sorted(test)))
    test_count = round(keys.test_share * len(names))
    validation = round(keys.validation_share * (len(names) - test_count))
    if min(test_count, validation, len(names) - test_count - validation) < 1:
        raise UserError(
            f"the data folder holds {len(names)} presses, too few to train, validate and test; "
            "record at least 12."
        )
    return _parts(_permutation(len(names), data_seed), test_count, validation)


def _permutation(count: int, data_seed: int) -> np.ndarray:
    seed = np.random.SeedSequence(data_seed, spawn_key=(SPLIT_STREAM,))
    return np.random.default_rng(seed).permutation(count)


def _parts(order: np.ndarray, test: int, validation: int) -> Parts:
    pick = lambda part: tuple(sorted(int(i) for i in part))  # noqa: E731
    return Parts(
        pick(order[test + validation :]), pick(order[test : test + validation]), pick(order[:test])
    )
