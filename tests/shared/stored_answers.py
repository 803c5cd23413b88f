"""Arrays of a stored run of exp1, small and consistent, for all that reads answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from changed_record import changed_record

from tactibench.contacts import Contacts
from tactibench.records import (
    PARTS,
    Arrays,
    Record,
    StoredRun,
    arrays_hash,
    complete_run,
    held_name,
    pack_contacts,
    write_answers,
)


def answered_parts(
    offset: float = 0.05, frames: int = 6, seed: int = 0, missing: tuple[int, ...] = ()
) -> dict[str, dict[str, Any]]:
    """PARTS of a run whose answers are off by ``offset`` mm along x, and absent in some frames."""
    places = np.random.default_rng(seed).uniform(-6, 6, (frames, 2))
    truth = [Contacts.truth([place], [2.0]) for place in places]
    found = [
        Contacts.none() if k in missing else Contacts.truth([place + np.array([offset, 0])], [2.0])
        for k, place in enumerate(places)
    ]
    parts: dict[str, dict[str, Any]] = {name: {"values": np.arange(4.0)} for name in PARTS}
    parts["truth"] = {
        **pack_contacts(truth),
        "press": np.array([f"singles-{k}" for k in range(frames)]),
        "group": np.array(["all"] * frames),
    }
    parts["predictions"] = pack_contacts(found)
    return parts


def write_run(store: Path, record: Record, parts: dict[str, Arrays]) -> StoredRun:
    """Store a run as a whole."""
    with held_name(store, record.name):
        answers = write_answers(store, record, parts)
        return complete_run(answers, answers.record)


def store_run(
    store: Path, record: Record, parts: dict[str, dict[str, Any]] | None = None
) -> StoredRun:
    """Write a run with these arrays, and with the hash of its predictions in the record."""
    parts = parts or answered_parts()
    hashed = arrays_hash(parts["predictions"])
    return write_run(store, changed_record(record, {"identity.predictions_hash": hashed}), parts)
