"""Data sets that are pressed in shards: workers press, one process writes them in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

from tactibench.datasets import Draft, Header
from tactibench.datasets.generation import (
    Advance,
    GenerationRequest,
    SensorSource,
    Shard,
    generate,
    press_shard,
    sensor_parameters,
)
from tactibench.datasets.generation import is_complete as is_written
from tactibench.datasets.image_files import png_bytes
from tactibench.datasets.press_plan import PressPlan
from tactibench.errors import UserError
from tactibench.protocols.loader import protocol_files
from tactibench.records.identity import digest
from tactibench.run.request import read_parameters
from tactibench.sweep.engine import Engine, WorkersDied
from tactibench.sweep.keys import GenerateKeys
from tactibench.sweep.read import SweepFile


@dataclass(frozen=True)
class WantedSet:
    """A data set that is asked for, looked up."""

    folder: Path
    label: str
    asked: GenerationRequest
    pressing: PressPlan
    source: SensorSource

    @property
    def samples(self) -> int:
        return sum(1 for _ in self.pressing)

    @property
    def is_complete(self) -> bool:
        return is_written(self.folder, self.source, self.pressing)


def sets_of(file: SweepFile) -> tuple[WantedSet, ...]:
    """The data sets of a sweep. Raises UserError for what cannot be pressed, and for a folder that
    is named twice."""
    found: dict[Path, WantedSet] = {}
    for number, keys in enumerate(file.keys.generate, start=1):
        try:
            one = _wanted(file, keys)
        except UserError as error:
            raise file.mistake(f"[[generate]] {number}: {error}") from None
        if one.folder in found:
            raise file.mistake(f"key 'generate.{number}.out' names {keys.out} again; name another.")
        found[one.folder] = one
    return tuple(found.values())


def _wanted(file: SweepFile, keys: GenerateKeys) -> WantedSet:
    protocol = keys.protocol
    if protocol is not None and protocol.endswith(".toml") and protocol not in protocol_files():
        protocol = str(file.inside(protocol))
    plan = None if keys.plan is None else file.inside(keys.plan)
    asked = GenerationRequest(
        protocol,
        plan,
        keys.sensor,
        sensor_parameters(read_parameters(keys.params)),
        keys.count,
        keys.seed,
    )
    return WantedSet(file.inside(keys.out), keys.out, asked, *asked.resolve())


def press_in_shards(wanted: WantedSet, engine: Engine, advance: Advance) -> None:
    """Generate a data set: the files are those of ``generate`` in one process.

    Raises UserError, also where workers have another version of the sensor than this process.
    """

    def presser(shards: Sequence[Shard], header: Header) -> Iterator[Iterable[Draft]]:
        press = partial(_pressed, wanted.asked, digest(wanted.source.identity), header)
        return engine.in_order(press, shards)

    try:
        generate(wanted.folder, wanted.source, wanted.pressing, advance, presser)
    except WorkersDied:
        raise UserError(
            f"the workers that pressed {wanted.label} died (killed, out of memory, or crashed); "
            "what was pressed is kept, the same command goes on."
        ) from None


def _pressed(asked: GenerationRequest, identity: str, header: Header, shard: Shard) -> list[Draft]:
    """On a worker: the samples of a shard with their images as PNG files."""
    source = _source(asked)
    if digest(source.identity) != identity:
        raise UserError(
            f"a worker's sensor {source.identity['name']!r} is not the one of this machine; "
            "install the same tactibench, numpy and plugins on both."
        )
    png: Callable[[Draft], bytes] = lambda d: png_bytes(d.image, header, f"press {d.id}")  # noqa: E731
    return [replace(draft, image=png(draft)) for draft in press_shard(source, shard)]


@lru_cache(maxsize=4)
def _source(asked: GenerationRequest) -> SensorSource:
    """Opened once a worker, not once a shard; what it depends on does not change."""
    return asked.source()
