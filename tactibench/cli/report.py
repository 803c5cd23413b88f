"""What a researcher reads after a run: errors with intervals, misses, published rows, speed.

Every section says what it was measured on. All tables fit 80 columns; a wider terminal gets the
counts as columns instead of a line.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from tactibench.board.published import PublishedRow, PublishedTable, rows_for

Record = Mapping[str, Any]
Row = Mapping[str, Any]
Cells = tuple[str, ...]


@dataclass(frozen=True)
class Block:
    """A table of a protocol. metrics: name -> decimals; groups: rows, () for all distances."""

    title: str
    metrics: Mapping[str, int]
    groups: tuple[str, ...]
    compared: bool = True


BLOCKS: Mapping[str, tuple[Block, ...]] = {
    "exp1": (
        Block("Error by axis", {"r2": 4, "mae_mm": 4, "rmse_mm": 4}, ("x", "y", "z", "mean")),
    ),
    "exp2": (
        Block(
            "By true distance of the tips, mm",
            {"resolved": 0, "distance_mae_mm": 3, "distance_penalised_mm": 3,
             "orientation_mae_deg": 1},
            (),
            compared=False,
        ),
        Block(
            "All distances",
            {"distance_mae_mm": 3, "distance_penalised_mm": 3, "resolved": 1},
            ("all",),
        ),
    ),
    "exp3": (
        Block(
            "By number of contacts",
            {"position_mean_mm": 3, "depth_mae_mm": 3, "missed": 1},
            ("dual", "triple", "all"),
        ),
    ),
    "surface": (
        Block(
            "Flat plate",
            {"depth_mae_mm": 4, "tilt_mae_deg": 3, "coverage": 1},
            ("all",),
        ),
    ),
}  # fmt: skip
"""The main tables of each protocol; every other metric of a record is listed after them."""

HEADS = {
    "r2": "R2", "mae_mm": "MAE, mm", "rmse_mm": "RMSE, mm", "resolved": "resolved, %",
    "distance_mae_mm": "error, mm", "distance_penalised_mm": "penalised, mm",
    "orientation_mae_deg": "turn, deg", "position_mean_mm": "position, mm",
    "depth_mae_mm": "depth, mm", "missed": "missed, %", "tilt_mae_deg": "tilt, deg",
    "coverage": "coverage, %",
}  # fmt: skip
NAMES = {
    "r2": "R2", "mae_mm": "MAE", "rmse_mm": "RMSE", "rmse_pooled_mm": "RMSE pooled over axes",
    "surface_rmse_mm": "heatmap against true surface, RMSE",
    "rmse_over_bound": "RMSE / Cramer-Rao bound", "missed": "missed contacts",
    "spurious": "spurious contacts per frame", "distance_mae_mm": "distance error",
    "distance_penalised_mm": "distance error, penalised", "resolved": "resolved as two",
    "threshold_mm": "two-point threshold (75 %)", "catch_resolved": "single presses seen as two",
    "d_prime": "d' of one against two", "orientation_mae_deg": "orientation error of the pair",
    "position_mean_mm": "position error", "position_ungated_mm": "position error without gate",
    "depth_mae_mm": "depth error", "relative_depth_mae_mm": "relative depth error",
    "gospa1_mm": "GOSPA, p = 1", "gospa2_mm": "GOSPA, p = 2", "tilt_mae_deg": "tilt error",
    "coverage": "coverage",
}  # fmt: skip
EXPLAIN = {
    "exp2": "error, turn: over resolved pairs only; penalised: an unresolved pair counts its true "
            "distance, so that no miss improves it.",
    "exp3": "position, depth: over contacts matched inside the gate; missed: true contacts without "
            "a match.",
    "exp1": "best-scored prediction against the one true contact, no gate.",
    "surface": "errors over answered frames; coverage: answered frames.",
}  # fmt: skip


def print_record(
    console: Console,
    record: Record,
    published: Sequence[PublishedTable],
    others: Sequence[Record] = (),
) -> None:
    """Print one record of a run beside published rows and ``others``, stored runs of its protocol.

    Simulated and real results stand in separate, headed sections. Nothing is cut to the width.
    """
    protocol = record["protocol"]["id"]
    _heading(console, record)
    blocks = BLOCKS.get(protocol, ())
    for block in blocks:
        _print_block(console, block, record, published, others)
    if protocol in EXPLAIN:
        _note(console, EXPLAIN[protocol])
    if any(block.compared for block in blocks):
        for line in _comparability(record, published):
            _note(console, line)
    _print_listing(console, _rest(record, blocks))
    _print_speed(console, record)
    _footer(console, record)


def number(value: float, decimals: int) -> str:
    """Fixed decimals; a value that would read as zero without being it keeps one digit."""
    if value and abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.0e}"
    return f"{value:.{decimals}f}"


def estimate(row: Row | None, decimals: int) -> str:
    """"0.412 [0.398, 0.426]", "< 6.5", or "n/a". Shares are shown in per cent."""
    if row is None or row["value"] is None:
        return "n/a"
    scale = 100.0 if row["unit"] == "share" else 1.0
    if row.get("censored"):
        return f"{row['censored']} {row['value'] * scale:g}"
    low, high = (None if row[end] is None else row[end] * scale for end in ("low", "high"))
    text = number(row["value"] * scale, decimals)
    if low is None and high is None:
        return f"{text} [n/a]"
    ends = ("open" if end is None else number(end, decimals) for end in (low, high))
    return f"{text} [{', '.join(ends)}]"


def label_of(record: Record) -> str:
    """Model, with its regime where there is one, as published rows are labelled."""
    regime = record.get("regime")
    return record["model"]["name"] + (f" ({regime})" if regime else "")


def measured_on(record: Record) -> str:
    """What a run was measured on, such as "simulated sensor tactip-127"."""
    sensor = record["sensor"]
    return f"{sensor['origin']} sensor {sensor['name']}"


def partial_line(record: Record) -> str | None:
    """The warning of a cut-short run; None for a whole one."""
    if not record["partial"]:
        return None
    limits = record.get("limits") or {}
    why = ["quick"] if limits.get("quick") else []
    if limits.get("limit") is not None:
        why.append(f"limit {limits['limit']}")
    return f"PARTIAL{f' ({chr(44).join(why)})' if why else ''}: not for a board"


def _heading(console: Console, record: Record) -> None:
    protocol, encoder, data = record["protocol"], record.get("encoder"), record["data"]
    console.print(Text(f"{protocol['id']}  {protocol['title']}", style="bold"))
    parts = [label_of(record), f"encoder {encoder['name']}" if encoder else "no encoder",
             measured_on(record), f"seed {record['seed']}"]  # fmt: skip
    _line(console, ", ".join(parts))
    counts = f"{data['train']:,} training, {data['validation']:,} validation, {data['test']:,} test"
    rejected = f"; {data['rejected']:,} candidates rejected by geometry" if data["rejected"] else ""
    _line(console, f"{counts} presses{rejected}")
    training = record.get("training")
    if training and training["epochs"]:
        _line(console, f"trained {training['epochs']} epochs on {training['presses']:,} presses in "
                       f"{_duration(training['seconds'])}")  # fmt: skip
    _warn(console, record)


def _print_block(
    console: Console,
    block: Block,
    record: Record,
    published: Sequence[PublishedTable],
    others: Sequence[Record],
) -> None:
    """One table in headed sections of equal column widths."""
    sections: list[tuple[str, list[Cells]]] = []
    runs = [record, *others] if block.compared else [record]
    for k, run in enumerate(runs):
        rows, counts = _measured(block, run, with_counts=True)
        head = f"measured here: {label_of(run)}, {measured_on(run)}"
        sections.append((head + (f", stored as {run['name']}" if k else "") + f"; {counts}", rows))
    if block.compared:
        for table in published:
            for row in rows_for(record["protocol"]["id"], table):
                if rows := _printed(block, row):
                    sections.append((_published_head(table, row), rows))
    heads = ["", *(HEADS[m] for m in block.metrics), "n", "presses"]
    for cut in (len(heads), len(heads) - 1, len(heads) - 2):
        tables = [_table(heads[:cut], [r[:cut] for r in rows]) for _, rows in sections]
        widths = _widths(heads[:cut], [r[:cut] for _, rows in sections for r in rows])
        if sum(widths) + 2 * len(widths) <= console.width:
            break
    gap = 2 if sum(widths) + 2 * len(widths) <= console.width else 1
    console.print()
    console.print(Text(f"{block.title}: value [95 % interval]", style="bold"))
    for k, ((head, _), table) in enumerate(zip(sections, tables, strict=True)):
        _line(console, head, style="cyan" if head.startswith("measured") else "magenta")
        table.show_header = k == 0
        table.padding = (0, gap, 0, 0)
        for column, width in zip(table.columns, widths, strict=True):
            column.min_width = width
        console.print(table)


def _measured(block: Block, run: Record, *, with_counts: bool) -> tuple[list[Cells], str]:
    """Rows of a run (group, estimates, n, presses), and its counts in words."""
    found = {(r["metric"], r["group"]): r for r in run["metrics"]}
    groups = block.groups or tuple(
        sorted({g for m, g in found if m in block.metrics and g != "all"}, key=float)
    )
    wide = {m: _decimals(m, d, [found.get((m, g)) for g in groups], block)
            for m, d in block.metrics.items()}  # fmt: skip
    rows, used = [], []
    for group in groups:
        here = [found.get((m, group)) for m in block.metrics]
        known = [r for r in here if r is not None]
        used += known
        cells = (estimate(r, wide[m]) for r, m in zip(here, block.metrics, strict=True))
        n = "/".join(f"{n:,}" for n in sorted({r["n"] for r in known}))
        presses = max((r["clusters"] for r in known), default=0)
        rows.append((group, *cells, n, f"{presses:,}"))
    return rows, _counts(used) if with_counts else ""


def _decimals(metric: str, decimals: int, rows: Sequence[Row | None], block: Block) -> int:
    """Fewer decimals in a table by distance where values above 1 mm do not need them."""
    if block.groups:
        return decimals
    tops = [r["high"] if r["high"] is not None else r["value"] for r in rows if r]
    top = max((t for t in tops if t is not None), default=0.0)
    if metric == "resolved":
        return 1 if any(r and r["n"] > 100 for r in rows) else 0
    return decimals - 1 if top >= (10.0 if metric.endswith("_deg") else 1.0) else decimals


def _printed(block: Block, row: PublishedRow) -> list[Cells]:
    """Rows of a published row: as printed, without intervals."""
    rows = []
    for group in block.groups:
        values = {m: row.value(m, group) for m in block.metrics}
        if any(v is not None for v in values.values()):
            cells = (_printed_value(m, v, min(d, row.decimals), row) for (m, v), d in zip(
                values.items(), block.metrics.values(), strict=True))  # fmt: skip
            rows.append((group, *cells, f"{row.n:,}" if row.n else "n/a", ""))
    return rows


def _printed_value(metric: str, value: float | None, decimals: int, row: PublishedRow) -> str:
    if value is None:
        return "n/a"
    if metric in {"coverage", "resolved", "missed"}:
        return number(100 * value, max(min(row.decimals - 2, 1), 0))
    return number(value, decimals)


def _published_head(table: PublishedTable, row: PublishedRow) -> str:
    count = f"; n {row.n:,} {row.unit}" if row.n else ""
    return (f"published: {row.label}, {table.measured_on}; {table.name} {table.year}, "
            f"{row.source.split(',')[0]}{count}")  # fmt: skip


def _comparability(record: Record, published: Sequence[PublishedTable]) -> Iterable[str]:
    """Why published rows may or may not be read against this run, each reason once."""
    rows = [r for table in published for r in rows_for(record["protocol"]["id"], table)]
    if rows and record["sensor"]["origin"] == "simulated":
        yield "Not comparable: simulated here, hardware there; published rows are for orientation."
    words = {"yes": "Comparable", "partly": "Partly comparable", "no": "Published"}
    yield from dict.fromkeys(f"{words[r.comparable]}: {r.note}" for r in rows)


def _rest(record: Record, blocks: Sequence[Block]) -> list[Row]:
    """Rows of the record that no table above has shown."""
    shown = {(m, g) for b in blocks for m in b.metrics for g in b.groups}
    by_distance = {m for b in blocks if not b.groups for m in b.metrics}
    return [r for r in record["metrics"] if (r["metric"], r["group"]) not in shown
            and not (r["metric"] in by_distance and r["group"] != "all")]  # fmt: skip


def _print_listing(console: Console, rows: Sequence[Row]) -> None:
    """One row a metric and group, with n and presses."""
    if not rows:
        return
    grouped = any(r["group"] != "all" for r in rows)
    heads = ["Also measured", *(["of"] if grouped else []), "value [95 % interval]", "n", "presses"]
    cells, last = [], None
    for r in rows:
        unit = {"share": "%"}.get(r["unit"], r["unit"])
        name = NAMES.get(r["metric"], r["metric"]) + (
            f", {unit}" if unit in {"mm", "deg", "%"} else "")
        decimals = {"share": 1, "mm": 3, "deg": 2}.get(r["unit"], 3)
        cells.append(("" if name == last else name, *([r["group"]] if grouped else []),
                      estimate(r, decimals), f"{r['n']:,}", f"{r['clusters']:,}"))  # fmt: skip
        last = name
    console.print()
    console.print(_table(heads, cells, right=2))


def _print_speed(console: Console, record: Record) -> None:
    """Latency by scenario, threads and phase, with the error of the same model beside it."""
    environment, rows = record["environment"], record.get("speed") or []
    console.print()
    console.print(Text("Speed beside error", style="bold"))
    _line(console, f"{environment['cpu']}, {environment['threads']} threads, fingerprint "
                   f"{environment['fingerprint']}")  # fmt: skip
    if not rows:
        _line(console, "not timed")
        return
    heads = ["scenario", "batch", "threads", "phase", "p50 ms", "p90 ms", "p99 ms", "frames/s"]
    cells, last = [], ("", "", "")
    for r in rows:
        key = (str(r["scenario"]), str(r["batch"]), str(r["threads"]))
        rate = f"{r['per_s']:,.0f}" if r["phase"] == "total" else ""
        times = (number(r[q], 2) for q in ("p50_ms", "p90_ms", "p99_ms"))
        cells.append((*(("", "", "") if key == last else key), r["phase"], *times, rate))
        last = key
    console.print(_table(heads, cells, right=4))
    if not all(r["settled"] for r in rows):
        _line(console, "NOT SETTLED: times still drifted when timing began", style="yellow")
    if not any(r["scenario"] == "offline" for r in rows):
        _line(console, "offline (larger batches): not timed in this run", style="dim")
    timed = record.get("timed")
    if timed:
        gap = timed["difference_mm"]
        words = "n/a" if gap is None else f"{number(gap, 4)} mm"
        _line(console, f"timed: {timed['configuration']}; errors: float32, batch 1; "
                       f"the two differ by {words}")  # fmt: skip
    for line in _speed_beside_error(record, rows):
        _line(console, line, style="bold")


def _speed_beside_error(record: Record, rows: Sequence[Row]) -> Iterable[str]:
    """The headline error and what it costs, one line per thread count of the single scenario."""
    wanted = {"exp1": ("mae_mm", "mean", "missed"), "exp2": ("distance_penalised_mm", "all", "resolved"),
              "exp3": ("position_mean_mm", "all", "missed"),
              "surface": ("depth_mae_mm", "all", "coverage")}.get(record["protocol"]["id"])  # fmt: skip
    if wanted is None:
        return
    metric, group, beside = wanted
    found = {(r["metric"], r["group"]): r for r in record["metrics"]}
    error, share = found.get((metric, group)), found.get((beside, "all"))
    text = f"{NAMES[metric]} {estimate(error, 3)} mm, {NAMES[beside]} {estimate(share, 1)} %"
    text = text.replace("n/a mm", "n/a").replace("n/a %", "n/a")
    times = [f"{number(r['p90_ms'], 2)} ms on {_plural(r['threads'], 'thread')}" for r in rows
             if r["scenario"] == "single" and r["phase"] == "total"]  # fmt: skip
    yield f"{text}; p90 {', '.join(times)}" if times else text


def _footer(console: Console, record: Record) -> None:
    console.print()
    _warn(console, record)
    console.print(Text(record["signature"]), soft_wrap=True)  # one line, to be copied whole
    console.print(Text(f"record: {record['path']}"), soft_wrap=True)


def _table(heads: Sequence[str], rows: Iterable[Cells], *, right: int = 1) -> Table:
    """A plain table whose first column may wrap; numbers neither wrap nor lose a digit."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for k, head in enumerate(heads):
        fold = k == 0
        side: Any = "right" if k >= right and len(heads) > right else "left"
        table.add_column(head, justify=side, no_wrap=not fold, overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def _widths(heads: Sequence[str], rows: Sequence[Cells]) -> list[int]:
    return [max(len(cell) for cell in column) for column in zip(heads, *rows, strict=True)]


def _counts(rows: Sequence[Row]) -> str:
    """"n 998 to 1,000 of 1,000 presses"."""
    n, presses = [r["n"] for r in rows], [r["clusters"] for r in rows]
    return f"n {_span(n)} from {_span(presses)} presses"


def _span(values: Sequence[int]) -> str:
    low, high = min(values, default=0), max(values, default=0)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def _plural(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"


def _line(console: Console, text: str, style: str = "") -> None:
    console.print(Text(text, style=style))


def _note(console: Console, text: str) -> None:
    _line(console, text, style="dim")


def _warn(console: Console, record: Record) -> None:
    if line := partial_line(record):
        _line(console, line, style="bold red")
