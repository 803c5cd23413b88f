"""A run as it is printed, in ten lines and whole: readable at 80 columns, honest about numbers."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tactibench.board import Placement, RankInterval, Row, compact, ranking_error
from tactibench.records import Record, SimulatorError, text_of
from tactibench.report import (
    error_line,
    metric_number,
    partial_line,
    place_line,
    print_summary,
    speed_line,
)

PROTOCOLS = ["exp1", "exp2", "surface"]
FOLDER = Path("runs/somewhere")
BOARD = Path("leaderboards")


@pytest.fixture(autouse=True)
def in_folder_with_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is next depends on the boards that are there."""
    monkeypatch.chdir(tmp_path)
    BOARD.mkdir()
    Path("lab").mkdir()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_run_is_printed_whole_and_narrow(
    record: Any, render: Any, protocol: str, snapshot: Any
) -> None:
    shown = record(protocol)
    text = render(shown)
    assert text == snapshot
    long = ("tactibench 0.1.0|", "record: ", "speed: ")
    assert shown.signature in text.splitlines()
    assert all(len(line) <= 84 for line in text.splitlines() if not line.startswith(long))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_run_is_printed_in_about_ten_lines(
    record: Callable[..., Record], protocol: str, snapshot: Any
) -> None:
    text = summary(record(protocol))
    assert text == snapshot
    assert 8 <= len(text.splitlines()) <= 13


def test_pictures_are_named_where_there_are_some(record: Callable[..., Record]) -> None:
    assert "; record: runs/somewhere" in summary(record("surface"))
    FOLDER.mkdir(parents=True)
    (FOLDER / "frame.png").touch()
    assert "; record and pictures: runs/somewhere" in summary(record("exp1"))


def placed(
    record: Record, place: Placement | None, folder: Path = FOLDER, board: Path = BOARD
) -> str:
    return place_line(record, folder, place, board)


def summary(record: Record, place: Placement | None = None) -> str:
    console = Console(file=io.StringIO(), width=80, force_terminal=False)
    print_summary(console, record, FOLDER, place, BOARD)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_every_metric_is_shown_with_its_interval(record: Any, render: Any) -> None:
    shown = record("exp2")
    for k, one in enumerate(shown.metrics):  # so that no row can stand in for another
        one.value, one.low, one.high = (start + k / 100 for start in (0.3017, 0.2917, 0.3117))
    text = " ".join(render(shown).split())
    for one in shown.metrics:
        if one.censored:
            continue
        options = {str(metric_number(one, decimals) or "n/a") for decimals in range(5)}
        assert any(option in text for option in options), one


def test_a_simulated_run_is_never_called_comparable(record: Any, render: Any) -> None:
    shown = record("surface")
    assert "Comparable: Frame for frame" in render(shown)
    shown.sensor.origin = "simulated"
    assert "Not comparable (simulated here): Frame for frame" in render(shown)
    shown = record("surface")
    shown.data.published_frames = False
    assert "not tested on the published test frames" in " ".join(render(shown).split())


def test_a_model_that_resolves_nothing_shows_na_and_its_misses(
    exp2: Any, record: Any, render: Any
) -> None:
    text = render(record("exp2", metrics=exp2(resolved=0.0)))
    assert re.search(r"^6\.5 +0 \[0, 7\] +n/a +6\.50 \[6\.10, 6\.90\] +n/a", text, re.M)
    assert "None" not in text
    assert "nan" not in text


def test_a_censored_threshold_is_a_limit(row: Any, record: Any, render: Any) -> None:
    assert re.search(r"two-point threshold \(75 %\), mm +all +< 6\.5 ", render(record("exp2")))
    bound = row("threshold_mm", "all", 12.0, censored=">")
    assert str(metric_number(bound, 1)) == "> 12.0"


def test_a_partial_run_says_so_above_and_below(record: Any, render: Any) -> None:
    limits = {"quick": True, "limit": 50}
    lines = render(record("exp1", partial=True, limits=limits)).splitlines()
    warning = "PARTIAL (quick, limit 50): its errors say nothing of the model, not for a board"
    assert lines.count(warning) == 2
    assert partial_line(record("exp1", limits=limits)) == ""


def test_a_protocol_without_a_layout_is_listed_whole_and_markup_is_text(
    record: Any, render: Any
) -> None:
    shown = record("exp1", signature="[bold]x[/bold]")
    shown.protocol.id = "mine"
    text = render(shown)
    assert text.count("\n") > len(shown.metrics)
    assert "published" not in text
    assert "[bold]x[/bold]" in text


def test_times_that_did_not_settle_and_missing_times_are_told(record: Any, render: Any) -> None:
    shown = record("exp1")
    offline = {"scenario": "offline", "batch": 32, "threads": 2, "settled": False}
    batch = shown.speed[0].model_copy(update=offline)
    shown.speed += [batch, batch.model_copy(update={"phase": "total", "per_s": 812.4})]
    text = render(shown)
    assert len(re.findall(r"^offline +32 +2 +total .* 812\* *$", text, re.M)) == 1
    assert "812* frames/s (*: not settled" in text
    assert "speed: not timed" in render(record("exp1", speed=[]))


def test_a_partial_run_has_no_rank(fabricate: Callable[..., Record]) -> None:
    line = placed(fabricate(partial=True, limits={"quick": True, "limit": 10}), None)
    assert line.startswith("place: no rank, a shortened run is on no board")
    assert "without --quick and --limit" in line


