"""Every committed record is read into types and written again without a change."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tactibench.board import compact
from tactibench.records import CHECKSUM, make_signature, parse_record, with_checksum

SUBMISSIONS = Path(__file__).parents[2] / "leaderboards" / "submissions"
FILES = sorted(SUBMISSIONS.glob("*/*.json"))


def test_there_are_records() -> None:
    assert len(FILES) >= 147


@pytest.mark.parametrize("protocol", sorted({path.parent.name for path in FILES}))
def test_records_come_out_as_they_went_in(protocol: str) -> None:
    for path in sorted((SUBMISSIONS / protocol).glob("*.json")):
        values = json.loads(path.read_text(encoding="utf-8"))
        record = parse_record(values, path.name)
        assert record.json_values() == values, path.name
        again = compact(record).json_values()
        if CHECKSUM in values["identity"]:  # records since then carry their own checksum
            again = with_checksum(again)
        assert again == values, path.name
        assert make_signature(record) == record.signature, path.name
