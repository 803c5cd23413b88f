"""plan.jsonl: what is to be recorded, written before the first sample and never changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tactibench.datasets.v1.layout import PLAN
from tactibench.errors import UserError
from tactibench.records.files import atomic

PlanRow = Mapping[str, Any]
"""``id`` and whatever else the recorder needs to press it."""


def plan_text(rows: Iterable[Mapping[str, Any]], plan: str = "the plan") -> bytes:
    """The lines of plan.jsonl. Raises UserError for values that are no JSON, ids that repeat."""
    lines: list[bytes] = []
    ids: set[int] = set()
    for number, row in enumerate(rows, start=1):
        if type(row.get("id")) is not int or row["id"] in ids:
            raise UserError(
                f"row {number} of {plan} has the id {row.get('id')!r}; every row needs a whole "
                "number of its own."
            )
        ids.add(row["id"])
        try:
            lines.append(json.dumps(dict(row), allow_nan=False, ensure_ascii=False).encode())
        except (TypeError, ValueError) as error:
            raise UserError(f"row {number} of {plan} cannot be written: {error}.") from None
    return b"".join(line + b"\n" for line in lines)


def plan_hash(text: bytes) -> str:
    """sha256 of a plan's lines; "" without a plan."""
    return hashlib.sha256(text).hexdigest() if text else ""


def write_plan(folder: Path, text: bytes) -> None:
    """Write plan.jsonl, if there is anything in it."""
    if text:
        with atomic(folder / PLAN) as stream:
            stream.write(text)


def read_plan(path: Path, sha256: str | None = None) -> tuple[dict[str, Any], ...]:
    """The rows of a plan; a file that is not there has none. sha256: it must have this one.

    Raises UserError with the line that is no JSON object with an id of its own.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    if sha256 is not None and plan_hash(data) != sha256:
        raise UserError(f"{path} is not the plan that the data set was begun with; restore it.")
    rows = []
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            row = None
        if not isinstance(row, dict):
            raise UserError(f"{path} line {number} is no JSON object; mend it.")
        rows.append(row)
    plan_text(rows, str(path))
    return tuple(rows)
