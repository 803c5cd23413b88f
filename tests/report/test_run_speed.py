"""Times of a run and costs of its model, as they are printed."""

from __future__ import annotations

import re
from typing import Any


def test_speed_names_phases_threads_and_the_difference_to_float32(record: Any, render: Any) -> None:
    text = render(record("exp2"))
    assert re.search(r"^single +1 +1 +preprocess +0\.09 +0\.11 +0\.17 *$", text, re.M)
    assert re.search(r"^ +total +6\.30 +7\.56 +11\.97 +151 *$", text, re.M)
    assert "p90: 7.56 ms on 1 thread, 3.78 ms on 2 threads" in text
    assert "scored: 0.0012 mm" in " ".join(text.split())
    assert "offline (larger batches): none" in text
    assert "NOT SETTLED" not in text


def test_times_that_did_not_settle_and_missing_times_are_told(record: Any, render: Any) -> None:
    timed = {
        "configuration": "bfloat16",
        "difference_mm": None,
        "frames": 200,
        "frames_with_another_count": 3,
    }
    shown = record("exp1", timed=timed)
    shown.speed[0].settled = False
    text = " ".join(render(shown).split())
    assert "NOT SETTLED" in text
    assert "scored: n/a, and another number of contacts in 3 of 200 frames" in text
    assert "p90: not timed" in render(record("exp1", speed=[], timed={}))


def test_what_was_raced_and_what_the_model_costs_are_told(record: Any, render: Any) -> None:
    other = {"frames": 200, "frames_with_another_count": 0, "difference_mm": 0.0}
    timed = {
        **other,
        "configuration": "frozen",
        "error_change": -0.0034,
        "raced": [
            {**other, "configuration": "folded", "p50_ms": 6.0, "error_change": 0.0},
            {**other, "configuration": "frozen", "p50_ms": 5.0, "error_change": 0.0},
        ],
    }
    efficiency = {
        "parameters": 1944625,
        "flops_per_frame": 395575296,
        "peak_memory_mb": 412.4,
        "training_s": 301.2,
    }
    text = " ".join(render(record("exp1", timed=timed, efficiency=efficiency)).split())
    assert "timed: frozen; difference" in text
    assert "(mean error -0.3 %)" in text
    assert "chosen from, p50 on 1 thread: 6.00 ms folded; 5.00 ms frozen" in text
    assert (
        "cost: 1,944,625 weights, 0.396 GFLOP a frame, "
        "peak memory of the process 412 MB, training 301 s"
    ) in text
    text = " ".join(render(record("exp1", efficiency=dict.fromkeys(efficiency))).split())
    assert "cost: weights n/a, operations n/a, peak memory n/a" in text


def test_batches_are_one_line_each_and_drift_names_its_scenario(record: Any, render: Any) -> None:
    shown = record("exp1")
    single = shown.speed[0]
    offline = {"scenario": "offline", "batch": 32, "threads": 2, "settled": False}
    batch = single.model_copy(update=offline)
    shown.speed += [batch, batch.model_copy(update={"phase": "total", "per_s": 812.4})]
    text = render(shown)
    assert re.search(r"^offline +32 +2 +total .* 812 *$", text, re.M)
    assert len(re.findall(r"^offline ", text, re.M)) == 1
    assert "NOT SETTLED: times of offline (batch 32, 2 threads) still" in " ".join(text.split())
    assert "offline (larger batches): none" not in text


def test_a_published_speed_names_its_machine(record: Any, render: Any) -> None:
    text = " ".join(render(record("surface")).split())
    assert "published: Tac-VGNN, graph construction 18.7 per s on laptop, another machine" in text
