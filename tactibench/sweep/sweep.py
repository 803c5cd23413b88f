"""A sweep: looked up, then carried out on an engine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tactibench.errors import UserError
from tactibench.run.request import RunRequest
from tactibench.run.train import Reporter
from tactibench.sweep.cells import Cell
from tactibench.sweep.dispatch import carried_out, jobs_of
from tactibench.sweep.engine import NO_GPU, Engine, WorkersDied
from tactibench.sweep.planned import Place, Planned, plan_cells
from tactibench.sweep.sets import WantedSet, press_in_shards
from tactibench.sweep.work import Outcome

Lookup = Mapping[Cell, Planned]


@dataclass(frozen=True)
class Finished:
    """A cell and what came of it; no outcome: it was in the store, or could not be planned."""

    cell: Cell
    planned: Planned
    outcome: Outcome | None = None

    @property
    def name(self) -> str:
        """Of the run in the store; "" where there is none."""
        if self.outcome is not None:
            return self.outcome.name
        return self.planned.name if self.planned.state == "done" else ""

    @property
    def why(self) -> str:
        """It failed, in a sentence; "" when it did not."""
        return self.outcome.why if self.outcome is not None else self.planned.why


def look_up(
    cells: Iterable[Cell], place: Place, engine: Engine | None = None
) -> dict[Cell, Planned]:
    """Plan all cells, on a worker of each kind where an engine is given, else here.

    Of cells that come to the same run only the first is kept.
    """
    found: dict[Cell, Planned] = {}
    every = list(cells)
    for gpu in (False, True):
        some = [cell for cell in every if cell.needs_gpu == gpu]
        if some:
            requests = [cell.request for cell in some]
            found |= zip(some, _plan(requests, place, engine, gpu=gpu), strict=True)
    names: set[str] = set()
    kept: dict[Cell, Planned] = {}
    for cell in every:
        planned = found[cell]
        if not planned.name or planned.name not in names:
            kept[cell] = planned
            names.add(planned.name)
    return kept


def _plan(
    requests: list[RunRequest], place: Place, engine: Engine | None, *, gpu: bool
) -> tuple[Planned, ...]:
    if engine is None:
        return plan_cells(requests, place)
    if gpu and not engine.room().gpus:
        return (Planned("cannot", why=NO_GPU),) * len(requests)
    future = engine.submit(plan_cells, requests, place, gpu=gpu)
    while not engine.any_of([future]):
        pass
    try:
        planned: tuple[Planned, ...] = engine.result(future)
    except WorkersDied:
        raise UserError(
            "the workers that looked the cells up died; see their logs, then run the same command."
        ) from None
    return planned


def looked_up(planned: Lookup) -> list[Finished]:
    """Cells of which nothing was run."""
    return [Finished(cell, plan) for cell, plan in planned.items()]


def carry_out(
    planned: Lookup,
    sets: Sequence[WantedSet],
    engine: Engine,
    place: Place,
    deaths: int,
    reporter: Reporter,
) -> list[Finished]:
    """Press the data sets that are not there, then run the cells that are to do.

    deaths: of workers that a cell outlives. Raises UserError when the scheduler has gone or a data
    set cannot be pressed.
    """
    for one in sets:
        if not one.is_complete:
            with reporter.task(f"press {one.label}", one.samples) as advance:
                press_in_shards(one, engine, advance)
    outcomes: dict[Cell, Outcome] = {}
    count = sum(plan.state == "to do" for plan in planned.values())
    with reporter.task("runs", count) as advance:
        for cell, outcome in carried_out(jobs_of(planned), engine, place, deaths):
            outcomes[cell] = outcome
            advance(1)
    return [Finished(cell, plan, outcomes.get(cell)) for cell, plan in planned.items()]
