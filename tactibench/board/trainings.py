"""One name, one training: rows of one name and seed have one set of weights on all boards.

A row is named by model, parameters, regime, encoder and sensor. A reader of two boards takes rows
of the same name for the same model. Trained twice, with other epochs or another version of the
code, they are two models. Protocols that draw other presses to train, such as ``fine`` with its
small tips, are no boards of the same model.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from tactibench.board.grouping import training_sensor
from tactibench.board.rows import label_of, trained_on
from tactibench.board.shipped import deterministic_models
from tactibench.protocols import LoadedProtocol, Protocol
from tactibench.records import Record, canonical


@dataclass(frozen=True)
class Trainings:
    """The trainings behind a board.

    Attributes:
        contradictions: A sentence for each record whose weights are not those of its name.
        names: Number of names and seeds that were compared.
        older: Number of records without a checksum; they were made before this rule.
        older_names: Number of names among these that have several trainings.
    """

    contradictions: tuple[str, ...]
    names: int
    older: int
    older_names: int

    @property
    def note(self) -> str:
        """Sentences on what was compared, and what was not."""
        count = "1 training has" if self.names == 1 else f"{self.names} trainings have"
        text = f"{count} one set of weights each"
        if not self.older:
            return f"{text}."
        return (
            f"{text}. Not held to that: {self.older} older records without a checksum, among them "
            f"names with several trainings: {self.older_names}."
        )


def compare_trainings(records: Iterable[tuple[Record, LoadedProtocol]]) -> Trainings:
    """Compare the weights of records.

    Records of a present version with a checksum must keep the rule. Records without a checksum are
    counted only.

    Args:
        records: Records, each with the version of its protocol that it stands with.
    """
    sealed: dict[str, list[Record]] = {}
    older: dict[str, list[Record]] = {}
    for record, protocol in records:
        group = older if record.identity.checksum is None else sealed
        group.setdefault(canonical(training_key(record, protocol.spec)), []).append(record)
    return Trainings(
        tuple(sentence for same_name in sealed.values() for sentence in _contradictions(same_name)),
        len(sealed),
        sum(map(len, older.values())),
        sum(len(_hashes(same_name)) > 1 for same_name in older.values()),
    )


def training_key(record: Record, protocol: Protocol) -> list[Any]:
    """Return everything that the name of a training holds, as JSON values.

    The kind of answer, the presses that are drawn to train, and whether a training is for another
    sensor, are part of it: they follow from the protocol and change what is learned. A model that
    draws nothing has one training for all seeds.
    """
    transfers = protocol.transfer is not None
    draws = transfers or record.model.name not in deterministic_models()
    return [
        record.model.identity,
        record.regime,
        None if record.encoder is None else record.encoder.identity,
        training_sensor(record),
        None if record.sensor.recording is None else record.sensor.recording.sha256,
        None if record.sensor.range is None else record.sensor.range.json_values(),
        trained_on(record),
        record.data.train,
        record.limits.presses,
        [protocol.answer, transfers],
        _training_presses(protocol, record.regime),
        record.seed if draws else "any",
    ]


def _training_presses(protocol: Protocol, regime: str) -> list[Any]:
    """Return what determines the presses that a protocol draws to train; [] where it draws none."""
    if protocol.split is None:
        return []
    draws = (protocol.split.draw, *protocol.regimes.get(regime, ()))
    parts = (protocol.workspace, protocol.grid, protocol.split, *map(protocol.draw, draws))
    return [protocol.data_seed, *(part.model_dump(mode="json") for part in parts)]


def _hashes(records: Sequence[Record]) -> set[str]:
    return {record.identity.weights_hash for record in records}


def _contradictions(records: Sequence[Record]) -> list[str]:
    first, *others = sorted(records, key=lambda record: (record.created, record.name))
    return [
        f"{first.name} and {other.name} are both seed {other.seed} of {label_of(other)}, but have "
        f"weights {first.identity.weights_hash[:8]} and {other.identity.weights_hash[:8]}; run "
        "both with one training, and add them again."
        if first.seed == other.seed
        else f"{first.name} and {other.name} are seeds {first.seed} and {other.seed} of "
        f"{label_of(other)}, which draws nothing when it is trained, but have weights "
        f"{first.identity.weights_hash[:8]} and {other.identity.weights_hash[:8]}; run both anew "
        "on one machine."
        for other in others
        if other.identity.weights_hash != first.identity.weights_hash
    ]
