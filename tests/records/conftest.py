"""A small record that keeps every invariant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactibench.records import PARTS, Arrays, Record, arrays_hash


def row(metric: str, group: str = "all", value: float | None = 0.5, **more: Any) -> dict[str, Any]:
    low = None if value is None else value - 0.1
    high = None if value is None else value + 0.1
    base = {"metric": metric, "group": group, "value": value, "low": low, "high": high}
    return {**base, "n": 9, "clusters": 3, "unit": "mm", "better": "lower", **more}


@pytest.fixture
def parts() -> dict[str, Arrays]:
    return {name: {"values": np.arange(4.0) + i} for i, name in enumerate(PARTS)}


@pytest.fixture
def values(parts: dict[str, Arrays]) -> dict[str, Any]:
    """The JSON values of a record."""
    return {
        "schema": 1,
        "name": "exp1-mean-single-s0-01234567",
        "created": "2026-01-01T00:00:00+00:00",
        "protocol": {"id": "exp1", "version": 1, "hash": "ab", "title": "single"},
        "model": {"name": "mean", "parameters": {"size": 3}, "settings": []},
        "regime": "single",
        "encoder": None,
        "sensor": {
            "name": "tactip-127",
            "origin": "simulated",
            "parameters": {"noise": True},
            "settings": [],
        },
        "seed": 0,
        "partial": False,
        "limits": {"quick": False, "limit": None},
        "identity": {
            "weights_hash": "cd",
            "predictions_hash": arrays_hash(parts["predictions"]),
            "stored": {"predictions": arrays_hash(parts["predictions"])},
            "code": "ef",
        },
        "environment": {},
        "metrics": [
            row("mae_mm", "x"),
            row("rmse_mm", "x", 0.6),
            row("missed"),
            row("r2", value=None),
        ],
        "speed": [
            {
                "scenario": "single",
                "threads": 1,
                "batch": 1,
                "phase": "total",
                "p50_ms": 1.0,
                "p90_ms": 2.0,
                "p99_ms": 3.0,
                "mean_ms": 1.2,
                "per_s": 800.0,
                "settled": True,
            },
        ],
        "timed": {},
        "training": {},
        "data": {},
        "signature": "protocol:exp1@1",
    }


@pytest.fixture
def record(values: dict[str, Any]) -> Record:
    """A record ready for ``write_run``."""
    return Record.model_validate(values)
