"""What cannot be true of correct measurements is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from changed_record import listed_tables

from tactibench import UserError
from tactibench.board import compact
from tactibench.records import CHECKSUM, make_signature, parse_record, text_of, with_checksum


def test_a_good_record_is_read(values: dict[str, Any]) -> None:
    valid = parse_record(json.loads(json.dumps(values)), "it")
    assert valid.value("mae_mm", "x") == 0.5
    assert valid.value("r2", "all") is None
    assert valid.value("nothing", "x") is None


@pytest.mark.parametrize("schema", [0, 2, "1", None])
def test_a_record_of_another_form_is_told_what_reads_it(
    values: dict[str, Any], schema: Any
) -> None:
    with pytest.raises(UserError, match=r"key 'schema': .* is read by commit e6a49ac9"):
        parse_record({**values, "schema": schema}, "here")


@pytest.mark.parametrize("value", [None, [], "text", 3])
def test_no_record_at_all(value: Any) -> None:
    with pytest.raises(UserError, match="here is no valid record"):
        parse_record(value, "here")


def test_every_key_is_needed_and_no_other_allowed(values: dict[str, Any]) -> None:
    for key in values:
        if key in ("schema", "timed"):  # the second is there in rows that were timed otherwise
            continue
        without = {name: value for name, value in values.items() if name != key}
        with pytest.raises(UserError, match=f"'{key}'"):
            parse_record(without, "here")
    with pytest.raises(UserError, match="'more'"):
        parse_record({**values, "more": 1}, "here")


def test_rows_are_written_as_a_table_and_read_again(values: dict[str, Any]) -> None:
    values["metrics"][1]["censored"] = ">"  # a column that one row states
    record = parse_record(values, "here")
    text = text_of(record)
    table = json.loads(text)["metrics"]
    assert table["columns"] == [*values["metrics"][0], "censored"]
    assert [row[-1] for row in table["data"]] == [None, ">", None, None]
    again = parse_record(json.loads(text), "here")
    assert again.metrics == record.metrics
    assert again.speed == record.speed
    assert text_of(again) == text
    assert listed_tables(text)["speed"] == values["speed"]


@pytest.mark.parametrize(
    "table",
    [
        {"columns": ["metric"]},
        {"columns": ["metric"], "data": [], "more": 1},
        {"columns": "metric", "data": []},
        {"columns": ["metric", ["group"]], "data": []},
        {"columns": ["metric", "metric"], "data": [["mae_mm", "rmse_mm"]]},
        {"columns": ["metric", "group"], "data": [["mae_mm"]]},
        {"columns": ["metric"], "data": [7]},
        {"columns": ["metric"], "data": 7},
        "text",
    ],
)
def test_no_table(values: dict[str, Any], table: Any) -> None:
    with pytest.raises(UserError, match=r"'metrics': .* a table names each column once"):
        parse_record({**values, "metrics": table}, "here")


BROKEN: dict[str, tuple[str, Any, str]] = {
    "mae over rmse": ("metrics.1.value", 0.4, "exceeds its rmse_mm"),
    "share over one": ("metrics.2.value", 1.2, "a share lies in 0..1"),
    "share below zero": ("metrics.2.value", -0.1, "a share lies in 0..1"),
    "more presses than values": ("metrics.0.clusters", 10, "more presses than values"),
    "interval above": ("metrics.0.low", 0.55, "does not hold its value"),
    "interval below": ("metrics.0.high", 0.45, "does not hold its value"),
    "one-sided": ("metrics.0", None, "does not hold its value"),
    "quantiles": ("speed.0.p90_ms", 0.5, "out of order"),
    "negative time": ("speed.0.p50_ms", -1.0, "out of order"),
    "other predictions": ("identity.predictions_hash", "x", "stored predictions"),
    "nan": ("metrics.0.value", float("nan"), "metrics.0.value"),
    "direction": ("metrics.0.better", "less", "metrics.0.better"),
    "negative count": ("metrics.0.n", -1, "metrics.0.n"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_invariants(values: dict[str, Any], name: str) -> None:
    parse_record(values, "here")
    where, value, said = BROKEN[name]
    if value is None:
        value = {**values["metrics"][0], "low": 0.6, "high": None}
    *path, last = [int(part) if part.isdigit() else part for part in where.split(".")]
    table: Any = values
    for part in path:
        table = table[part]
    table[last] = value
    with pytest.raises(UserError, match=said) as raised:
        parse_record(values, "here")
    assert str(raised.value).startswith("here is no valid record")
    assert "\n" not in str(raised.value)


SUBMISSIONS = Path(__file__).parents[2] / "leaderboards" / "submissions"
FILES = sorted(SUBMISSIONS.glob("*/*.json"))


def test_there_are_records() -> None:
    assert len(FILES) >= 147


@pytest.mark.parametrize("step", [8, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("protocol", sorted({path.parent.name for path in FILES}))
def test_records_come_out_as_they_went_in(protocol: str, step: int) -> None:
    for path in sorted((SUBMISSIONS / protocol).glob("*.json"))[::step]:
        values = json.loads(path.read_text(encoding="utf-8"))
        record = parse_record(values, path.name)
        assert record.json_values() == values, path.name
        again = compact(record).json_values()
        if CHECKSUM in values["identity"]:  # records since then carry their own checksum
            again = with_checksum(again)
        assert again == values, path.name
        assert make_signature(record) == record.signature, path.name
