"""A small recording of a skin on which several named places are touched at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from tactibench.datasets import Draft, Header, Writer

PLACES = ("thumb", "palm", "wrist", "knuckle")
CHANNELS = 40


def subsets(places: Sequence[str] = PLACES) -> list[tuple[str, ...]]:
    """Return the 15 sets of touched places."""
    return [some for count in (1, 2, 3, 4) for some in combinations(places, count)]


def write_places(
    folder: Path,
    *,
    repeats: int = 4,
    singles: int = 8,
    noise: float = 0.2,
    touched: float = 1.0,
    places: Sequence[str] = PLACES,
) -> Path:
    """Write a data set of two sessions: fields of places add up, each with a gain of its own.

    Args:
        folder: Folder of the new data set.
        repeats: Trials of every set of places in a session.
        singles: The same of sets of one place.
        noise: Deviation of every channel, that of a field being 1.
        touched: Label of a touched place.
        places: Names of the places.
    """
    rng = np.random.default_rng(3)
    fields = rng.standard_normal((len(places), CHANNELS))
    header = Header("places", {"name": "skin"}, None, signal=(CHANNELS,), sites=places)
    with Writer(folder, header, fsync=False) as writer:
        for session in ("morning", "evening"):
            changed = fields + 0.15 * rng.standard_normal(fields.shape)
            for some in subsets(places):
                on = np.array([name in some for name in places])
                for _ in range(singles if len(some) == 1 else repeats):
                    gains = on * rng.uniform(0.8, 1.2, len(places))
                    signal = gains @ changed + noise * rng.standard_normal(CHANNELS)
                    labels = dict(zip(places, (touched * on).tolist(), strict=True))
                    number = len(writer.samples)
                    writer.add(
                        Draft(signal.astype(np.float32), number, None, labels, session=session)
                    )
    return folder
