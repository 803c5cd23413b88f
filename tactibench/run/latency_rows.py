"""Raw times into the rows that the record and the tables hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactibench.run.latency import LatencySample


def speed_rows(sample: LatencySample, scenario: str) -> list[dict[str, Any]]:
    """One row per phase and one for the phase "total", times in ms per call.

    per_s is the same in every row: frames per second of the whole call, from its mean. Quantiles
    interpolate linearly. p50 <= p90 <= p99 always; the quantiles of phases do not add up.
    """
    whole = sample.total_ms
    per_s = 1e3 * sample.batch / float(whole.mean()) if whole.any() else float("inf")
    columns = {name: sample.raw_ms[:, k] for k, name in enumerate(sample.phases)}
    rows = []
    for phase, times in {**columns, "total": whole}.items():
        p50, p90, p99 = (float(q) for q in np.quantile(times, (0.5, 0.9, 0.99)))
        rows.append(
            {
                "scenario": scenario,
                "threads": sample.threads,
                "batch": sample.batch,
                "phase": phase,
                "p50_ms": p50,
                "p90_ms": p90,
                "p99_ms": p99,
                "mean_ms": float(times.mean()),
                "per_s": per_s,
                "settled": sample.settled,
            }
        )
    return rows
