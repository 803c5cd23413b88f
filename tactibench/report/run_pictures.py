"""The pictures of a run, stored beside its record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tactibench.board import TRIVIAL, Row, label_of
from tactibench.contacts import Contacts, FloatArray, Grid
from tactibench.protocols import Protocol, load_published, version_of
from tactibench.records import Arrays, Record, StoredRun, atomic, measured_on, unpack_contacts
from tactibench.report.curve_plots import distance_figure, distance_series, stability_figure
from tactibench.report.frame_plots import (
    FrameExample,
    contacts_figure,
    single_figure,
)
from tactibench.report.style import CURVES, image_bytes
from tactibench.shipped import shipped_folder

PANELS = 3
"""Most other runs in a picture that has one panel a run: more could not be told apart."""


@dataclass(frozen=True)
class RunArrays:
    """A run with the arrays that pictures need, each read once.

    Attributes:
        run: Stored run.
        spec: Protocol of the run.
    """

    run: StoredRun
    spec: Protocol

    @property
    def record(self) -> Record:
        """The record of the run."""
        return self.run.record

    @cached_property
    def truth(self) -> Arrays:
        """True contacts, press and group of every test frame."""
        return self.run.arrays("truth")

    @cached_property
    def contacts(self) -> tuple[Contacts, ...]:
        """The true contacts of every test frame."""
        return unpack_contacts(self.truth)

    @cached_property
    def predicted(self) -> tuple[Contacts, ...]:
        """The predicted contacts of every test frame."""
        return unpack_contacts(self.run.arrays("predictions"))

    @cached_property
    def maps(self) -> Arrays:
        """Heatmaps and true surfaces, for models and sensors that have them."""
        return self.run.arrays("maps")

    @cached_property
    def examples(self) -> Arrays:
        """The test frames that are stored with the run."""
        return self.run.arrays("examples")

    @property
    def grid(self) -> Grid:
        """The grid of the heatmaps."""
        return self.spec.grid.grid()

    def map_of(self, row: int, name: str = "maps") -> FloatArray | None:
        """Return the (H, W) map of a test frame, such as its heatmap in 0..1.

        Args:
            row: Number of the test frame.
            name: "maps" (heatmap of the model) or "surface" (true surface).

        Returns:
            None for a model without maps, and for the true surface of frames that are scored apart,
            which come last.
        """
        maps = self.maps.get(name, ())
        return np.asarray(maps[row], dtype=np.float64) if row < len(maps) else None

    def example(self, row: int) -> FrameExample:
        """Return a stored test frame with its truth and prediction."""
        image = self.examples["images"][int(np.searchsorted(self.examples["index"], row))]
        depth = self.spec.workspace.depth_max_mm
        heatmap = self.map_of(row)
        return FrameExample(
            image, self.grid, heatmap, self.contacts[row], self.predicted[row], depth
        )


def update_pictures(run: StoredRun, others: Sequence[StoredRun]) -> list[Path]:
    """Return the pictures of a run, drawn where there are none yet."""
    return sorted(run.folder.glob("*.png")) or draw_pictures(run, others)


def draw_pictures(run: StoredRun, others: Sequence[StoredRun]) -> list[Path]:
    """Draw the pictures of a run and return their files. Plate poses have no pictures yet."""
    record = run.record
    protocol = version_of(record.protocol.id, record.protocol.hash)
    if protocol is None:
        return []
    spec = protocol.spec
    if spec.answer != "contacts":
        return []

    arrays, beside = RunArrays(run, spec), runs_beside(record, others)
    figures: dict[str, Figure] = {}
    if spec.families:
        figures["stability"] = _stability(arrays, beside[: CURVES - 1])
    else:
        if "images" in arrays.examples:  # a reader could not interpret a picture of channels
            figures |= _frame(arrays)
        if spec.test.group == "all":
            figures["errors"] = _single(arrays)
        if spec.test.group == "distance":
            figures["distance"] = _distance(arrays, beside[: CURVES - 1])
        if spec.test.group == "indenter":
            figures |= _triple(arrays, beside[:PANELS])
    # All are rendered before the first is written, so that a failure to draw leaves none.
    images = {run.folder / f"{name}.png": image_bytes(f, "png") for name, f in figures.items()}
    for path, image in images.items():
        with atomic(path) as stream:
            stream.write(image)
    return sorted(images)


def runs_beside(record: Record, others: Sequence[StoredRun]) -> list[StoredRun]:
    """Return the runs that a picture may show beside this one: the newest of each label.

    They answered the same frames, and are no trivial models. The plainest settings come first.
    """
    by_label = {
        label_of(other.record): other
        for other in sorted(others, key=lambda other: other.record.created)
        if _comparable(other.record, record) and other.record.model.name not in TRIVIAL
    }
    return sorted(
        by_label.values(), key=lambda run: (len(run.record.model.changed), label_of(run.record))
    )


def press_error(truth: Contacts, predicted: Contacts) -> float:
    """Return the mean distance from a true contact to the nearest predicted one, mm."""
    if not len(predicted):
        return float("inf")
    gaps = np.linalg.norm(truth.xy[:, None] - predicted.xy[None], axis=2)
    return float(gaps.min(axis=1).mean())


def _comparable(other: Record, record: Record) -> bool:
    """Return whether two runs answered the same frames with different models or regimes."""

    def asked(one: Record) -> tuple[Any, ...]:
        identity = one.identity
        test = (identity.test_frames, identity.protocol, identity.quick, identity.limit)
        return (*test, one.seed, one.limits.presses)

    return asked(other) == asked(record) and label_of(other) != label_of(record)


def _median(arrays: RunArrays, rows: Sequence[int]) -> int:
    """Return the number of the test frame with the median error."""
    errors = [press_error(arrays.contacts[row], arrays.predicted[row]) for row in rows]
    return int(rows[int(np.argsort(errors, kind="stable")[len(errors) // 2])])


def _frame(arrays: RunArrays) -> dict[str, Figure]:

    row = _median(arrays, arrays.examples["index"].tolist())
    where = measured_on(arrays.record)
    press = f"press {arrays.truth['press'][row]}"
    title = f"{label_of(arrays.record)}, {press}: the median one of {len(arrays.examples['index'])}"
    examples = [("prediction", arrays.example(row))]
    return {"frame": contacts_figure(examples, title=title, measured_on=where)}


def _single(arrays: RunArrays) -> Figure:

    answered = [k for k, contacts in enumerate(arrays.predicted) if len(contacts)]
    return single_figure(
        _best_contacts([arrays.contacts[k] for k in answered]),
        _best_contacts([arrays.predicted[k] for k in answered]),
        title=label_of(arrays.record),
        measured_on=measured_on(arrays.record),
    )


def _best_contacts(contacts: Sequence[Contacts]) -> FloatArray:
    """Return (N, 3) x, y, depth of the first contact of each frame."""
    rows = [(*frame.xy[0], frame.depth[0]) for frame in contacts]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _by_label(arrays: RunArrays, beside: Sequence[StoredRun]) -> list[StoredRun]:
    return sorted([arrays.run, *beside], key=lambda run: label_of(run.record))


def _stability(arrays: RunArrays, beside: Sequence[StoredRun]) -> Figure:

    rows = [Row((run.record,)) for run in _by_label(arrays, beside)]
    return stability_figure(rows, arrays.spec.axes, measured_on=measured_on(arrays.record))


def _distance(arrays: RunArrays, beside: Sequence[StoredRun]) -> Figure:

    series = [distance_series(Row((run.record,))) for run in _by_label(arrays, beside)]
    published = load_published(arrays.spec.published.tables, shipped_folder("published"))
    return distance_figure(series, published=published, measured_on=measured_on(arrays.record))


def _triple(arrays: RunArrays, beside: Sequence[StoredRun]) -> dict[str, Figure]:

    triples = [k for k, contacts in enumerate(arrays.contacts) if len(contacts) == 3]
    if not triples:
        return {}
    row = _median(arrays, triples)
    each = [
        arrays if run is arrays.run else RunArrays(run, arrays.spec)
        for run in _by_label(arrays, beside)
    ]
    examples = [(label_of(one.record), one.example(row)) for one in each]
    title = f"press {arrays.truth['press'][row]}"
    figure = contacts_figure(examples, title=title, measured_on=measured_on(arrays.record))
    return {"triple": figure}
