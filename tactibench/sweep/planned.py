"""What of a sweep is there already, and which cells share a training."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.records.identity import digest
from tactibench.records.store import CHECKSUM, readable_run, stored_runs
from tactibench.run.plan import RunPlan, make_plan
from tactibench.run.request import RunRequest

ADDED = ("commit", "data", "weights_hash", "predictions_hash", "stored", CHECKSUM)
"""What a record's identity holds beside that of its plan."""

State = Literal["done", "to do", "cannot"]


@dataclass(frozen=True)
class Place:
    """Where runs and what can be made again are kept. any_machine: whether a run that another
    machine made counts, as it must where a cell may be run on any of several."""

    store: Path
    cache: Path
    any_machine: bool = False


@dataclass(frozen=True)
class Planned:
    """A cell looked up. name: of the run. why: it cannot be run, in a sentence. weights: cells
    with the same key share one training. trained: whether that is in the cache."""

    state: State
    name: str = ""
    why: str = ""
    weights: str = ""
    trained: bool = False


def plan_cells(requests: Sequence[RunRequest], place: Place) -> tuple[Planned, ...]:
    """Look cells up in the store and the cache, where this is called; what cannot be planned is
    said in words."""
    host = PluginHost()
    known = dict(_known(place.store)) if place.any_machine else {}
    return tuple(_planned(request, place, host, known) for request in requests)


def _planned(request: RunRequest, place: Place, host: PluginHost, known: dict[str, str]) -> Planned:
    try:
        plan = make_plan(request, host, place.cache)
    except (UserError, OSError) as error:
        return Planned("cannot", why=" ".join(str(error).split()))
    name = stored_name(plan, place, known)
    return Planned(
        "done" if name else "to do",
        name or plan.name,
        weights=plan.weights.folder.name,
        trained=plan.weights.cached,
    )


def stored_name(plan: RunPlan, place: Place, known: dict[str, str]) -> str | None:
    """The run of this identity in the store, if there is one that can be read. known: those of any
    machine."""
    if readable_run(place.store, plan.name) is not None:
        return plan.name
    return known.get(digest(_without(plan.identity, ("machine",))))


def _known(store: Path) -> Iterator[tuple[str, str]]:
    """Identity without the machine -> name, of every stored run."""
    for run in stored_runs(store):
        yield (
            digest(_without(run.record.identity.json_values(), (*ADDED, "machine"))),
            run.folder.name,
        )


def _without(identity: dict[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    return {key: value for key, value in identity.items() if key not in keys}
