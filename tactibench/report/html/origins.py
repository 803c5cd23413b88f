"""Where the rows of a report are from: the values of ``tactibench report --from``."""

from __future__ import annotations

AUTO, RUNS, BOARD, BOTH = "auto", "runs", "board", "both"
ORIGINS = (AUTO, RUNS, BOARD, BOTH)
