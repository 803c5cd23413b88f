"""The first output of a run: about ten lines, and one that places it."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tactibench.board import Placement, Row, ranking_error
from tactibench.records import Metric, Record
from tactibench.report import TERMS, anchor, misses_line, place_line, print_summary, speed_line

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path("runs/somewhere")
BOARD = Path("leaderboards")


@pytest.fixture(autouse=True)
def in_folder_with_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is next depends on the boards that are there."""
    monkeypatch.chdir(tmp_path)
    BOARD.mkdir()
    Path("lab").mkdir()


def placed(
    record: Record, place: Placement | None, folder: Path = FOLDER, board: Path = BOARD
) -> str:
    return place_line(record, folder, place, board)


def summary(record: Record, place: Placement | None = None, *, terminal: bool = False) -> str:
    console = Console(file=io.StringIO(), width=80, force_terminal=terminal)
    print_summary(console, record, FOLDER, place, BOARD)
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize("protocol", ["exp1", "exp2", "exp3", "surface"])
def test_about_ten_lines_with_misses_speed_place_and_the_rest(
    record: Callable[..., Record], protocol: str
) -> None:
    made = record(protocol)
    lines = summary(made).splitlines()
    assert 8 <= len(lines) <= 13
    assert lines[0].startswith(f"{protocol}  ")
    for begin in ("misses: ", "speed: ", "place: ", "more: "):
        assert sum(line.startswith(begin) for line in lines) == 1
    assert lines[-1].startswith("place: ")
    assert "--full" in lines[-2]
    assert str(FOLDER) in lines[-2]
    assert lines[-2].endswith("docs/glossary.md")
    assert made.signature in lines
    assert not any("published" in line or "stored as" in line for line in lines)


def test_a_protocol_without_tables_shows_its_first_metrics(
    record: Callable[..., Record], row: Callable[..., Metric]
) -> None:
    made = record("exp1").model_copy(deep=True)
    made.protocol.id = "mine"
    text = summary(made)
    assert "value [95 % interval]" in text
    assert "misses: missed " in text


def test_a_partial_run_says_so_and_has_no_rank(fabricate: Callable[..., Record]) -> None:
    made = fabricate(partial=True, limits={"quick": True, "limit": 10})
    assert "PARTIAL (quick, limit 10): not for a board" in summary(made)
    line = placed(made, None)
    assert line.startswith("place: no rank, a shortened run is on no board")
    assert "without --quick and --limit" in line


def test_the_place_names_the_row_above(fabricate: Callable[..., Record]) -> None:
    ranking, above = ranking_error("exp1"), Row((fabricate(model="cnn", error=0.0412),))
    made = fabricate(metrics=tuple(("rmse_over_bound", axis, value) for axis, value in RATIOS))
    line = placed(made, Placement(ranking, 3, 9, above))
    assert "rank 3 of 9 by GOSPA (p = 1), above it cnn + hertz (single) 0.0412" in line
    assert "RMSE 1.50 to 1,021 times the bound" in line
    assert line.endswith(f"next: `tactibench board add {made.name}`")
    assert "rank 1 of 9 by GOSPA (p = 1), nothing above" in placed(
        made, Placement(ranking, 1, 9, None)
    )
    assert "no rank yet, which takes 3 seeds and 20 presses, above it cnn" in placed(
        made, Placement(ranking, None, 9, above)
    )


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
    place = Placement(ranking_error("exp1"), 1, 9, None, committed=True) if committed else None
    line = placed(made, place, Path(store) / made.name, Path(board))
    assert line.endswith(hint.replace("NAME", made.name))


RATIOS = (("x", 1.5), ("y", 20.0), ("z", 1021.3))


def test_pairs_are_held_against_the_limit(
    record: Callable[..., Record], row: Callable[..., Metric]
) -> None:
    made = record("exp2")
    made.metrics.append(
        Metric.model_validate(
            {**made.metrics[0].json_values(), "metric": "limit_mm", "group": "all", "value": 0.34}
        )
    )
    assert ", limit 0.34 mm" in placed(made, None)


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


def test_misses_that_nobody_measured(fabricate: Callable[..., Record]) -> None:
    assert misses_line(fabricate()).startswith("misses: missed 1.0 [0.9, 1.1] %, spurious 0.002")
    none = fabricate().model_copy(update={"metrics": []})
    assert misses_line(none) == "misses: not measured"


def test_a_value_without_an_interval_is_explained(fabricate: Callable[..., Record]) -> None:
    made = fabricate(metrics=(("r2", "mean", -0.01),))
    r2 = made.metric("r2", "mean")
    assert r2 is not None
    r2.unit, r2.low, r2.high, r2.n, r2.clusters = "", None, None, 10, 10
    text = summary(made)
    assert "-0.0100 [none]" in text
    assert "[none]: no interval." in text
    r2.value = r2.low = r2.high = 0.99999
    text = summary(made)
    assert "1.0000 [" not in text, "an interval narrower than its last digit"
    assert "[none]" not in text


def test_words_lead_to_the_glossary(fabricate: Callable[..., Record]) -> None:
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    for word in TERMS.values():
        assert f'<a id="{anchor(word)}"></a>' in page, word
    links = summary(fabricate(), terminal=True)
    assert f"{(ROOT / 'docs' / 'glossary.md').as_uri()}#missed" in links
    assert "file:" not in summary(fabricate())


def test_all_of_a_run_is_printed_on_demand(cli: Any, tmp_path: Path) -> None:
    assert cli("run", "--help")[1].count("--full") >= 1
    assert cli("score", "--help")[1].count("--full") >= 1
