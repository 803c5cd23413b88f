"""Sections of a board: what was asked of one sensor, so that no column mixes two."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from tactibench.board.labels import Part, Record, part_of, section_key, tested_of, trained_on
from tactibench.board.rows import Row, rows_of
from tactibench.records.identity import canonical, digest

NOMINAL, TESTED, OTHER, PERTURBED, FINITE_ELEMENTS = range(5)
KINDS = {
    NOMINAL: "",
    TESTED: "",
    OTHER: "another setting of the sensor",
    PERTURBED: "a perturbed individual",
    FINITE_ELEMENTS: "finite-element scenes",
}
"""Why a section stands beside the first: a model that holds the simulator must not be judged by
that simulator alone."""


@dataclass(frozen=True)
class Section:
    """Rows that answered the same test frames."""

    sensor: Part
    origin: str
    rows: tuple[Row, ...]
    mark: str = ""
    """Of the test frames, where two sections would have one title."""

    @property
    def record(self) -> Record:
        return self.rows[0].first

    @property
    def kind(self) -> int:
        """NOMINAL, TESTED (on what it was not trained for), OTHER, PERTURBED, FINITE_ELEMENTS."""
        if tested_of(self.record) is not None:
            return TESTED
        values: Mapping[str, Any] = self.record["sensor"]["parameters"]
        if values.get("tier") == "fem":
            return FINITE_ELEMENTS
        if values.get("instance", 0) != 0:
            return PERTURBED
        return OTHER if self.sensor.settings else NOMINAL

    @property
    def title(self) -> str:
        """ "Simulated sensor tactip-127, instance=1: a perturbed individual"."""
        tested = tested_of(self.record)
        if tested is not None and (trained := trained_on(self.record)):
            text = f"Real {tested['on']}, trained on {trained}"
            return text + (f" (test frames {self.mark})" if self.mark else "")
        text = f"{self.origin.capitalize()} sensor {self.sensor.text()}"
        if tested:
            text += f", tested on {tested['on']}"
        if why := KINDS[self.kind]:
            text += f": {why}"
        return text + (f" (test frames {self.mark})" if self.mark else "")


def sections_of(records: Iterable[Record]) -> list[Section]:
    """Records by protocol version, sensor and test frames; simulated, then real, nominal first."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(canonical(section_key(record)), []).append(record)
    made = [
        Section(part_of(found[0], "sensor"), found[0]["sensor"]["origin"], tuple(rows_of(found)))
        for found in groups.values()
    ]
    titles = [section.title for section in made]
    named = [
        Section(s.sensor, s.origin, s.rows, _mark(s)) if titles.count(s.title) > 1 else s
        for s in made
    ]
    return sorted(named, key=lambda s: (s.origin != "simulated", s.kind, s.title))


def _mark(section: Section) -> str:
    return digest(section_key(section.record))[:8]
