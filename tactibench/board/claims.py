"""Notes on published tables, held against the numbers that they are about.

A note says in words what a paper's own figures imply; every figure in it is a ``Claim`` with the
quantity it stands for, computed here from the printed values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from tactibench.board.published import (
    AXES,
    Claim,
    Finding,
    PublishedRow,
    PublishedTable,
    aggregation,
    findings,
    mean,
    root_mean_square,
    target_sd,
    target_sd_range,
    uniform_sd,
)
from tactibench.errors import UserError

_NUMBER = re.compile(r"(?<![\w.])\d[\d,]*(?:\.\d+)?")
_SMALL = 10.0
"""Whole numbers below this are words ("1 - R2", "two rows") rather than findings."""


@dataclass(frozen=True)
class Checked:
    """A claim and what its quantity is. found: in as many decimals as the note says."""

    claim: Claim
    subject: str
    found: str
    in_note: bool

    @property
    def agrees(self) -> bool:
        return self.in_note and self.found == self.claim.says


def check_claims(table: PublishedTable) -> list[Checked]:
    """Every claim of a table. Raises UserError for one about a row or value that is not there."""
    return [_checked(table, number, claim) for number, claim in enumerate(table.claims, 1)]


def unclaimed(table: PublishedTable) -> Iterator[tuple[int, str]]:
    """Numbers in the notes that no claim stands for, with the note's number."""
    for number, note in enumerate(table.notes, 1):
        own = [claim for claim in table.claims if claim.note == number]
        known = {text for claim in own for text in _NUMBER.findall(claim.says)}
        known |= {_as_said(v, text) for claim in own for v in claim.values for text in ("1", "1.0")}
        for found in dict.fromkeys(text.rstrip(",") for text in _NUMBER.findall(note)):
            small = "." not in found and float(found.replace(",", "")) < _SMALL
            if found not in known and not small:
                yield number, found


def implied(table: PublishedTable) -> list[Finding]:
    """What its rows say about themselves and about each other, beyond the notes."""
    return [*findings(table), *_disjoint(table)]


def _disjoint(table: PublishedTable) -> Iterator[Finding]:
    """Rows of one protocol whose implied targets cannot be those of one test set.

    value: the smallest ratio of the two standard deviations that the rounding of the print allows.
    """
    for axis in "xyz":
        known = [(row, *ends) for row in table.rows if (ends := _target_range(row, axis))]
        for (one, low, high), (other, least, most) in combinations(known, 2):
            if one.protocol != other.protocol or not (high < least or most < low):
                continue
            ratio = least / high if high < least else low / most
            yield Finding(
                f"{one.label} and {other.label}",
                "target_sd_ratio",
                axis,
                ratio,
                "",
                note="their RMSE and R2 are not of the same targets, whatever the rounding",
            )


def _target_range(row: PublishedRow, axis: str) -> tuple[float, float] | None:
    rmse, r2 = row.value("rmse_mm", axis), row.value("r2", axis)
    if rmse is None or r2 is None or r2 >= 1:
        return None
    return target_sd_range(rmse, r2, row.decimals)


def _checked(table: PublishedTable, number: int, claim: Claim) -> Checked:
    where = f"{table.name}, claim {number}"
    if claim.note > len(table.notes):
        raise UserError(f"{where}: key note is {claim.note}, but there are {len(table.notes)}.")
    row = None
    if claim.row is not None:
        if claim.row > len(table.rows):
            raise UserError(f"{where}: key row is {claim.row}, but there are {len(table.rows)}.")
        row = table.rows[claim.row - 1]
    quantity = _quantity(claim, row, where)
    found = quantity if isinstance(quantity, str) else _as_said(quantity, claim.says)
    note = table.notes[claim.note - 1]
    present = re.search(rf"(?<![\d.,]){re.escape(claim.says)}(?![\d]|[.,]\d)", note) is not None
    subject = ", ".join(
        filter(
            None,
            (
                claim.quantity,
                None if row is None else row.label,
                claim.metric,
                claim.group,
                " and ".join(f"{value:g}" for value in claim.values),
            ),
        )
    )
    return Checked(claim, subject, found, present)


def _quantity(claim: Claim, row: PublishedRow | None, where: str) -> float | str:
    """The formula of each quantity."""
    if claim.quantity == "sd of uniform targets":
        return uniform_sd(*_two(claim.values, where))
    if claim.quantity == "kept, %":
        dropped, whole = _two(claim.values, where)
        return 100 * (1 - dropped / whole)
    if row is None:
        raise UserError(f"{where}: {claim.quantity!r} is of a row; name it with key row.")
    if claim.quantity == "n":
        return float(row.n) if row.n is not None else math.nan
    if claim.quantity in ("printed", "printed, %"):
        value = _value(row, claim.metric, claim.group, where)
        return 100 * value if claim.quantity.endswith("%") else value
    if claim.quantity in ("mean of axes", "root mean square of axes", "aggregation"):
        axes = [_value(row, claim.metric, axis, where) for axis in AXES]
        if claim.quantity == "aggregation":
            stated = _value(row, claim.metric, "mean", where)
            return aggregation(axes, stated, row.decimals)
        return mean(axes) if claim.quantity == "mean of axes" else root_mean_square(axes)
    rmse, r2 = (_value(row, name, claim.group, where) for name in ("rmse_mm", "r2"))
    least, most = target_sd_range(rmse, r2, row.decimals)
    return {
        "target sd": target_sd(rmse, r2),
        "target sd, least": least,
        "target sd, most": most,
        "half width of uniform targets": math.sqrt(3) * target_sd(rmse, r2),
    }[claim.quantity]


def _two(values: Sequence[float], where: str) -> tuple[float, float]:
    if len(values) != 2:
        raise UserError(f"{where}: key values needs two numbers, it has {len(values)}.")
    return values[0], values[1]


def _value(row: PublishedRow, metric: str | None, group: str | None, where: str) -> float:
    value = row.value(metric or "", group or "")
    if value is None:
        raise UserError(f"{where}: row {row.label!r} prints no {metric} of {group}.")
    return value


def _as_said(value: float, says: str) -> str:
    """With the decimals and the thousands' commas of the note."""
    decimals = len(says.partition(".")[2])
    return f"{value:,.{decimals}f}"
