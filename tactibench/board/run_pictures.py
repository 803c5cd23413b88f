"""Which pictures belong to which run; drawn beside its record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.board.labels import TRIVIAL, label_of, measured_on
from tactibench.board.published import load_published
from tactibench.contacts import Contacts, Grid
from tactibench.protocols.loader import protocol_files, read_protocol
from tactibench.protocols.schema import Protocol
from tactibench.records.answers import unpack_contacts
from tactibench.records.record import Record
from tactibench.records.store import Arrays, StoredRun
from tactibench.run.examples import unpacked_features
from tactibench.shipped import shipped_folder

CURVES, PANELS = 6, 3
"""Other runs in a picture of curves, and in one of panels: more could not be told apart."""


@dataclass(frozen=True)
class _Opened:
    """A run with the arrays that pictures need."""

    run: StoredRun
    keys: Protocol
    truth: Arrays
    contacts: tuple[Contacts, ...]
    answers: tuple[Contacts, ...]
    maps: Arrays

    @property
    def grid(self) -> Grid:
        return self.keys.grid.grid()

    @property
    def measured_on(self) -> str:
        return measured_on(self.run.record)

    def map_of(self, row: int) -> Any:
        """(H, W) heatmap 0..1 of a test frame, None for a model without maps."""
        return self.maps["maps"][row].astype(np.float64) if "maps" in self.maps else None


def draw_pictures(run: StoredRun, others: Sequence[StoredRun]) -> list[Path]:
    """Draw the pictures of a run and return their files. Plate poses have none yet."""
    record = run.record
    path = protocol_files().get(record.protocol.id)
    if path is None or read_protocol(path).hash != record.protocol.hash:
        return []
    keys = read_protocol(path).keys
    if keys.answer != "contacts":
        return []
    alike = beside(record, others)
    if keys.families:
        return [_hard_cases(run, keys, alike[:CURVES])]
    opened = _open(run, keys)
    drawn = [*_frame(opened), *_features(opened)]
    if keys.test.group == "all":
        drawn.append(_single(opened))
    if keys.test.group == "distance":
        drawn.append(_distance(opened, alike[:CURVES]))
    if keys.test.group == "indenter":
        drawn += _triple(opened, alike[:PANELS])
    return drawn


def _hard_cases(run: StoredRun, keys: Protocol, alike: Sequence[StoredRun]) -> Path:
    from tactibench.board.figures.hard_cases import hard_cases
    from tactibench.board.hard_cases import graded
    from tactibench.board.rows import Row

    runs = sorted([run, *alike], key=lambda one: label(one.record))
    path = run.folder / "stability.png"
    hard_cases(
        path,
        [(label(one.record), graded(Row((one.record,)), keys.axes)) for one in runs],
        title="Hard cases: error from the easy case on",
        measured_on=measured_on(run.record),
    )
    return path


def label(record: Record) -> str:
    """How a run is called in a legend."""
    return label_of(record)


def beside(record: Record, others: Sequence[StoredRun]) -> list[StoredRun]:
    """Runs that a picture may show beside this one, one a label, the newest of each.

    In the order in which they are taken while there is room: no trivial rows, the fewest
    parameters that are not at their defaults, the same regime.
    """
    found = {
        label(other.record): other
        for other in sorted(others, key=lambda other: other.record.created)
        if _comparable(other.record, record)
    }

    def last(other: StoredRun) -> tuple[bool, int, bool, str]:
        model = other.record.model
        apart = other.record.regime != record.regime
        return model.name in TRIVIAL, len(model.changed), apart, label(other.record)

    return sorted(found.values(), key=last)


def _open(run: StoredRun, keys: Protocol) -> _Opened:
    truth = run.arrays("truth")
    answers = unpack_contacts(run.arrays("predictions"))
    return _Opened(run, keys, truth, unpack_contacts(truth), answers, run.arrays("maps"))


def _comparable(other: Record, record: Record) -> bool:
    """Whether two runs answered the same frames with different models or regimes."""
    same = ("test_frames", "protocol", "quick", "limit")
    return (
        all(getattr(other.identity, key) == getattr(record.identity, key) for key in same)
        and other.seed == record.seed
        and other.limits.presses == record.limits.presses
        and label(other) != label(record)
    )


def _example(opened: _Opened) -> int:
    """The row of the stored test frame whose answer is the median one of those that are stored."""
    rows = opened.run.arrays("examples")["index"]
    errors = [_error(opened.contacts[row], opened.answers[row]) for row in rows]
    return int(rows[int(np.argsort(errors, kind="stable")[len(errors) // 2])])


def _error(truth: Contacts, found: Contacts) -> float:
    """Mean distance from a true contact to the nearest predicted one, mm."""
    if not len(found):
        return float("inf")
    gaps = np.linalg.norm(truth.xy[:, None] - found.xy[None], axis=2)
    return float(gaps.min(axis=1).mean())


def _frame(opened: _Opened) -> list[Path]:
    from tactibench.board.figures import overlay, surfaces

    row = _example(opened)
    examples = opened.run.arrays("examples")
    image = examples["images"][int(np.searchsorted(examples["index"], row))]
    heat = opened.map_of(row)
    depth = opened.keys.workspace.depth_max_mm
    press = str(opened.truth["press"][row])
    title = f"{label(opened.run.record)}, press {press}: the median one of {len(examples['index'])}"
    true = opened.maps["surface"][row].astype(np.float64) if "surface" in opened.maps else None
    path = opened.run.folder / "frame.png"
    overlay(
        path,
        image,
        opened.grid,
        heat,
        opened.contacts[row],
        opened.answers[row],
        depth,
        title=title,
        measured_on=opened.measured_on,
    )
    if heat is None or true is None:
        return [path]
    relief = opened.run.folder / "surface.png"
    surfaces(
        relief,
        opened.grid,
        heat * depth,
        true,
        names=("heatmap of the model", "true displacement of the skin"),
        title=title,
        measured_on=opened.measured_on,
    )
    return [path, relief]


def _features(opened: _Opened) -> list[Path]:
    """What the layers of the model make of the press that was kept for it, if it shows that."""
    from tactibench.board.figures import feature_maps

    examples = opened.run.arrays("examples")
    if "features_row" not in examples:
        return []
    row = int(examples["features_row"])
    path = opened.run.folder / "features.png"
    feature_maps(
        path,
        examples["images"][int(np.searchsorted(examples["index"], row))],
        unpacked_features(examples),
        opened.grid,
        opened.map_of(row),
        opened.contacts[row],
        opened.answers[row],
        opened.keys.workspace.depth_max_mm,
        title=f"{label(opened.run.record)}, press {opened.truth['press'][row]}: the most varied "
        "channels of every layer, down the left and up the right",
        measured_on=opened.measured_on,
    )
    return [path]


def _single(opened: _Opened) -> Path:
    from tactibench.board.figures import single_errors

    answered = [i for i, answer in enumerate(opened.answers) if len(answer)]
    path = opened.run.folder / "errors.png"
    single_errors(
        path,
        _xyz([opened.contacts[i] for i in answered]),
        _xyz([opened.answers[i] for i in answered]),
        title=label(opened.run.record),
        measured_on=opened.measured_on,
    )
    return path


def _xyz(contacts: Sequence[Contacts]) -> Any:
    """(N, 3) x, y, depth of the best contact of each."""
    rows = [(*c.xy[0], c.depth[0]) for c in contacts]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _distance(opened: _Opened, alike: Sequence[StoredRun]) -> Path:
    from tactibench.board.figures import distance_errors

    runs = sorted([opened.run, *alike], key=lambda run: label(run.record))
    path = opened.run.folder / "distance.png"
    distance_errors(
        path,
        [(label(run.record), run.record.metrics) for run in runs],
        published=load_published(list(opened.keys.published.tables), shipped_folder("published")),
        measured_on=opened.measured_on,
    )
    return path


def _triple(opened: _Opened, alike: Sequence[StoredRun]) -> list[Path]:
    from tactibench.board.figures import triple_comparison

    triples = [i for i, c in enumerate(opened.contacts) if len(c) == 3]
    if not triples:
        return []
    errors = [_error(opened.contacts[i], opened.answers[i]) for i in triples]
    row = triples[int(np.argsort(errors, kind="stable")[len(errors) // 2])]
    runs = sorted([opened.run, *alike], key=lambda run: label(run.record))
    each = [opened if run is opened.run else _open(run, opened.keys) for run in runs]
    heat = {label(one.run.record): one.map_of(row) for one in each}
    path = opened.run.folder / "triple.png"
    triple_comparison(
        path,
        opened.grid,
        opened.contacts[row],
        {label(one.run.record): one.answers[row] for one in each},
        {name: one for name, one in heat.items() if one is not None},
        max_depth=opened.keys.workspace.depth_max_mm,
        title=f"press {opened.truth['press'][row]}",
        measured_on=opened.measured_on,
    )
    return [path]
