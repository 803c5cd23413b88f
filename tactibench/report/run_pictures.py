"""The pictures of a run, stored beside its record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tactibench.board import Row, label_of
from tactibench.contacts import Contacts, FloatArray
from tactibench.protocols import Protocol, family_of, load_published, version_of
from tactibench.records import Arrays, StoredRun, atomic, measured_on, unpack_contacts
from tactibench.report.curve_plots import distance_figure, stability_figure
from tactibench.report.frame_plots import FrameExample, contacts_figure, single_figure
from tactibench.report.style import image_bytes


@dataclass(frozen=True)
class RunArrays:
    """A run with the arrays that pictures need, each read once.

    Attributes:
        run: Stored run.
        spec: Protocol of the run.
    """

    run: StoredRun
    spec: Protocol

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
    def maps(self) -> FloatArray | tuple[()]:
        """(N, H, W) heatmaps in 0..1 of the test frames; () for a model without heatmaps."""
        return self.run.arrays("maps").get("maps", ())

    @cached_property
    def examples(self) -> Arrays:
        """The test frames that are stored with the run."""
        return self.run.arrays("examples")

    def example(self, row: int) -> FrameExample:
        """Return a stored test frame with its truth and prediction."""
        return FrameExample(
            self.examples["images"][int(np.searchsorted(self.examples["index"], row))],
            self.spec.grid.grid(),
            np.asarray(self.maps[row], dtype=np.float64) if row < len(self.maps) else None,
            self.contacts[row],
            self.predicted[row],
            self.spec.workspace.depth_max_mm,
        )


def update_pictures(run: StoredRun) -> list[Path]:
    """Return the pictures of a run, drawn where there are none yet."""
    return sorted(run.folder.glob("*.png")) or draw_pictures(run)


def draw_pictures(run: StoredRun) -> list[Path]:
    """Draw the pictures of a run and return their files. Plate poses have no pictures yet."""
    record = run.record
    protocol = version_of(record.protocol.id, record.protocol.hash)
    if protocol is None or protocol.spec.answer != "contacts":
        return []
    spec, row, where = protocol.spec, Row((record,)), measured_on(record)
    arrays = RunArrays(run, spec)
    figures: dict[str, Figure] = {}
    if spec.families:
        figures["stability"] = stability_figure([row], spec.axes, measured_on=where)
    elif "images" in arrays.examples:  # a reader could not interpret a picture of channels
        figures["frame"] = _median_frame(arrays)
    if spec.test.group == "all" and not spec.families:
        apart = {test.name for test in spec.test.apart}  # other sensors have figures of their own
        main = (family_of(str(group)) not in apart for group in arrays.truth["group"])
        answered = [k for k, own in enumerate(main) if own and len(arrays.predicted[k])]
        figures["errors"] = single_figure(
            _first_contacts([arrays.contacts[k] for k in answered]),
            _first_contacts([arrays.predicted[k] for k in answered]),
            title=label_of(record),
            measured_on=where,
        )
    if spec.test.group == "distance":
        published = load_published(spec.published.tables)
        figures["distance"] = distance_figure([row], published=published, measured_on=where)
    # All are rendered before the first is written, so that a failure to draw leaves none.
    images = {run.folder / f"{name}.png": image_bytes(f, "png") for name, f in figures.items()}
    for path, image in images.items():
        with atomic(path) as stream:
            stream.write(image)
    return sorted(images)


def _median_frame(arrays: RunArrays) -> Figure:
    """Draw the stored test frame with the median error, of those with most contacts."""
    rows = arrays.examples["index"].tolist()
    most = max(len(arrays.contacts[row]) for row in rows)
    rows = [row for row in rows if len(arrays.contacts[row]) == most]
    errors = [press_error(arrays.contacts[row], arrays.predicted[row]) for row in rows]
    row = rows[int(np.argsort(errors, kind="stable")[len(rows) // 2])]
    record, press = arrays.run.record, arrays.truth["press"][row]
    title = f"{label_of(record)}, press {press}: the median one of {len(rows)}"
    examples = [("camera frame", arrays.example(row))]
    return contacts_figure(examples, title=title, measured_on=measured_on(record))


def press_error(truth: Contacts, predicted: Contacts) -> float:
    """Return the mean distance from a true contact to the nearest predicted one, mm."""
    if not len(predicted):
        return float("inf")
    gaps = np.linalg.norm(truth.xy[:, None] - predicted.xy[None], axis=2)
    return float(gaps.min(axis=1).mean())


def _first_contacts(contacts: Sequence[Contacts]) -> FloatArray:
    """Return (N, 3) x, y, depth of the first contact of each frame."""
    rows = [(*frame.xy[0], frame.depth[0]) for frame in contacts]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
