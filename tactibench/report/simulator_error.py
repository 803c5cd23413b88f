"""The simulator's own error in one line, beside the errors of models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tactibench.records import Record, SimulatorError

TITLE = "simulator's own error at a pin"
DECIMALS = 3
MOST_SETS = 3
"""More sets of test frames are summarised: the protocol of hard cases has thirty."""


def error_line(record: Record) -> str:
    """Return the line of a record; "" where the record states no error."""
    errors = record.data.simulator
    if not errors:
        return ""
    if all(error.max_mm is None for error in errors):
        return f"{TITLE}: not known"
    if len(errors) > MOST_SETS:
        parts = [_summary(errors)]
    else:
        named = len(errors) > 1
        parts = [(f"{error.name} " if named else "") + _values(error) for error in errors]
    return f"{TITLE}, against finite elements: {'; '.join(parts)}"


def first_line(records: Iterable[Record]) -> str:
    """Return the line of the first record that has one: all were tested on the same scenes."""
    return next((line for record in records if (line := error_line(record))), "")


def _values(error: SimulatorError) -> str:
    if error.median_mm is None or error.p95_mm is None or error.max_mm is None:
        return "not known"
    return (
        f"median {error.median_mm:.{DECIMALS}f}, 95 % {error.p95_mm:.{DECIMALS}f}, "
        f"at most {error.max_mm:.{DECIMALS}f} mm{_unknown(error.unknown, error.scenes)}"
    )


def _summary(errors: Sequence[SimulatorError]) -> str:
    medians = [error.median_mm for error in errors if error.median_mm is not None]
    largest = max(error.max_mm for error in errors if error.max_mm is not None)
    unknown, scenes = sum(error.unknown for error in errors), sum(e.scenes for e in errors)
    return (
        f"median {min(medians):.{DECIMALS}f} to {max(medians):.{DECIMALS}f} by family, "
        f"at most {largest:.{DECIMALS}f} mm{_unknown(unknown, scenes)}"
    )


def _unknown(unknown: int, scenes: int) -> str:
    return f" (not known of {unknown:,} of {scenes:,} scenes)" if unknown else ""
