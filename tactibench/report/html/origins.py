"""The values of ``tactibench report --from``: the origins of the rows of a report."""

from __future__ import annotations

AUTO, RUNS, BOARD, BOTH = "auto", "runs", "board", "both"
ORIGINS = (AUTO, RUNS, BOARD, BOTH)
