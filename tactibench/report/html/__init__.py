"""The report: boards and runs as one HTML file that loads nothing from a network."""

from __future__ import annotations

AUTO, RUNS, BOARD, BOTH = "auto", "runs", "board", "both"
ORIGINS = (AUTO, RUNS, BOARD, BOTH)
"""Origins of the rows of a report, as ``tactibench report --from`` names them."""
