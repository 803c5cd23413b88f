"""What a run prints: complete, readable at 80 columns, and honest about where numbers are from.

One long file: every test renders the same synthetic records, which are built here.
"""

from __future__ import annotations

import copy
import io
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tactibench.board.published import load_published
from tactibench.cli.report import print_record
from tactibench.cli.report.cells import aligned, estimate, number
from tactibench.cli.report.origin import partial_line

FOLDER = Path(__file__).parents[2] / "leaderboards" / "published"
TABLES = load_published(["tactiverse", "tac-vgnn"], FOLDER)
UNITS = {
    "r2": "",
    "resolved": "share",
    "missed": "share",
    "catch_resolved": "share",
    "coverage": "share",
    "spurious": "per frame",
    "d_prime": "",
    "rmse_over_bound": "",
    "orientation_mae_deg": "deg",
    "tilt_mae_deg": "deg",
}
DISTANCES = [f"{6.5 + k / 2:.1f}" for k in range(12)]


def row(
    metric: str,
    group: str,
    value: float | None,
    spread: float = 0.03,
    n: int = 1000,
    clusters: int = 1000,
    **more: Any,
) -> dict[str, Any]:
    low, high = (None, None) if value is None else (value - spread, value + spread)
    if UNITS.get(metric) == "share" and value is not None:
        low, high = max(0.0, value - spread), min(1.0, value + spread)
    return {
        "metric": metric,
        "group": group,
        "value": value,
        "low": low,
        "high": high,
        "n": n,
        "clusters": clusters,
        "unit": UNITS.get(metric, "mm"),
        "better": "lower",
        **more,
    }


def exp1() -> list[dict[str, Any]]:
    rows = [row("r2", a, 0.99941 - k / 1e3, 0.0002) for k, a in enumerate(("x", "y", "z", "mean"))]
    rows += [row("mae_mm", a, 0.0412 + k / 100, 0.0014) for k, a in enumerate("xyz")]
    rows += [row("mae_mm", "mean", 0.0512, 0.0011)]
    rows += [row("rmse_mm", a, 0.0531 + k / 100, 0.0031) for k, a in enumerate("xyz")]
    rows += [
        row("rmse_mm", "mean", 0.0634, 0.0021),
        row("rmse_pooled_mm", "all", 0.0641, 0.0022),
        row("surface_rmse_mm", "all", 0.2113, 0.004),
    ]
    rows += [row("rmse_over_bound", a, 3.14 + k, 0.2) for k, a in enumerate("xyz")]
    return [*rows, row("missed", "all", 0.0, 0.0037), row("spurious", "all", 0.0021, 0.001)]


def exp2(resolved: float = 0.6) -> list[dict[str, Any]]:
    rows = []
    for k, d in enumerate(DISTANCES):
        share = min(1.0, resolved + k * 0.05) if resolved else 0.0
        n = round(100 * share)
        error = None if not n else 0.92 - 0.05 * k
        rows += [
            row("distance_mae_mm", d, error, 0.07, n, n),
            row(
                "distance_penalised_mm",
                d,
                (1 - share) * float(d) + (error or 0) * share,
                0.4,
                100,
                100,
            ),
            row("resolved", d, share, 0.07, 100, 100),
            row("orientation_mae_deg", d, None if not n else 8.2 - 0.4 * k, 0.6, n, n),
        ]
    n = round(1200 * resolved)
    some = None if not n else 0.652
    rows += [
        row("distance_mae_mm", "all", some, 0.021, n, n),
        row("distance_penalised_mm", "all", 1.934, 0.11, 1200, 1200),
        row("resolved", "all", resolved, 0.02, 1200, 1200),
        row("threshold_mm", "all", 6.5, 0.2, 1200, 1200, censored="<"),
        row("catch_resolved", "all", 0.008, 0.01, 120, 120),
        row("d_prime", "all", 3.41, 0.4, 1320, 1320),
        row("orientation_mae_deg", "all", None if not n else 5.31, 0.2, n, n),
    ]
    rows += [
        row(m, "all", v, 0.01, 2200, 1200)
        for m, v in (
            ("position_mean_mm", 0.361),
            ("position_ungated_mm", 0.912),
            ("depth_mae_mm", 0.204),
            ("gospa1_mm", 0.891),
            ("gospa2_mm", 1.21),
            ("missed", 0.081),
            ("spurious", 0.031),
            ("surface_rmse_mm", 0.311),
        )
    ]
    return rows


