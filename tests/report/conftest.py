"""Synthetic records to print, one report of stored runs, and hostile records of reports."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from changed_record import changed_record
from command_line import cli, refused  # noqa: F401 - fixtures
from report_material import HOSTILE, hostile_record, store_of
from rich.console import Console

from tactibench.metrics import find_metric
from tactibench.protocols import PublishedTable, load_protocol, load_published
from tactibench.records import Metric, Record
from tactibench.report import ReportBoard, ReportData, gather, print_run


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
def page_of() -> Callable[[ReportData], str]:
    from tactibench.report import report_page

    return report_page


@pytest.fixture(scope="session")
def report_data(made_store: Path) -> ReportData:
    return gather(made_store, None)


@pytest.fixture(scope="session")
def hostile(fabricate: Callable[..., dict[str, Any]]) -> ReportData:
    """Every text that a plugin or a paper supplies tries to be markup."""
    records = [
        hostile_record(fabricate, text, protocol="exp2", error=0.1 + k, metrics=_resolved(k))
        for k, text in enumerate(HOSTILE)
    ]
    tables = tuple(_table(k, text) for k, text in enumerate(HOSTILE))
    return ReportData((ReportBoard(load_protocol("exp2"), tuple(records), tables, {}),), HOSTILE[0])


def _resolved(k: int) -> tuple[tuple[str, str, float], ...]:
    return tuple(
        (metric, distance, 0.2 + 0.1 * k)
        for metric in ("resolved", "distance_mae_mm")
        for distance in ("7.0", "9.0", "11.0")
    )


def _table(k: int, text: str) -> PublishedTable:
    row = {
        **dict.fromkeys(("model", "source", "unit", "note"), text),
        "protocol": "exp2",
        "decimals": 3,
        "comparable": "no",
        "n": 3,
        "metrics": {"distance_mae_mm": {"all": 0.3 + k}},
    }
    texts = dict.fromkeys(("name", "title", "authors", "measured_on"), text)
    return PublishedTable.model_validate(
        {"schema_version": 1, **texts, "year": 2020, "notes": [text], "rows": [row]}
    )


DISTANCES = [f"{6.5 + k / 2:.1f}" for k in range(12)]


def metric_row(
    metric: str,
    group: str,
    value: float | None,
    spread: float = 0.03,
    n: int = 1000,
    clusters: int = 1000,
    **more: Any,
) -> Metric:
    low, high = (None, None) if value is None else (value - spread, value + spread)
    unit = find_metric(metric).unit
    if unit == "share" and low is not None and high is not None:
        low, high = max(0.0, low), min(1.0, high)
    ends = {"low": low, "high": high, "unit": unit, "better": "lower"}
    return Metric(metric=metric, group=group, value=value, n=n, clusters=clusters, **ends, **more)


def exp1_rows() -> list[Metric]:
    by_axis = [
        ("r2", 0.99941, -0.001, 0.0002),
        ("mae_mm", 0.0412, 0.01, 0.0014),
        ("rmse_mm", 0.0531, 0.01, 0.0031),
        ("rmse_over_bound", 3.14, 1.0, 0.2),
    ]
    rows = [
        metric_row(name, axis, first + step * k, spread)
        for name, first, step, spread in by_axis
        for k, axis in enumerate("xyz")
    ]
    rows += [metric_row(name, "mean", first, spread) for name, first, _, spread in by_axis[:3]]
    over_all = {"gospa_depth_mm": 0.0471, "nll": -3.217, "missed": 0.0, "spurious": 0.0021}
    return rows + [metric_row(name, "all", value, 0.001) for name, value in over_all.items()]


def exp2_rows(resolved: float = 0.6) -> list[Metric]:
    rows = []
    for k, d in enumerate(DISTANCES):
        share = min(1.0, resolved + k * 0.05) if resolved else 0.0
        n = round(100 * share)
        error, turn = (0.92 - 0.05 * k, 8.2 - 0.4 * k) if n else (None, None)
        penalised = (1 - share) * float(d) + (error or 0) * share
        rows += [
            metric_row("distance_mae_mm", d, error, 0.07, n, n),
            metric_row("distance_penalised_mm", d, penalised, 0.4, 100, 100),
            metric_row("resolved", d, share, 0.07, 100, 100),
            metric_row("orientation_mae_deg", d, turn, 0.6, n, n),
        ]
    n = round(1200 * resolved)
    rows += [
        metric_row("distance_mae_mm", "all", 0.652 if n else None, 0.021, n, n),
        metric_row("distance_penalised_mm", "all", 1.934, 0.11, 1200, 1200),
        metric_row("resolved", "all", resolved, 0.02, 1200, 1200),
        metric_row("threshold_mm", "all", 6.5, 0.2, 1200, 1200, censored="<"),
        metric_row("catch_resolved", "all", 0.008, 0.01, 120, 120),
    ]
    over_all_frames = {
        "depth_mae_mm": 0.204,
        "gospa_depth_mm": 0.891,
        "missed": 0.081,
        "spurious": 0.031,
    }
    rows += [metric_row(m, "all", v, 0.01, 2200, 1200) for m, v in over_all_frames.items()]
    return rows


def surface_rows() -> list[Metric]:
    return [
        metric_row("depth_mae_mm", "all", 0.0561, 0.0021, 1210, 1210),
        metric_row("tilt_mae_deg", "all", 1.134, 0.05, 1210, 1210),
        metric_row("coverage", "all", 1.0, 0.003, 1210, 1210),
    ]


METRICS = {
    "exp1": exp1_rows,
    "exp2": exp2_rows,
    "surface": surface_rows,
}
RECORD_FILE = "experiments/of/a/long/name/tactile/runs/{}/record.json"


def speed_row(threads: int, phase: str, ms: float) -> dict[str, Any]:
    facts = {"scenario": "single", "threads": threads, "batch": 1, "phase": phase, "settled": True}
    factors = {"p50_ms": 1.0, "p90_ms": 1.2, "p99_ms": 1.9, "mean_ms": 1.05}
    times = {name: factor * ms / threads for name, factor in factors.items()}
    return {**facts, **times, "per_s": 950 * threads / 6.3}


PHASES = (("preprocess", 0.09), ("forward", 5.4), ("decode", 0.81), ("total", 6.3))


def made_record(fabricate: Callable[..., Record], protocol: str, **changes: Any) -> Record:
    real = protocol == "surface"
    sensor = ("recorded", "real") if real else ("tactip-127", "simulated")
    made = {
        "name": f"{protocol}-unet-single-1f00",
        "model": {"name": "cnn" if real else "unet", "parameters": {"width": 16}, "settings": []},
        "sensor": {"name": sensor[0], "parameters": {}, "settings": [], "origin": sensor[1]},
        "environment": {
            "cpu": "Intel(R) Xeon(R) Processor @ 2.10GHz",
            "threads": 2,
            "fingerprint": "0a1b2c3d4e5f",
        },
        "metrics": METRICS[protocol](),
        "speed": [speed_row(t, phase, ms) for t in (1, 2) for phase, ms in PHASES],
        "timed": {"configuration": "bfloat16, channels_last, batch 1", "difference_mm": 0.0012},
        "data": {
            "train": 3600,
            "validation": 400,
            "test": 1320,
            "rejected": 0 if real else 2417,
            "published_frames": real,
        },
        "signature": f"tactibench 0.1.0|{load_protocol(protocol).label}#0123456789ab|unet#77aa|"
        "hertz|tactip-127|seed 0|data ab12|weights 0a1b2c3d|code 91bc205",
    }
    record = fabricate(
        protocol, regime="recorded" if real else "single", encoder=None if real else "hertz"
    )
    return changed_record(record, {**made, **changes})


@pytest.fixture
def row() -> Callable[..., Metric]:
    """Metric, group, value, ... -> a metric of a record."""
    return metric_row


@pytest.fixture
def exp2() -> Callable[..., list[Metric]]:
    """The share of pairs that were resolved -> the metrics of exp2."""
    return exp2_rows


@pytest.fixture
def record(fabricate: Callable[..., Record]) -> Callable[..., Record]:
    """Protocol, keys to change -> a record."""
    return partial(made_record, fabricate)


@pytest.fixture(scope="session")
def render() -> Callable[..., str]:
    """A record -> what is printed, published rows below."""
    folder = Path(__file__).parents[2] / "leaderboards" / "published"
    tables = load_published(["tactiverse", "tac-vgnn"], folder)

    def rendered(shown: Record) -> str:
        console = Console(file=io.StringIO(), width=80, force_terminal=False)
        print_run(console, shown, RECORD_FILE.format(shown.name), tables)
        return console.file.getvalue()  # type: ignore[attr-defined]

    return rendered
