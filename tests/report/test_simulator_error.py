"""The line of the simulator's own error: for a run, on a board, where nothing is known."""

from __future__ import annotations

from typing import Any

import pytest

from tactibench.protocols import load_protocol
from tactibench.records import Record, SimulatorError
from tactibench.report import error_line, first_line
from tactibench.report.board_page import board_page

NUMBERS = {"median_mm": 0.0792, "p95_mm": 0.1532, "max_mm": 0.2208}
NOTHING = dict.fromkeys(NUMBERS)
LINE = "median 0.079, 95 % 0.153, at most 0.221 mm"


def error(name: str = "pairs", scenes: int = 1200, unknown: int = 0, **more: Any) -> SimulatorError:
    return SimulatorError(name=name, scenes=scenes, unknown=unknown, **{**NUMBERS, **more})


def with_errors(record: Record, *errors: SimulatorError) -> Record:
    data = record.data.model_copy(update={"simulator": list(errors)})
    return record.model_copy(update={"data": data})


@pytest.mark.parametrize(
    ("errors", "line"),
    [
        ([error()], f"simulator's own error at a pin, against finite elements: {LINE}"),
        (
            [error(), error("catch", 120, median_mm=0.02, p95_mm=0.0277, max_mm=0.028)],
            f"simulator's own error at a pin, against finite elements: pairs {LINE}; "
            "catch median 0.020, 95 % 0.028, at most 0.028 mm",
        ),
        (
            [error(unknown=1100)],
            f"simulator's own error at a pin, against finite elements: {LINE} "
            "(not known of 1,100 of 1,200 scenes)",
        ),
        ([error(unknown=1200, **NOTHING)], "simulator's own error at a pin: not known"),
        (
            [error(), error("plates", 10, 10, **NOTHING)],
            f"simulator's own error at a pin, against finite elements: pairs {LINE}; "
            "plates not known",
        ),
        (
            [
                *(error(f"f{k}", 50, median_mm=0.01 * k) for k in range(1, 5)),
                error("sharp", 50, 50, **NOTHING),
            ],
            "simulator's own error at a pin, against finite elements: median 0.010 to 0.040 by "
            "family, at most 0.221 mm (not known of 50 of 250 scenes)",
        ),
        ([], ""),
    ],
)
def test_the_line(record: Any, errors: list[SimulatorError], line: str) -> None:
    assert error_line(with_errors(record("exp2"), *errors)) == line


def test_a_run_shows_the_line_once(record: Any, render: Any) -> None:
    shown = with_errors(record("exp2"), error())
    assert " ".join(render(shown, 80).split()).count(LINE) == 1
    assert "own error" not in render(record("exp2"), 80)


def test_a_board_shows_the_line_of_the_first_row_that_has_one(fabricate: Any) -> None:
    """Rows of one section are tested on the same scenes; older rows do not have the line."""
    old = fabricate(seed=0)
    new = with_errors(fabricate(seed=1), error())
    assert first_line([old, new]) == error_line(new)
    assert first_line([old]) == ""
    page = board_page(load_protocol("exp1"), [old, new], ()).markdown()
    assert page.count(LINE) == 1
    assert "own error" not in board_page(load_protocol("exp1"), [old], ()).markdown()


def test_a_name_from_a_record_is_no_markup(fabricate: Any) -> None:
    hostile = with_errors(fabricate(), error("<b>|x"), error("y"))
    page = board_page(load_protocol("exp1"), [hostile], ()).markdown()
    assert "<b>" not in page
