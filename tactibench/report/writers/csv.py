"""Tables as comma-separated values, for other programs: only values, in full precision."""

from __future__ import annotations

import csv
import io

from tactibench.report.table import Cell, Number, Table, Text


def csv_text(table: Table) -> str:
    """Return the table as CSV; the first line holds the heads."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(column.head for column in table.columns)
    writer.writerows([_value(cell) for cell in row] for row in table.rows)
    return stream.getvalue()


def _value(cell: Cell) -> float | str | None:
    if isinstance(cell, Number):
        return cell.value
    text = cell.text if isinstance(cell, Text) else cell
    # A spreadsheet would read such a text as a formula.
    return f"'{text}" if text and text[0] in "=+-@" else text
