"""Beginning a data set, or going on with one; its lock is held."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tactibench.datasets.v1.content import read_content
from tactibench.datasets.v1.header import Header, resumed, write_header
from tactibench.datasets.v1.layout import PLAN, is_dataset
from tactibench.datasets.v1.plan import PlanRow, plan_hash, plan_text, read_plan, write_plan
from tactibench.datasets.v1.repair import repair
from tactibench.datasets.v1.sample import Sample
from tactibench.errors import UserError


@dataclass(frozen=True)
class Begun:
    """What a writer finds. repaired: what had to be mended, in sentences."""

    header: Header
    plan_ids: frozenset[int]
    samples: tuple[Sample, ...] = ()
    events: tuple[Mapping[str, Any], ...] = ()
    repaired: tuple[str, ...] = ()

    def with_event(self, event: Mapping[str, Any]) -> Begun:
        return replace(self, events=(*self.events, event))

    def with_header(self, header: Header) -> Begun:
        return replace(self, header=header)


def begin(folder: Path, header: Header, plan: Iterable[PlanRow]) -> Begun:
    """Write header and plan of a new data set, or check and mend the one that is there.

    Raises UserError for a folder that holds something else, for other settings or another plan.
    """
    rows = list(plan)
    text = plan_text(rows)
    header = replace(header, plan_sha256=plan_hash(text))
    ids = frozenset(row["id"] for row in rows)
    if is_dataset(folder):
        found = resumed(folder, header)
        read_plan(folder / PLAN, found.plan_sha256)
        content = read_content(folder)
        return Begun(found, ids, content.samples, content.events, repair(folder, content))
    strangers = [p.name for p in folder.iterdir() if not p.name.startswith(".") and p.name != PLAN]
    if strangers:
        raise UserError(
            f"{folder} is not empty ({sorted(strangers)[0]} is there) and holds no data set; name "
            "a new folder."
        )
    write_plan(folder, text)
    write_header(folder, header)
    return Begun(header, ids)
