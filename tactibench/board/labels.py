"""How a run is called on a board, read from its record alone."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Record = Mapping[str, Any]
MIXING = "mixing"
"""The parameter of a model that trains on contacts mixed out of single presses."""
TRIVIAL = frozenset({"mean", "nearest"})
"""Models that learn next to nothing: what any other has to beat."""

_FIELDS = ("protocol", "model", "regime", "encoder", "sensor", "seed")
_SIGNATURE = re.compile(
    "".join(rf"(?:^|\|){name}:(?P<{name}>.*?)" for name in _FIELDS[:-1]) + r"\|seed:"
)
_SETTINGS = re.compile(r"(?P<name>[^(]*)\((?P<settings>.*)\)")


@dataclass(frozen=True)
class Part:
    """A model, encoder or sensor: its name and those parameters that are not at their defaults."""

    name: str
    settings: tuple[tuple[str, str], ...] = ()

    def text(self, *, without: str = "") -> str:
        """ "unet, width=32"."""
        other = (f"{key}={value}" for key, value in self.settings if key != without)
        return ", ".join([self.name, *other])


def part_of(record: Record, kind: str) -> Part:
    """The model, encoder or sensor of a record.

    Which parameters differ from their defaults is what the record's signature says: the defaults of
    today's plugins may be others.
    """
    whole = record.get(kind)
    if whole is None:
        return Part("none")
    found = _SIGNATURE.search(record["signature"])
    label = found[kind] if found else whole["name"]
    match = _SETTINGS.fullmatch(label)
    if match is None:
        return Part(whole["name"])
    pairs = (pair.partition("=") for pair in match["settings"].split(","))
    return Part(whole["name"], tuple((key, value) for key, _, value in pairs))


def mixing_of(record: Record) -> str:
    """Frames mixed out of single presses for every training frame, "" for none."""
    share = record["model"]["parameters"].get(MIXING)
    return f"{share:g}" if isinstance(share, int | float) and share > 0 else ""


def label_of(record: Record) -> str:
    """Model, encoder where there is one, mixing and regime, in one line."""
    model, encoder = part_of(record, "model"), part_of(record, "encoder")
    text = model.text(without=MIXING)
    if encoder.name != "none":
        text += f" + {encoder.text()}"
    if mixing := mixing_of(record):
        text += f", mixing {mixing}"
    return f"{text} ({record['regime']})"


def row_key(record: Record) -> Any:
    """All that two records must share to be seeds of one row, as JSON values."""
    return [
        section_key(record),
        record["model"],
        record["encoder"],
        record["regime"],
        presses_of(record),
    ]


def section_key(record: Record) -> Any:
    """All that two records must share to stand in one table: question, sensor, test frames."""
    sensor = record["sensor"]
    key = [
        record["protocol"]["id"],
        record["protocol"]["hash"],
        sensor["origin"],
        sensor["name"],
        sensor["parameters"],
        record["identity"].get("data"),
    ]
    tested = tested_of(record)
    if tested is None:
        return key
    found = [*key, tested["name"], tested["parameters"]]
    return [*found, trained] if (trained := trained_on(record)) else found


def tested_of(record: Record) -> Mapping[str, Any] | None:
    """What pressed the test scenes, where it was not the sensor (see ``TestedId``)."""
    tested: Mapping[str, Any] | None = record["sensor"].get("tested")
    return tested


def trained_on(record: Record) -> str:
    """Which sensor a model was trained on that was tested on another one; "" where on the same."""
    return (tested_of(record) or {}).get("trained_on") or ""


def asked_of(record: Record) -> str:
    """The options that ask for what a run was tested on: " --test reference", or ""."""
    tested = tested_of(record)
    if tested is None:
        return ""
    return "".join(
        " --hidden-seed" if text == "hidden" else f" --test {text}" for text in tested["asked"]
    )


def measured_on(record: Record) -> str:
    """ "simulated sensor tactip-127", and what it was tested on, where that is something else."""
    sensor, tested = record["sensor"], tested_of(record)
    if tested is not None and (trained := trained_on(record)):
        return f"real {tested['on']}, trained on {trained}"
    text = f"{sensor['origin']} sensor {sensor['name']}"
    return text if tested is None else f"{text}, tested on {tested['on']}"


def trained_for(records: Iterable[Record]) -> list[Record]:
    """Those that were tested on the sensor that they were trained for."""
    return [record for record in records if tested_of(record) is None]


def whole(records: Iterable[Record]) -> list[Record]:
    """Those that learned from all presses; the others belong to a learning curve alone."""
    return [record for record in records if presses_of(record) is None]


def presses_of(record: Record) -> int | None:
    """How many presses a run was allowed to learn from; None for all of them."""
    presses = (record.get("limits") or {}).get("presses")
    return None if presses is None else int(presses)
