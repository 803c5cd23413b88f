"""Data sets that are pressed in chunks: workers press, one process writes them in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

from tactibench.datasets import (
    Advance,
    Draft,
    GenerationRequest,
    Header,
    PressPlan,
    PressSeries,
    SensorSource,
    generate,
    is_complete,
    press_series,
    sensor_parameters,
    signal_bytes,
)
from tactibench.errors import UserError
from tactibench.records import digest
from tactibench.run import read_parameters
from tactibench.sweep.cluster import Cluster, WorkerLossError
from tactibench.sweep.spec import DatasetSpec, SweepFile, resolve_protocol


@dataclass(frozen=True)
class DatasetTask:
    """A data set of a sweep.

    Attributes:
        folder: Folder of the data set.
        label: The folder as the sweep's file names it.
        request: The options that the sweep's file states.
        plan: The presses.
        source: The sensor.
    """

    folder: Path
    label: str
    request: GenerationRequest
    plan: PressPlan
    source: SensorSource

    @property
    def samples(self) -> int:
        """Number of samples."""
        return sum(1 for _ in self.plan)

    @property
    def is_complete(self) -> bool:
        """True where the folder holds the data set already."""
        return is_complete(self.folder, self.source, self.plan)


def list_data_sets(file: SweepFile) -> tuple[DatasetTask, ...]:
    """Return the data sets of a sweep.

    Raises:
        UserError: A data set cannot be pressed, or two data sets have the same folder.
    """
    tasks: dict[Path, DatasetTask] = {}
    asked = [spec for part in file.parts for spec in part.generate]
    for number, spec in enumerate(asked, start=1):
        try:
            task = _task(file, spec)
        except UserError as error:
            raise file.error(f"[[generate]] {number}: {error}") from None
        if task.folder in tasks:
            raise file.error(f"key 'generate.{number}.out' names {spec.out} again; name another.")
        tasks[task.folder] = task
    return tuple(tasks.values())


def _task(file: SweepFile, spec: DatasetSpec) -> DatasetTask:
    protocol = spec.protocol
    if protocol is not None:
        protocol = resolve_protocol(file, protocol)
    request = GenerationRequest(
        protocol,
        None if spec.plan is None else file.resolve(spec.plan),
        spec.sensor,
        sensor_parameters(read_parameters(spec.params)),
        spec.count,
        spec.seed,
    )
    return DatasetTask(file.resolve(spec.out), spec.out, request, *request.resolve())


def press_data_set(task: DatasetTask, cluster: Cluster, advance: Advance) -> None:
    """Generate a data set; the files are those of ``generate`` in one process.

    Raises:
        UserError: Workers died, or have another version of the sensor than this process.
    """

    def press_all(chunks: Sequence[PressSeries], header: Header) -> Iterator[Iterable[Draft]]:
        press = partial(_press_on_worker, task.request, digest(task.source.identity), header)
        return cluster.map_in_order(press, chunks)

    try:
        generate(task.folder, task.source, task.plan, advance, press_all)
    except WorkerLossError:
        raise UserError(
            f"the workers that pressed {task.label} died (killed, out of memory, or crashed); "
            "what was pressed is kept, the same command goes on."
        ) from None


def _press_on_worker(
    request: GenerationRequest, identity: str, header: Header, chunk: PressSeries
) -> list[Draft]:
    """Return the samples of a chunk as they are stored: PNG files are smaller to send.

    Raises:
        UserError: The worker has another version of the sensor than the process that asks.
    """
    source = _open_source(request)
    if digest(source.identity) != identity:
        raise UserError(
            f"a worker's sensor {source.identity['name']!r} is not the one of this machine; "
            "install the same tactibench, numpy and plugins on both."
        )
    return [
        replace(draft, signal=signal_bytes(draft.signal, header.kind, f"press {draft.id}"))
        for draft in press_series(source, chunk)
    ]


@lru_cache(maxsize=4)
def _open_source(request: GenerationRequest) -> SensorSource:
    """Return the sensor, opened once per worker, not once per chunk."""
    return request.source()
