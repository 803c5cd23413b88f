"""Which cell is next: those that share weights wait for one training, the others go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from tactibench.errors import UserError
from tactibench.run.request import RunRequest
from tactibench.sweep.cells import Cell
from tactibench.sweep.engine import NO_GPU, Engine, Room, WorkersDied
from tactibench.sweep.planned import Place, Planned
from tactibench.sweep.work import Outcome, run_cell, train_weights

Work = Callable[[RunRequest, Place], Outcome]


@dataclass(frozen=True, eq=False)
class Job:
    """A task for a worker. cells: those that need it; a training has several."""

    work: Work
    cells: tuple[Cell, ...]

    @property
    def needs_gpu(self) -> bool:
        return self.cells[0].needs_gpu


def jobs_of(planned: Mapping[Cell, Planned]) -> list[Job]:
    """A training for each group of cells with the same weights that nobody has trained yet, then
    a run for every other cell that is to do."""
    groups: dict[str, list[Cell]] = {}
    for cell, plan in planned.items():
        if plan.state == "to do":
            groups.setdefault(plan.weights, []).append(cell)
    shared = [
        tuple(cells)
        for cells in groups.values()
        if len(cells) > 1 and not planned[cells[0]].trained
    ]
    behind = {cell for cells in shared for cell in cells}
    alone = [cell for cells in groups.values() for cell in cells if cell not in behind]
    return [*(Job(train_weights, cells) for cells in shared), *(Job(run_cell, (c,)) for c in alone)]


def carried_out(
    jobs: list[Job], engine: Engine, place: Place, deaths: int
) -> Iterator[tuple[Cell, Outcome]]:
    """Every cell with what came of it, as they finish.

    No more tasks are handed out than workers can begin at once, so that a worker that dies takes
    with it only what it was at work on. deaths: of workers that a task outlives.
    """
    waiting = list(jobs)
    running: dict[object, Job] = {}
    had_gpu = False
    while waiting or running:
        room = engine.room()
        had_gpu |= bool(room.gpus)
        # A local worker with a card that died is being started again.
        if room.slots and not room.gpus and (engine.remote or not had_gpu):
            refused = [job for job in waiting if job.needs_gpu]
            waiting = [job for job in waiting if not job.needs_gpu]
            yield from _failed(refused, Outcome(why=NO_GPU))
        while (job := _next(waiting, running, room)) is not None:
            waiting.remove(job)
            request = job.cells[0].request
            running[engine.submit(job.work, request, place, gpu=job.needs_gpu)] = job
        for future in engine.any_of(running):
            job = running.pop(future)
            outcome = _outcome(engine, future, deaths)
            if job.work is train_weights and not outcome.why:
                waiting[:0] = [Job(run_cell, (cell,)) for cell in job.cells]
            else:
                yield from ((cell, outcome) for cell in job.cells)


def _next(waiting: list[Job], running: Mapping[object, Job], room: Room) -> Job | None:
    """The first job that a free worker can begin."""
    on_gpu = sum(job.needs_gpu for job in running.values())
    if len(running) >= room.slots:
        return None
    return next((job for job in waiting if not job.needs_gpu or on_gpu < room.gpus), None)


def _outcome(engine: Engine, future: object, deaths: int) -> Outcome:
    try:
        outcome: Outcome = engine.result(future)
    except WorkersDied:
        return Outcome(why=_died(engine, deaths))
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - what a worker cannot even begin
        return Outcome(why=f"the worker could not do it ({type(error).__name__}: {error}).")
    return outcome


def _died(engine: Engine, deaths: int) -> str:
    times = "several" if engine.remote else f"{deaths + 1}"
    return (
        f"the workers that ran it died, {times} in turn (killed, out of memory, or crashed); run "
        "it alone to see why."
    )


def _failed(jobs: list[Job], outcome: Outcome) -> Iterator[tuple[Cell, Outcome]]:
    for job in jobs:
        yield from ((cell, outcome) for cell in job.cells)
