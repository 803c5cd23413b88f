"""Notes on published tables against the tables themselves."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.board.claims import check_claims, implied, unclaimed
from tactibench.board.published import Claim, PublishedTable, load_published, published_names

FOLDER = Path(__file__).parents[2] / "leaderboards" / "published"


def made(notes, claims, **metrics):
    row = {
        "protocol": "exp1",
        "model": "net",
        "source": "Table I",
        "n": 1210,
        "decimals": 4,
        "comparable": "no",
        "note": "another sensor",
        "metrics": metrics
        or {"rmse_mm": {"x": 0.1, "y": 0.2, "z": 0.2, "mean": 0.1667}, "r2": {"z": 0.99}},
    }
    return PublishedTable(
        schema_version=1,
        name="t",
        title="t",
        authors="a",
        year=2020,
        measured_on="m",
        notes=notes,
        claims=claims,
        rows=[row],
    )


@pytest.mark.parametrize("name", published_names(FOLDER))
def test_the_shipped_notes_hold_and_are_claimed(name: str) -> None:
    (table,) = load_published([name], FOLDER)
    assert table.claims
    assert [c.subject for c in check_claims(table) if not c.agrees] == []
    assert {claim.note for claim in table.claims} == set(range(1, len(table.notes) + 1))
    assert set(unclaimed(table)) <= {(3, "1,000")}  # what the text says, no value of a table


@pytest.mark.parametrize(
    ("quantity", "more", "value"),
    [
        ("printed", {"row": 1, "metric": "rmse_mm", "group": "x"}, 0.1),
        ("printed, %", {"row": 1, "metric": "r2", "group": "z"}, 99),
        ("n", {"row": 1}, 1210),
        ("mean of axes", {"row": 1, "metric": "rmse_mm"}, 0.5 / 3),
        ("root mean square of axes", {"row": 1, "metric": "rmse_mm"}, math.sqrt(0.09 / 3)),
        ("target sd", {"row": 1, "group": "z"}, 2.0),
        ("target sd, least", {"row": 1, "group": "z"}, 0.19995 / math.sqrt(0.01005)),
        ("target sd, most", {"row": 1, "group": "z"}, 0.20005 / math.sqrt(0.00995)),
        ("half width of uniform targets", {"row": 1, "group": "z"}, 2 * math.sqrt(3)),
        ("sd of uniform targets", {"values": (0, 12)}, math.sqrt(12)),
        ("kept, %", {"values": (160, 5000)}, 96.8),
    ],
)
def test_every_quantity_by_its_closed_form(quantity: str, more, value: float) -> None:
    says = f"{value:,.4f}"
    claim = Claim(note=1, says=says, quantity=quantity, **more)
    (checked,) = check_claims(made([f"It is {says} here."], [claim]))
    assert checked.agrees, checked
    other = claim.model_copy(update={"says": f"{value + 0.001:,.4f}"})
    (checked,) = check_claims(made([f"It is {other.says} here."], [other]))
    assert checked.in_note
    assert not checked.agrees


def test_a_note_that_was_changed_alone_disagrees() -> None:
    claim = Claim(note=1, says="0.1667", quantity="mean of axes", row=1, metric="rmse_mm")
    for note in ("It is 0.1668.", "It is 10.1667.", "It is 0.16672."):
        (checked,) = check_claims(made([note], [claim]))
        assert (checked.in_note, checked.found) == (False, "0.1667")


def test_words_of_aggregation() -> None:
    claim = Claim(note=1, says="mean", quantity="aggregation", row=1, metric="rmse_mm")
    (checked,) = check_claims(made(["This is the mean of its axes."], [claim]))
    assert checked.agrees


def test_rows_that_cannot_share_a_test_set_are_found() -> None:
    """y of the two rows of exp1 disagrees beyond rounding too, though no note says so."""
    (table,) = load_published(["tactiverse"], FOLDER)
    ratios = {f.group: f.value for f in implied(table) if f.metric == "target_sd_ratio"}
    assert set(ratios) == {"y", "z"}
    low = 0.09815 / math.sqrt(1 - 0.99925) / (0.12705 / math.sqrt(1 - 0.99855))
    assert ratios["y"] == pytest.approx(low)


@pytest.mark.parametrize(
    ("claim", "words"),
    [
        ({"note": 2, "quantity": "n", "row": 1}, "key note is 2, but there are 1"),
        ({"note": 1, "quantity": "n", "row": 7}, "key row is 7, but there are 1"),
        ({"note": 1, "quantity": "n"}, "is of a row; name it with key row"),
        ({"note": 1, "quantity": "kept, %"}, "needs two numbers, it has 0"),
        (
            {"note": 1, "quantity": "printed", "row": 1, "metric": "mae_mm", "group": "x"},
            "prints no mae_mm of x",
        ),
    ],
)
def test_claims_about_nothing(claim, words: str) -> None:
    with pytest.raises(UserError, match=words):
        check_claims(made(["A note."], [Claim(says="1", **claim)]))
