"""A stored record knows its own digest: a byte that changed on a disk is no other result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactibench.errors import UserError
from tactibench.records.identity import digest

SEAL = "sealed"
"""Key of a record's identity. It says that nothing changed by accident; who changes a record on
purpose writes another seal, and is found out by ``tactibench board verify``."""

Record = Mapping[str, Any]


def unsealed(record: Record) -> dict[str, Any]:
    """The record without its seal, as it is committed to a board."""
    identity = {name: value for name, value in record["identity"].items() if name != SEAL}
    return {**record, "identity": identity}


def sealed(record: Record) -> dict[str, Any]:
    """The record with the digest of everything else in it."""
    plain = unsealed(record)
    return {**plain, "identity": {**plain["identity"], SEAL: digest(plain)}}


def refuse_changed(record: Record, where: str) -> None:
    """Raise UserError for a sealed record that is not what was written. Older ones have no seal."""
    seal = record["identity"].get(SEAL)
    if seal is not None and seal != digest(unsealed(record)):
        raise UserError(
            f"{where} is not what was written: a value in it was changed; run the protocol again "
            "with --fresh."
        )
