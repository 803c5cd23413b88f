"""Property tests try the same examples in every run; a busy machine may take its time.

``fabricate`` makes records of runs that never took place, for all that reads many of them.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from tactibench.protocols import LoadedProtocol
    from tactibench.records import Record

if "PYTEST_XDIST_WORKER" in os.environ:  # processes that each take all cores stall each other
    for library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(library, "1")

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Compile numba's loops before several processes begin that each would compile them."""
    gc.disable()  # all that is imported while tests are collected stays
    if getattr(config.option, "numprocesses", None):  # not in a worker, not with -n 0
        from compilation import compile_loops

        compile_loops()


def pytest_collection_finish() -> None:
    """Collect garbage again."""
    gc.enable()


@pytest.fixture(scope="module", autouse=True)
def freeze_what_is_imported() -> None:
    """Keep the collector from walking over imported modules: 0.2 s, several times in every run."""
    gc.collect()
    gc.freeze()


RANKED = {
    "exp1": ("gospa_depth_mm", "all"),
    "exp2": ("distance_penalised_mm", "all"),
    "exp3": ("gospa_depth_mm", "all"),
    "fine": ("distance_penalised_mm", "all"),
    "surface": ("depth_mae_mm", "all"),
    "stability": ("ospa_mm", "all"),
    "transfer": ("depth_mae_mm", "0"),
}
PERCENT = {"missed", "resolved", "catch_resolved", "coverage"}


def metric(name: str, group: str, value: float | None, **more: Any) -> dict[str, Any]:
    """A row of a record, its interval 10 % to either side."""
    ends = (
        {"low": None, "high": None} if value is None else {"low": 0.9 * value, "high": 1.1 * value}
    )
    unit = "share" if name in PERCENT else "mm"
    base = {"metric": name, "group": group, "value": value, **ends, "n": 1000, "clusters": 1000}
    return {**base, "unit": unit, "better": "lower", **more}


@cache
def shipped_protocol(name: str) -> LoadedProtocol:
    """A protocol that ships, read once, whatever a test shows in its place."""
    from tactibench.protocols import read_protocol

    return read_protocol(Path(__file__).parents[1] / "protocols" / f"{name}.toml")


def fabricated(
    protocol: str = "exp1",
    model: str = "unet",
    *,
    error: float | None = 0.05,
    p90_ms: float = 6.0,
    seed: int = 0,
    regime: str = "single",
    settings: Mapping[str, Any] | None = None,
    encoder: str | None = "hertz",
    sensor: Mapping[str, Any] | None = None,
    origin: str = "simulated",
    machine: str = "0123456789ab",
    metrics: tuple[tuple[str, str, float | None], ...] = (),
    **more: Any,
) -> Record:
    """A valid record. protocol: its id. error: of the metric
    that orders the board; settings, sensor: parameters that are not at their defaults."""
    from tactibench.records import Record

    loaded = shipped_protocol(protocol)
    label = [_labelled(model, settings), _labelled("tactip-127", sensor)]
    name = f"{loaded.spec.id}-{model}-{regime}-s{seed}-{hash_of([label, encoder, machine, more])}"
    rows = [
        metric(*RANKED[protocol], error),
        metric("missed", "all", 0.01),
        metric("spurious", "all", 0.002),
        *(metric(*row) for row in metrics),
    ]
    record: dict[str, Any] = {
        "schema": 1,
        "name": name,
        "created": f"2026-01-0{1 + seed}T00:00:00+00:00",
        "protocol": {
            "id": loaded.spec.id,
            "version": loaded.spec.version,
            "hash": loaded.hash,
            "title": loaded.spec.title,
        },
        "model": {
            "name": model,
            "parameters": {"width": 16, **(settings or {})},
            "settings": [*(settings or {})],
        },
        "regime": regime,
        "encoder": None if encoder is None else {"name": encoder, "parameters": {}, "settings": []},
        "sensor": {
            "name": "tactip-127",
            "origin": origin,
            "parameters": {"instance": 0, "tier": "auto", **(sensor or {})},
            "settings": [*(sensor or {})],
        },
        "seed": seed,
        "partial": False,
        "limits": {"quick": False, "limit": None},
        "identity": {
            "weights_hash": f"cd{seed}",
            "predictions_hash": "",
            "stored": {"predictions": ""},
            "data": [f"frames of {label[1]}"],
            "sensor": {"name": "tactip-127"},
        },
        "environment": {"cpu": "AMD EPYC", "cores_logical": 2, "fingerprint": machine},
        "metrics": rows,
        "speed": [
            {
                "scenario": "single",
                "threads": threads,
                "batch": 1,
                "phase": "total",
                "p50_ms": 0.9 * p90_ms,
                "p90_ms": p90_ms,
                "p99_ms": 1.2 * p90_ms,
                "mean_ms": p90_ms,
                "per_s": 1000 / p90_ms,
                "settled": True,
            }
            for threads in (1, 2)
        ],
        "timed": {},
        "training": {"epochs": 20, "seconds": 240.0, "presses": 3600, "history": [1], "notes": {}},
        "data": {"train": 3600, "validation": 400, "test": 1000},
        "signature": f"protocol:{loaded.label}|model:{label[0]}|regime:{regime}|"
        f"encoder:{encoder or 'none'}|sensor:{label[1]}|seed:{seed}|version:0",
    }
    return Record.model_validate({**record, **more})


def hash_of(value: Any) -> str:
    from tactibench.records import digest

    return digest(value)[:8]


def _labelled(name: str, settings: Mapping[str, Any] | None) -> str:
    other = ",".join(f"{key}={value}" for key, value in (settings or {}).items())
    return f"{name}({other})" if other else name


@pytest.fixture(scope="session")
def fabricate() -> Callable[..., Record]:
    """See ``fabricated``."""
    return fabricated