def exp3() -> list[dict[str, Any]]:
    rows = []
    for metric, v in (
        ("position_mean_mm", 0.408),
        ("position_ungated_mm", 0.71),
        ("depth_mae_mm", 0.164),
        ("relative_depth_mae_mm", 0.21),
        ("gospa1_mm", 0.9),
        ("gospa2_mm", 1.1),
        ("missed", 0.021),
        ("spurious", 0.017),
        ("surface_rmse_mm", 0.33),
    ):
        for group, true, presses in (
            ("dual", 2000, 1000),
            ("triple", 3000, 1000),
            ("all", 5000, 2000),
        ):
            n = round(0.979 * true) if metric in {"position_mean_mm", "depth_mae_mm"} else true
            rows.append(row(metric, group, v, 0.012, n, presses))
    return rows


def surface() -> list[dict[str, Any]]:
    return [
        row("depth_mae_mm", "all", 0.0561, 0.0021, 1210, 1210),
        row("tilt_mae_deg", "all", 1.134, 0.05, 1210, 1210),
        row("coverage", "all", 1.0, 0.003, 1210, 1210),
    ]


METRICS = {"exp1": exp1, "exp2": exp2, "exp3": exp3, "surface": surface}
TITLES = {
    "exp1": "single-point sensing",
    "exp2": "two-point discrimination",
    "exp3": "position and depth of several tips",
    "surface": "depth and tilt of a plate",
}


def record(protocol: str, **changes: Any) -> dict[str, Any]:
    real = protocol == "surface"
    speed = [
        {
            "scenario": "single",
            "threads": t,
            "batch": 1,
            "phase": phase,
            "p50_ms": ms / t,
            "p90_ms": 1.2 * ms / t,
            "p99_ms": 1.9 * ms / t,
            "mean_ms": 1.05 * ms / t,
            "per_s": 950 * t / 6.3,
            "settled": True,
        }
        for t in (1, 2)
        for phase, ms in (("preprocess", 0.09), ("forward", 5.4), ("decode", 0.81), ("total", 6.3))
    ]
    made = {
        "schema": 1,
        "name": f"{protocol}-unet-single-1f00",
        "regime": None if real else "single",
        "protocol": {
            "id": protocol,
            "version": 1,
            "hash": "0123456789ab",
            "title": TITLES[protocol],
        },
        "model": {"name": "cnn" if real else "unet", "parameters": {"width": 16}},
        "encoder": None if real else {"name": "hertz", "parameters": {}},
        "sensor": {
            "name": "recorded" if real else "tactip-127",
            "parameters": {},
            "origin": "real" if real else "simulated",
        },
        "seed": 0,
        "partial": False,
        "limits": {"quick": False, "limit": None},
        "identity": {"data": "ab12"},
        "environment": {
            "cpu": "Intel(R) Xeon(R) Processor @ 2.10GHz",
            "threads": 2,
            "fingerprint": "0a1b2c3d4e5f",
        },
        "metrics": METRICS[protocol](),
        "speed": speed,
        "timed": {"configuration": "bfloat16, channels_last, batch 1", "difference_mm": 0.0012},
        "training": {"epochs": 20, "seconds": 241.3, "presses": 3600},
        "data": {
            "train": 3600,
            "validation": 400,
            "test": 1320,
            "rejected": 0 if real else 2417,
            "published_frames": real,
        },
        "signature": f"tactibench 0.1.0|{protocol}@1#0123456789ab|unet#77aa|hertz|tactip-127|"
        "seed 0|data ab12|weights 0a1b2c3d|code 91bc205",
        "path": f"experiments/of/a/long/name/tactile/runs/{protocol}-unet-single-1f00/record.json",
    }
    made.update(changes)
    return made


def render(shown: dict[str, Any], width: int = 80, others: Any = (), tables: Any = TABLES) -> str:
    console = Console(file=io.StringIO(), width=width, force_terminal=False)
    print_record(console, shown, tables, others)
    return console.file.getvalue()  # type: ignore[attr-defined]


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\d[\d,.]*\d|\d", text))


PROTOCOLS = sorted(METRICS)


