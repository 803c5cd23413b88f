"""Sections of a board: rows of one sensor on one set of test frames, and the place of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tactibench.board.ranking import RankInterval, ordered, ranks
from tactibench.board.rows import Row, label_of, rows_of, section_key, trained_for, trained_on
from tactibench.board.submissions import (
    FOLDER,
    all_press_errors,
    check_folder,
    compact,
    press_errors_of,
    read_submissions,
    slot,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols import Ranking, board_spec, load_protocol, version_of
from tactibench.records import Record, SensorId, StoredRun, canonical, digest, stored_runs


@dataclass(frozen=True)
class Section:
    """Rows that answered the same test frames."""

    rows: tuple[Row, ...]
    mark: str = ""
    """Text that tells test frames apart where two sections would have the same title."""

    @property
    def record(self) -> Record:
        """The first record, for all that the rows share."""
        return self.rows[0].first

    @property
    def sensor(self) -> SensorId:
        """The sensor of the training."""
        return self.record.sensor

    @property
    def origin(self) -> str:
        """The origin of the frames: "simulated" or "real"."""
        return self.sensor.origin

    @property
    def nominal(self) -> bool:
        """True for a sensor with all settings at their defaults that is also the tested one."""
        return self.record.test_sensor is None and not self.sensor.changed

    @property
    def title(self) -> str:
        """Heading such as "Simulated sensor tactip-127, instance=1"."""
        test = self.record.test_sensor
        if test is not None and (trained := trained_on(self.record)):
            text = f"Real {test.description}, trained on {trained}"
        else:
            text = f"{self.origin.capitalize()} sensor {self.sensor.text()}"
            if test is not None:
                text += f", tested on {test.description}"
            if self.record.data.published_frames:
                text += ", published test frames"
        return text + (f" (test frames {self.mark})" if self.mark else "")


def sections_of(records: Iterable[Record]) -> list[Section]:
    """Return the records as sections: by version, sensor and test frames.

    Simulated sensors come first, then nominal ones, then published test frames, then most runs.
    """
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(canonical(section_key(record)), []).append(record)
    sections = [Section(tuple(rows_of(group))) for group in groups.values()]
    titles = [section.title for section in sections]
    named = [Section(s.rows, _mark(s)) if titles.count(s.title) > 1 else s for s in sections]
    return sorted(named, key=_order)


def _order(section: Section) -> tuple[bool, bool, bool, str, int]:
    unpublished = not section.record.data.published_frames
    title = Section(section.rows).title
    return section.origin != "simulated", not section.nominal, unpublished, title, -_runs(section)


def _mark(section: Section) -> str:
    return digest(section_key(section.record))[:8]


def gather_records(protocol: str, board: Path, runs: Path | None) -> list[Record]:
    """Return the records of ``all_records`` that were tested on the sensor of their training.

    Others belong to their own tables.

    Raises:
        UserError: As ``all_records``.
    """
    return trained_for(all_records(protocol, board, runs))


def all_records(protocol: str, board: Path, runs: Path | None) -> list[Record]:
    """Return the committed records of a protocol, and complete runs of a store.

    Of several runs of one row and seed the newest is taken.

    Args:
        protocol: Id of the protocol.
        board: Folder of the board.
        runs: Folder of the run store; None: committed records alone.

    Raises:
        UserError: The protocol is unknown, there is no board, or a committed record is invalid.
    """
    loaded = load_protocol(protocol)
    name = loaded.spec.id
    check_folder(board)
    records = {slot(record): record for record in read_submissions(board, name)}
    stored = [run.record for run in stored_runs(runs)] if runs is not None else []
    for record in sorted(stored, key=lambda record: (record.created, record.name)):
        stated = record.protocol
        if (stated.id, stated.hash) == (name, loaded.hash) and not record.partial:
            records[slot(record)] = record
    return list(records.values())


def select_section(records: Iterable[Record], sensor: str | None, protocol: str) -> Section:
    """Return the section of one sensor.

    Args:
        records: Records of one protocol.
        sensor: Sensor with its changed parameters, in words; None: the section of most runs, of a
            nominal sensor where there is one.
        protocol: Name of the protocol, for messages.

    Raises:
        UserError: There are no records, or none of this sensor.
    """
    sections = sections_of(records)
    if not sections:
        raise UserError(
            f"there is no complete run of {protocol}; add some with `tactibench board add`, or "
            "name a run store with --store."
        )
    if sensor is None:
        return max(sections, key=lambda section: (section.nominal, _runs(section)))
    names = [section.sensor.text() for section in sections]
    fitting = [s for s, name in zip(sections, names, strict=True) if name == sensor]
    if not fitting:
        raise UserError(
            f"no run of {protocol} is on a sensor {sensor!r}; {did_you_mean(sensor, names)}"
        )
    return max(fitting, key=_runs)


def count_left_out(records: Sequence[Record], section: Section) -> int:
    """Return the number of runs that are not in a section."""
    return len(records) - _runs(section)


def _runs(section: Section) -> int:
    return sum(len(row.records) for row in section.rows)


@dataclass(frozen=True)
class Placement:
    """The place that a run has, or would have, on a board.

    Attributes:
        ranking: The error that orders the board.
        rank: Ranks that the run's row may have; None: it has too few seeds or presses for a rank.
        rows: Number of rows that have a rank.
        above: The row with the next smaller error; None for the best.
        trivial: A trivial row with a smaller error; None for none.
    """

    ranking: Ranking
    rank: RankInterval | None
    rows: int
    above: Row | None
    trivial: Row | None


def place_run(run: StoredRun, board: Path, seeds: Sequence[StoredRun] = ()) -> Placement | None:
    """Return the place of a run among the committed rows of its section.

    The row holds the run and other seeds of the same configuration, as the board would show it.

    Args:
        run: Stored run.
        board: Folder of the board.
        seeds: Other runs, whose seeds of the same configuration count before committed ones.

    Returns:
        None where the run has no place: it is partial or learned from fewer presses, no error
        orders the board, or nothing was committed for this sensor and these test frames.

    Raises:
        UserError: A committed record cannot be read.
    """
    record = run.record
    ranking = board_spec(record.protocol.label).ranking
    protocol = version_of(record.protocol.id, record.protocol.hash)
    shortened = record.partial or record.limits.presses is not None
    committed = board / FOLDER / record.protocol.id
    if ranking is None or protocol is None or shortened or not committed.is_dir():
        return None
    compacted, key = compact(record), canonical(section_key(record))
    mine = [one for one in (*seeds, run) if label_of(one.record) == label_of(record)]
    same = [one for one in mine if canonical(section_key(one.record)) == key]
    own = {slot(compact(one.record)): one for one in same}
    others = [
        other
        for other in read_submissions(board, record.protocol.id)
        if other.limits.presses is None
        and canonical(section_key(other)) == key
        and slot(other) not in own
    ]
    if not others:
        return None
    errors = all_press_errors(board, others)
    for one in own.values():
        arrays = one.arrays("truth"), one.arrays("predictions")
        errors[one.record.name] = press_errors_of(protocol.spec, *arrays)
    records = [*others, *(compact(one.record) for one in own.values())]
    rows = ordered(record.protocol.label, rows_of(records))
    ranked = ranks(record.protocol.label, rows, errors)
    place = next(k for k, row in enumerate(rows) if compacted in row.records)
    values = [row.metric(ranking.metric, ranking.group) for row in rows]
    if ranked is None or (own_value := values[place]) is None:
        return None
    pairs = zip(rows, values, strict=True)
    below = [row for row, value in pairs if row.trivial and value and value.value < own_value.value]
    return Placement(
        ranking=ranking,
        rank=ranked.by_row[place],
        rows=sum(rank is not None for rank in ranked.by_row),
        above=rows[place - 1] if place else None,
        trivial=below[0] if below else None,
    )
