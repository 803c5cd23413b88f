"""Scoring a stored run again, without its model or sensor."""

from __future__ import annotations

from tactibench.errors import UserError
from tactibench.protocols.loader import LoadedProtocol, protocol_files, read_protocol
from tactibench.records.files import arrays_hash
from tactibench.records.record import Metric, Record
from tactibench.records.store import StoredRun
from tactibench.run.score import score_arrays


def rescored(run: StoredRun) -> Record:
    """The run's record with metrics computed anew. Raises UserError.

    The protocol must be the very one of the run: another version asks something else.
    """
    protocol = protocol_of(run)
    truth, predicted = run.arrays("truth"), run.arrays("predictions")
    if arrays_hash(predicted) != run.record.identity.predictions_hash:
        raise UserError(f"the predictions in {run.folder} are not those of its record.")
    metrics = score_arrays(protocol.keys, truth, predicted, run.arrays("maps"))
    return run.record.model_copy(update={"metrics": metrics})


def protocol_of(run: StoredRun) -> LoadedProtocol:
    """The protocol that a run was made with. Raises UserError where it is not installed."""
    stated = run.record.protocol
    path = protocol_files().get(stated.id)
    if path is None:
        raise UserError(
            f"{run.folder} was made with protocol {stated.id!r}, which does not ship with "
            "tactibench; run it again with its .toml file."
        )
    protocol = read_protocol(path)
    if protocol.hash != stated.hash:
        raise UserError(
            f"{run.folder} was made with {stated.label}, but this tactibench "
            f"has {protocol.label}; run the protocol again."
        )
    return protocol


def differences(stored: list[Metric], again: list[Metric]) -> list[str]:
    """A sentence for each row that is not exactly equal."""
    before, after = (
        {(row.metric, row.group): row.json_values() for row in rows} for rows in (stored, again)
    )
    return [
        f"{metric} of {group}: stored {before.get((metric, group))}, "
        f"now {after.get((metric, group))}"
        for metric, group in sorted({*before, *after})
        if before.get((metric, group)) != after.get((metric, group))
    ]