@pytest.mark.parametrize("width", [80, 100, 120])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_nothing_is_cut_and_tables_keep_to_the_width(protocol: str, width: int) -> None:
    shown = record(protocol)
    text = render(shown, width, [record(protocol, name="other", regime="multiple")])
    assert "…" not in text
    long = {shown["signature"], f"record: {shown['path']}"}
    assert long < set(text.splitlines())
    assert all(len(line) <= width for line in text.splitlines() if line not in long)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_metric_is_shown_with_its_interval(protocol: str) -> None:
    shown = record(protocol)
    for k, one in enumerate(shown["metrics"]):  # so that no row can stand in for another
        one.update(value=0.3017 + k / 100, low=0.2917 + k / 100, high=0.3117 + k / 100)
    text = " ".join(render(shown, 120).split())
    for one in shown["metrics"]:
        if one.get("censored"):
            continue
        options = {estimate(one, decimals) for decimals in range(5)}
        assert any(option in text for option in options), one


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_terminal_that_is_too_narrow_loses_no_number(protocol: str) -> None:
    def unbroken(width: int) -> set[str]:
        shown = record(protocol, name="r", signature="s", path="p")
        return numbers(render(shown, width))

    assert unbroken(50) == unbroken(80)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_measured_and_published_rows_stand_under_their_origin(protocol: str) -> None:
    lines = render(record(protocol)).splitlines()
    origin = "real sensor recorded" if protocol == "surface" else "simulated sensor tactip-127"
    measured = [k for k, line in enumerate(lines) if line.startswith("measured here:")]
    papers = [k for k, line in enumerate(lines) if line.startswith("published: hardware TacTip")]
    assert all(origin in lines[k] for k in measured)
    assert len(papers) == 1
    assert papers[0] > max(measured)


def test_published_values_have_the_digits_of_the_paper() -> None:
    text = render(record("exp1"))
    assert re.search(r"^x +0\.9994 +0\.0713 +0\.0908 *$", text, re.M)  # CNN
    assert re.search(r"^mean +0\.9972 +0\.0589 +0\.1282 *$", text, re.M)  # U-Net
    plate = render(record("surface"))
    assert re.search(r"^all +0\.0552 +1\.011 +96\.8 +1,210 *$", plate, re.M)
    assert re.search(r"^dual +2\.24 +0\.71 +n/a +725 *$", render(record("exp3")), re.M)


def test_a_simulated_run_is_never_called_comparable() -> None:
    shown = record("surface")
    assert "Comparable: Frame for frame" in render(shown)
    shown["sensor"]["origin"] = "simulated"
    assert "Not comparable (simulated here): Frame for frame" in render(shown)


def test_other_test_frames_are_never_called_comparable() -> None:
    shown = record("surface")
    shown["data"]["published_frames"] = False
    assert "Comparable: Frame for frame" not in render(shown)
    assert "not tested on the published test frames" in " ".join(render(shown).split())


def test_a_model_that_resolves_nothing_shows_na_and_its_misses() -> None:
    text = render(record("exp2", metrics=exp2(resolved=0.0)))
    assert re.search(r"^6\.5 +0 \[0, 7\] +n/a +6\.50 \[6\.10, 6\.90\] +n/a +0/100", text, re.M)
    assert "None" not in text
    assert "nan" not in text


def test_a_censored_threshold_is_a_limit() -> None:
    assert re.search(r"two-point threshold \(75 %\), mm +< 6\.5 ", render(record("exp2")))
    assert estimate(row("threshold_mm", "all", 12.0, censored=">"), 3) == "> 12"


@pytest.mark.parametrize(
    ("limits", "line"),
    [
        ({"quick": True, "limit": None}, "PARTIAL (quick): not for a board"),
        ({"quick": False, "limit": 50}, "PARTIAL (limit 50): not for a board"),
        ({"quick": True, "limit": 50}, "PARTIAL (quick, limit 50): not for a board"),
        ({"quick": False, "limit": None}, "PARTIAL: not for a board"),
    ],
)
def test_a_partial_run_says_so_above_and_below(limits: dict[str, Any], line: str) -> None:
    lines = render(record("exp1", partial=True, limits=limits)).splitlines()
    places = [k for k, text in enumerate(lines) if text == line]
    assert len(places) == 2
    assert lines[places[1] + 1].startswith("tactibench 0.1.0|")
    assert partial_line(record("exp1", limits=limits)) is None


def test_only_runs_of_the_same_question_stand_beside_and_partial_ones_are_marked() -> None:
    shown = record("exp2")
    newer = copy.deepcopy(record("exp2", name="newer"))
    newer["protocol"]["version"] = 2
    cut = record("exp2", name="cut", partial=True, limits={"quick": True, "limit": None})
    text = render(shown, 120, [shown, newer, cut, record("exp1", name="else")])
    assert re.findall(r"stored as (\S+)", text) == ["cut;"]
    assert "stored as cut; PARTIAL (quick): not for a board" in text


def test_many_stored_runs_do_not_hide_the_run() -> None:
    text = render(record("exp2"), 80, [record("exp2", name=f"r{k}") for k in range(9)])
    assert text.count("stored as") == 6
    assert "3 more stored runs of exp2 are not shown" in text


