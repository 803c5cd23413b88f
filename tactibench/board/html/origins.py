"""Where the rows of a report are from: the values of ``tactibench report --from``."""

AUTO, RUNS, BOARD, BOTH = "auto", "runs", "board", "both"
ORIGINS = (AUTO, RUNS, BOARD, BOTH)
