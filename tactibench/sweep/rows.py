"""The figures of a sweep as a list of rows: metric, group, value, unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from tactibench.records.store import open_run
from tactibench.sweep.sets import WantedSet
from tactibench.sweep.sweep import Finished


def rows_of(
    finished: Iterable[Finished], sets: Iterable[WantedSet], store: Path
) -> list[dict[str, Any]]:
    """Every metric of every run that is in the store, a row "failed" for every cell that is not,
    and the samples of every data set that is there.

    Raises UserError for a run that is gone or cannot be read.
    """
    rows = [row for one in finished for row in _rows(one, store)]
    made = (one for one in sets if one.is_complete)
    return [
        *rows,
        *(
            {"metric": "samples", "group": one.label, "value": one.samples, "unit": ""}
            for one in made
        ),
    ]


def _rows(one: Finished, store: Path) -> Iterator[dict[str, Any]]:
    axes = {**one.cell.axes, "seed": one.cell.request.seed}
    if one.why:
        failed = {"metric": "failed", "group": one.cell.label, "value": 1, "unit": ""}
        yield {**failed, "why": one.why, **axes}
    elif one.name:
        for metric in open_run(store, one.name).record.metrics:
            shown = metric.model_dump(include={"metric", "group", "value", "unit"})
            yield {**shown, "run": one.name, **axes}
