"""Tables of a report that no board has: the best rows, the protocols, machines and software."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

from tactibench.board import machine, ranks, row_anchor
from tactibench.board.overview import overview
from tactibench.protocols import Draw, Protocol, overview_spec
from tactibench.protocols.board_spec import board_spec
from tactibench.records import Record
from tactibench.report.board_page import BoardPage
from tactibench.report.html.figures import misses, row_latency
from tactibench.report.html.report_data import ReportBoard
from tactibench.report.overview_table import overview_table
from tactibench.report.table import Cell, Column, Head, Number, Table, Text, metric_number, table


def models(boards: Iterable[ReportBoard], link: Callable[[ReportBoard, str], str]) -> Table:
    """Return the overview: one line for every model, with its errors on all present boards.

    Args:
        boards: Boards of the report.
        link: Makes the link to a row from its board and its anchor.
    """
    present = {board.name: board for board in boards}
    lines = overview({name: board.records for name, board in present.items()})
    lead = present.get(overview_spec().protocol)
    return overview_table(lines, link=lambda anchor: "" if lead is None else link(lead, anchor))


def best_rows(
    boards: Iterable[tuple[ReportBoard, BoardPage]], link: Callable[[ReportBoard, str], str]
) -> Table:
    """Return the rows of rank 1 of every section that has two rows that are not trivial.

    Args:
        boards: Boards of the report with their pages.
        link: Makes the link to a row from its board and its anchor.
    """
    heads: list[Head] = [
        "protocol",
        "measured on",
        Column("rank 1", right=False, who=True),
        Column("error"),
        "beside it",
        Column("p90, one thread, ms"),
    ]
    rows = [cells for board, page in boards for cells in _first_rows(board, page, link)]
    note = (
        "Their order may be chance, that of presses and of seeds. Where none has a "
        "rank: the one with the smallest error. Trivial rows and tables of a single row are left "
        "out."
    )
    return table(heads, rows, title="Rows of rank 1", note=note)


def _first_rows(
    board: ReportBoard, page: BoardPage, link: Callable[[ReportBoard, str], str]
) -> Iterator[list[Cell]]:
    error = board_spec(board.name).ranking
    for section in page.sections:
        ranked = ranks(board.name, section.rows, board.errors)
        if error is None or ranked is None or sum(not row.trivial for row in section.rows) < 2:
            continue
        better = [k for k, row in enumerate(section.rows) if not row.trivial]
        first = [k for k in better if ranked.by_row[k] == 1] or better[:1]
        for row in (section.rows[k] for k in first):
            value = metric_number(row.metric(error.metric, error.group), error.decimals)
            if value is not None:
                name = Text(row.label, link=link(board, row_anchor(row)))
                where = Text(section.title, below=f"{error.name}, {error.unit}")
                yield [board.name, where, name, value, misses(row), row_latency(row)]


def plan(board: ReportBoard) -> Table:
    """Return what a protocol asks, from its file."""
    spec = board.protocol.spec
    rows = [(name, text) for name, text in _questions(spec) if text]
    heads: list[Head] = [Column("what", right=False, who=True), "asked"]
    note = f"Version {spec.version}, sha256 {board.protocol.hash}."
    return table(heads, rows, title=f"{board.name}: {spec.title}", note=note)


def _questions(spec: Protocol) -> Iterator[tuple[str, str]]:
    space = spec.workspace
    yield "answer", {"plate": "depth and tilt of a plate"}.get(spec.answer, spec.answer)
    depths = f"depth {space.depth_min_mm:g} to {space.depth_max_mm:g} mm"
    dome = f"dome radius {space.dome_radius_mm:g} mm"
    yield "workspace", f"x and y within ±{space.half_width_mm:g} mm, {depths}, {dome}"
    for draw in spec.draws:
        yield f"presses: {draw.name}", _draw(draw)
    if spec.split is not None:
        tested = f"of {spec.split.draw}: {spec.split.test:,} presses tested"
        yield "split", f"{tested}, {spec.split.validation:,} of the others stop the training"
    if spec.recorded is not None:
        share = f"{100 * spec.recorded.test_share:g} % of the presses of a recording are tested"
        frames = spec.recorded.test_frames
        yield "recorded folders", share + (f"; published frames: {frames}" if frames else "")
    if spec.transfer is not None:
        counts = ", ".join(str(count) for count in spec.transfer.shots)
        yield "labelled frames of the tested sensor", counts
    base = spec.split.draw if spec.split else "recorded presses"
    for name, extra in spec.regimes.items():
        yield f"regime {name}", f"trained on {' and '.join([base, *extra])}"
    yield "tested on", " and ".join(spec.test.sets)
    for apart in spec.test.apart:
        on = f", on {len(apart.instances)} other sensors of the make" if apart.instances else ""
        yield f"tested apart: {apart.name}", f"{' and '.join(apart.sets)}{on}"
    yield "gate", f"{spec.test.gate_mm:g} mm" if spec.answer == "contacts" else ""
    yield "intervals", f"{100 * spec.test.level:g} % over presses"
    yield "metrics", ", ".join(spec.metrics.names)
    yield "seed of the presses", str(spec.data_seed)


def _draw(draw: Draw) -> str:
    count = draw.count or (draw.per_distance or 0) * len(draw.distances_mm)
    kind = f"{draw.tips} tips" if draw.offsets_mm else draw.indenter
    text = f"{count:,} {kind}, tip radius {draw.radius_mm:g} mm"
    if draw.distances_mm:
        low, high = min(draw.distances_mm), max(draw.distances_mm)
        each = f", {draw.per_distance} each" if draw.per_distance else ""
        text += f", {len(draw.distances_mm)} distances {low:g} to {high:g} mm{each}"
    if draw.side_mm:
        low, high = min(draw.heights_mm), max(draw.heights_mm)
        text += f", side {draw.side_mm:g} mm, heights {low:g} to {high:g} mm"
    return text


def machines(records: Iterable[Record]) -> Table:
    """Return a table of the machines, with one row for every hardware fingerprint."""
    by_machine: dict[str, list[Record]] = {}
    for record in records:
        by_machine.setdefault(machine(record), []).append(record)
    rows = [[name, *_machine(by_machine[name])] for name in sorted(by_machine)]
    heads: list[Head] = [
        Column("machine", right=False, who=True),
        Column("runs"),
        *("processor", "cores", "memory, GiB", "GPU", "system"),
    ]
    note = "Speed is compared inside one machine only."
    return table(heads, rows, title="Machines", note=note)


def _machine(records: Sequence[Record]) -> list[Cell]:
    facts = records[0].environment
    flags = ", ".join(facts.cpu_flags)
    cores = [count for count in (facts.cores_physical, facts.cores_logical) if count is not None]
    return [
        Number(len(records), "{:,.0f}".format),
        f"{facts.cpu or 'unknown'}{f' ({flags})' if flags else ''}",
        " / ".join(map(str, cores)) or None,
        None if facts.memory_gib is None else str(facts.memory_gib),
        ", ".join(facts.gpu) or "none",
        facts.os,
    ]


def software(records: Iterable[Record]) -> Table:
    """Return every library, plugin and commit, with the number of runs that were made with it."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for record in records:
        identity = record.identity
        versions = {"python": record.environment.python, **record.environment.versions}
        used = {("library", str(name), str(version)) for name, version in versions.items()}
        for name, facts in identity.plugins.items():
            used.add(("plugin", str(name), f"{facts['distribution']} {facts['version']}"))
        commit, _, changed = identity.commit.partition("+")
        text = commit[:12] + (" with uncommitted changes" if changed else "")
        counts.update({*used, ("commit", "tactibench", text)})
    rows: list[list[Cell]] = [
        [*key, Number(count, "{:,.0f}".format)] for key, count in sorted(counts.items())
    ]
    heads: list[Head] = ["kind", Column("name", right=False, who=True), "version", Column("runs")]
    return table(heads, rows, title="Software")
