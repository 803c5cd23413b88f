"""Sections of a board: what was asked of one sensor, so that no column mixes two."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tactibench.board.labels import section_key, trained_on
from tactibench.board.rows import Row, rows_of
from tactibench.records.identity import canonical, digest
from tactibench.records.record import Record, SensorId

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

    rows: tuple[Row, ...]
    mark: str = ""
    """Of the test frames, where two sections would have one title."""

    @property
    def record(self) -> Record:
        return self.rows[0].first

    @property
    def sensor(self) -> SensorId:
        return self.record.sensor

    @property
    def origin(self) -> str:
        return self.sensor.origin

    @property
    def kind(self) -> int:
        """NOMINAL, TESTED (on what it was not trained for), OTHER, PERTURBED, FINITE_ELEMENTS."""
        if self.record.test_sensor is not None:
            return TESTED
        values = self.sensor.parameters
        if values.get("tier") == "fem":
            return FINITE_ELEMENTS
        if values.get("instance", 0) != 0:
            return PERTURBED
        return OTHER if self.sensor.changed else NOMINAL

    @property
    def title(self) -> str:
        """ "Simulated sensor tactip-127, instance=1: a perturbed individual"."""
        test = self.record.test_sensor
        if test is not None and (trained := trained_on(self.record)):
            text = f"Real {test.description}, trained on {trained}"
            return text + (f" (test frames {self.mark})" if self.mark else "")
        text = f"{self.origin.capitalize()} sensor {self.sensor.text()}"
        if test is not None:
            text += f", tested on {test.description}"
        if why := KINDS[self.kind]:
            text += f": {why}"
        return text + (f" (test frames {self.mark})" if self.mark else "")


def sections_of(records: Iterable[Record]) -> list[Section]:
    """Records by protocol version, sensor and test frames; simulated, then real, nominal first."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(canonical(section_key(record)), []).append(record)
    made = [Section(tuple(rows_of(group))) for group in groups.values()]
    titles = [section.title for section in made]
    named = [Section(s.rows, _mark(s)) if titles.count(s.title) > 1 else s for s in made]
    return sorted(named, key=lambda s: (s.origin != "simulated", s.kind, s.title))


def _mark(section: Section) -> str:
    return digest(section_key(section.record))[:8]