def test_the_place_names_the_row_above(fabricate: Callable[..., Record]) -> None:
    ranking, above = ranking_error("exp1"), Row((fabricate(model="cnn", error=0.0412),))
    made = fabricate()
    line = placed(made, Placement(ranking, RankInterval(2, 4), 9, above, None))
    assert "rank 2–4 of 9 by GOSPA, above it cnn 0.0412" in line
    assert line.endswith(f"next: `tactibench board add {made.name}`")
    assert "rank 1 of 9 by GOSPA, nothing above" in placed(
        made, Placement(ranking, RankInterval(1, 1), 9, None, None)
    )
    assert (
        "no rank yet, which takes 3 seeds in one command (--seeds 0,1,2) and 20 presses, above it "
        "cnn 0.0412; its error is larger than that of the trivial cnn;"
    ) in placed(made, Placement(ranking, None, 9, above, above))


@pytest.mark.parametrize(
    ("store", "board", "presses", "committed", "hint"),
    [
        ("runs", "leaderboards", None, False, "`tactibench board add NAME`"),
        (
            "my runs",
            "lab",
            None,
            False,
            "`tactibench board add NAME --store 'my runs' --board lab`",
        ),
        ("runs", "new", None, False, "`mkdir new && tactibench board add NAME --board new`"),
        ("old", "lab", None, True, "on the board, see `tactibench board show exp1 --board lab`"),
        ("old", "leaderboards", 250, False, "`tactibench plot curve exp1 --store old`"),
        ("runs", "lab", 250, False, "`tactibench plot curve exp1 --store runs --board lab`"),
    ],
)
def test_what_is_next_can_be_pasted(
    fabricate: Callable[..., Record],
    store: str,
    board: str,
    presses: int | None,
    committed: bool,
    hint: str,
) -> None:
    made = fabricate(limits={"presses": presses})
    if committed:
        row = Path(board) / "submissions" / "exp1" / f"{made.name}.json"
        row.parent.mkdir(parents=True, exist_ok=True)
        row.write_text(text_of(compact(made)))
    line = placed(made, None, Path(store) / made.name, Path(board))
    assert line.endswith(hint.replace("NAME", made.name))


def test_rows_of_another_sensor_are_named(fabricate: Callable[..., Record]) -> None:
    made, other = fabricate(), fabricate(sensor={"instance": 1})
    place = BOARD / "submissions" / "exp1"
    place.mkdir(parents=True)
    (place / f"{other.name}.json").write_text(text_of(compact(other)))
    assert (
        "no row was tested on these frames; its rows are of other test frames: "
        "Simulated sensor tactip-127, instance=1; next:" in placed(made, None)
    )


def test_rows_of_the_same_sensor_with_other_defaults_are_told(
    fabricate: Callable[..., Record],
) -> None:
    made, old = fabricate(), fabricate()
    old.sensor.parameters["tier"] = "static"
    place = BOARD / "submissions" / "exp1"
    place.mkdir(parents=True)
    (place / f"{old.name}.json").write_text(text_of(compact(old)))
    assert "frames: Simulated sensor tactip-127 with tier=static; next:" in placed(made, None)


def test_speed_that_drifted_or_was_not_timed(fabricate: Callable[..., Record]) -> None:
    made = fabricate(p90_ms=6.0)
    assert speed_line(made) == (
        "speed: frame to contacts, p90, 6.00 ms (1 thread), 6.00 ms (2 threads), "
        "at most 167 frames/s"
    )
    made.speed[0].settled = False
    assert "p90, 6.00* ms (1 thread), 6.00 ms (2 threads), at most" in speed_line(made)
    assert speed_line(made).endswith(" frames/s (*: not settled, is the machine busy?)")
    assert speed_line(made.model_copy(update={"speed": []})) == "speed: not timed"


def test_a_value_without_an_interval_is_explained(fabricate: Callable[..., Record]) -> None:
    made = fabricate(metrics=(("r2", "mean", -0.01),))
    r2 = made.metric("r2", "mean")
    assert r2 is not None
    r2.unit, r2.low, r2.high, r2.n, r2.clusters = "", None, None, 10, 10
    text = summary(made)
    assert "-0.0100 [none]" in text
    assert "[none]: no interval; the presses are too few" in text


def error(name: str, unknown: int = 0, **more: float | None) -> SimulatorError:
    numbers = {"median_mm": 0.0792, "p95_mm": 0.1532, "max_mm": 0.2208, **more}
    return SimulatorError(name=name, scenes=1200, unknown=unknown, **numbers)


KNOWN, NOTHING = error("pairs"), dict.fromkeys(("median_mm", "p95_mm", "max_mm"))
AGAINST = "error bound of the simulator at a pin, against finite elements: median"


@pytest.mark.parametrize(
    ("errors", "line"),
    [
        ([KNOWN], f"{AGAINST} 0.079 mm, at most 0.221 mm"),
        ([KNOWN, error("catch", median_mm=0.02)], f"{AGAINST} 0.020 to 0.079 mm, at most 0.221 mm"),
        (
            [KNOWN, error("plates", 1200, **NOTHING)],
            f"{AGAINST} 0.079 mm, at most 0.221 mm (not known for 1,200 of 2,400 scenes)",
        ),
        ([error("pairs", 1200, **NOTHING)], "error bound of the simulator at a pin: not known"),
        ([], ""),
    ],
)
def test_the_simulators_own_error(record: Any, errors: list[SimulatorError], line: str) -> None:
    shown = record("exp2")
    shown.data.simulator = errors
    assert error_line(shown) == line


def test_a_table_of_ones_own_protocol_heads_any_metric(
    record: Any, render: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = '[[run_tables]]\ntitle = "Own"\nmetrics = { gospa_depth_mm = 3 }\ngroups = ["all"]\n'
    (tmp_path / "lab" / "headed.board.toml").write_text(board, encoding="utf-8")
    (tmp_path / "lab" / "headed.toml").touch()
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(tmp_path / "lab"))
    shown = record("exp1")
    shown.protocol.id = "headed"
    assert "GOSPA, mm" in render(shown)
