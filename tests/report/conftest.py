"""One report of stored runs, made once, and hostile records that reports are made of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from report_material import HOSTILE, hostile_record, store_of

from tactibench.board.html.material import Board, Material, gather
from tactibench.board.published import PublishedTable
from tactibench.protocols.loader import load_protocol


@pytest.fixture(scope="session")
def made_store(
    tmp_path_factory: pytest.TempPathFactory, fabricate: Callable[..., dict[str, Any]]
) -> Path:
    """A run store, with an empty board's folder beside it."""
    folder = tmp_path_factory.mktemp("report") / "runs"
    store_of(folder, fabricate)
    (folder.parent / "leaderboards").mkdir()
    return folder


@pytest.fixture(scope="session")
def page_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Material], str]:
    for library in ("plotly", "jinja2", "markdown_it"):
        pytest.importorskip(library, reason="the HTML report needs tactibench[report]")
    from tactibench.board.html.write import report_page

    cache = tmp_path_factory.mktemp("cache")
    return lambda material: report_page(material, cache)


@pytest.fixture(scope="session")
def material(made_store: Path) -> Material:
    return gather(made_store, made_store.parent / "leaderboards")


@pytest.fixture(scope="session")
def hostile(fabricate: Callable[..., dict[str, Any]]) -> Material:
    """Every text that a plugin or a paper supplies tries to be markup."""
    records = []
    for k, text in enumerate(HOSTILE):
        for protocol in ("exp1", "exp2"):
            more = {"metrics": _resolved(k)} if protocol == "exp2" else {}
            records.append(
                hostile_record(fabricate, text, protocol=protocol, error=0.1 + k, **more)
            )
    tables = tuple(_table(k, text) for k, text in enumerate(HOSTILE))
    boards = []
    for name in ("exp1", "exp2"):
        own = tuple(r for r in records if r["protocol"]["id"] == name)
        boards.append(Board(load_protocol(name), own, tables, {}))
    return Material(tuple(boards), HOSTILE[0])


def _resolved(k: int) -> tuple[tuple[str, str, float], ...]:
    return tuple(
        (metric, distance, 0.2 + 0.1 * k)
        for metric in ("resolved", "distance_mae_mm")
        for distance in ("7.0", "9.0", "11.0")
    )


def _table(k: int, text: str) -> PublishedTable:
    row = {
        "model": text,
        "source": text,
        "unit": text,
        "note": text,
        "decimals": 3,
        "comparable": "no",
        "n": 3,
    }
    distance = {"distance_mae_mm": {"all": 0.3 + k}}
    rows = [
        {**row, "protocol": "exp1", "metrics": {"mae_mm": {"mean": 0.1}}},
        {**row, "protocol": "exp2", "metrics": distance},
    ]
    return PublishedTable.model_validate(
        {
            "schema_version": 1,
            "name": text,
            "title": text,
            "authors": text,
            "year": 2020,
            "measured_on": text,
            "notes": [text],
            "rows": rows,
        }
    )