def test_speed_names_phases_threads_and_the_difference_to_float32() -> None:
    text = render(record("exp2"))
    assert re.search(r"^single +1 +1 +preprocess +0\.09 +0\.11 +0\.17 *$", text, re.M)
    assert re.search(r"^ +total +6\.30 +7\.56 +11\.97 +151 *$", text, re.M)
    assert "p90: 7.56 ms on 1 thread, 3.78 ms on 2 threads" in text
    assert "scored: 0.0012 mm" in " ".join(text.split())
    assert "offline (larger batches): none" in text
    assert "NOT SETTLED" not in text


def test_times_that_did_not_settle_and_missing_times_are_told() -> None:
    shown = record("exp1")
    shown["speed"][0]["settled"] = False
    shown["timed"] = {
        "configuration": "bfloat16",
        "difference_mm": None,
        "frames": 200,
        "frames_with_another_count": 3,
    }
    text = " ".join(render(shown).split())
    assert "NOT SETTLED" in text
    assert "scored: n/a, and another number of contacts in 3 of 200 frames" in text
    assert "p90: not timed" in render(record("exp1", speed=[], timed=None))


def test_what_was_raced_and_what_the_model_costs_are_told() -> None:
    shown = record("exp1")
    other = {"frames": 200, "frames_with_another_count": 0, "difference_mm": 0.0}
    shown["timed"] = {
        **other,
        "configuration": "frozen",
        "error_change": -0.0034,
        "raced": [
            {**other, "configuration": "folded", "p50_ms": 6.0, "error_change": 0.0},
            {**other, "configuration": "frozen", "p50_ms": 5.0, "error_change": 0.0},
        ],
    }
    shown["efficiency"] = {
        "parameters": 1944625,
        "flops_per_frame": 395575296,
        "peak_memory_mb": 412.4,
        "training_s": 301.2,
    }
    text = " ".join(render(shown).split())
    assert "timed: frozen; difference" in text
    assert "(mean error -0.3 %)" in text
    assert "chosen from, p50 on 1 thread: 6.00 ms folded; 5.00 ms frozen" in text
    assert (
        "cost: 1,944,625 weights, 0.396 GFLOP a frame, "
        "peak memory of the process 412 MB, training 301 s"
    ) in text
    shown["efficiency"] = dict.fromkeys(shown["efficiency"])
    assert "cost: weights n/a, operations n/a, peak memory n/a" in " ".join(render(shown).split())


def test_batches_are_one_line_each_and_drift_names_its_scenario() -> None:
    shown = record("exp1")
    single = shown["speed"][0]
    batch = {**single, "scenario": "offline", "batch": 32, "threads": 2, "settled": False}
    shown["speed"] += [batch, {**batch, "phase": "total", "per_s": 812.4}]
    text = render(shown)
    assert re.search(r"^offline +32 +2 +total .* 812 *$", text, re.M)
    assert len(re.findall(r"^offline ", text, re.M)) == 1
    assert "NOT SETTLED: times of offline (batch 32, 2 threads) still" in " ".join(text.split())
    assert "offline (larger batches): none" not in text


def test_a_published_speed_names_its_machine() -> None:
    text = " ".join(render(record("surface")).split())
    assert "published: Tac-VGNN, graph construction 18.7 per s on laptop, another machine" in text


def test_a_protocol_without_a_layout_is_listed_whole() -> None:
    shown = record("exp3")
    shown["protocol"]["id"] = "mine"
    text = render(shown)
    assert text.count("\n") > len(shown["metrics"])
    assert "published" not in text


def test_markup_in_names_is_text() -> None:
    assert "[bold]x[/bold]" in render(record("exp1", signature="[bold]x[/bold]"))


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(0.0003, 3, "3e-04"), (0.0, 3, "0.000"), (0.0005, 3, "0.001"), (1234.5, 1, "1,234.5")],
)
def test_small_values_do_not_become_zero(value: float, decimals: int, text: str) -> None:
    if value == 0.0005:  # on the border either rounding is right, vanishing is not
        assert number(value, decimals) in {"0.001", "0.000", "5e-04"}
    else:
        assert number(value, decimals) == text


def test_open_and_missing_intervals() -> None:
    half = {**row("threshold_mm", "all", 7.25), "low": None}
    assert estimate(half, 2) == "7.25 [open, 7.28]"
    assert estimate({**half, "high": None}, 2) == "7.25 [n/a]"
    assert estimate(None, 2) == "n/a"


def test_values_stand_under_each_other() -> None:
    assert aligned(["9.5 [9, 10]", "12.0 [11, 13]", "n/a"]) == [
        " 9.5 [9, 10]",
        "12.0 [11, 13]",
        " n/a",
    ]
