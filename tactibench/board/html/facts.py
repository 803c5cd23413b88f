"""What was asked (the plan) and on what it was answered (the environment), as plain tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from tactibench.board.html.material import Board
from tactibench.board.html.words import beside, p90_words, seeds_words, with_interval
from tactibench.board.ranking import RANKING, ordered
from tactibench.board.ranks import ranks
from tactibench.board.rows import machine
from tactibench.board.sections import Section
from tactibench.protocols.schema import Draw, Protocol
from tactibench.records.record import Record


@dataclass(frozen=True)
class Table:
    """Text alone; the template escapes it."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def leaders(boards: Iterable[tuple[Board, Sequence[Section]]]) -> Table:
    """The rows of rank 1 of every section that answered more than one row."""
    rows = []
    for board, sections in boards:
        for section in sections:
            rows += list(_first(board, section))
    return Table(
        "At a glance",
        (
            "protocol",
            "measured on",
            "rank 1",
            "error that orders the board",
            "beside it",
            "p90, one thread",
            "seeds",
        ),
        tuple(rows),
        "Rows of rank 1: no paired 95 % interval tells them apart from the first. Trivial rows and "
        "tables of a single row are left out.",
    )


def _first(board: Board, section: Section) -> Iterator[tuple[str, ...]]:
    rows = ordered(board.name, section.rows)
    found = ranks(board.name, rows, board.errors)
    able = [row for row in rows if not row.trivial]
    if found is None or len(able) < 2:
        return
    by = RANKING[board.name]
    for row, rank in zip(rows, found.by_row, strict=True):
        value = row.metric(by.metric, by.group)
        if rank == 1 and value is not None and not row.trivial:
            text = with_interval(value.value, value.low, value.high, by.decimals)
            yield (
                board.name,
                section.title,
                row.label,
                f"{by.name}: {text} {by.unit}",
                beside(row),
                p90_words(row),
                seeds_words(row),
            )


def plan(board: Board) -> Table:
    """What a protocol asks, from its file."""
    keys = board.protocol.keys
    rows = tuple((name, text) for name, text in _asked(keys) if text)
    title = f"{keys.id}: {keys.title}"
    note = f"Version {keys.version}, sha256 {board.protocol.hash}."
    return Table(title, ("what", "asked"), rows, note)


def _asked(keys: Protocol) -> Iterator[tuple[str, str]]:
    space = keys.workspace
    yield "answer", {"plate": "depth and tilt of a plate"}.get(keys.answer, keys.answer)
    depths = f"depth {space.depth_min_mm:g} to {space.depth_max_mm:g} mm"
    yield (
        "workspace",
        (
            f"x and y within ±{space.half_width_mm:g} mm, {depths}, dome radius "
            f"{space.dome_radius_mm:g} mm"
        ),
    )
    for draw in keys.draws:
        yield f"presses: {draw.name}", _draw(draw)
    if keys.split is not None:
        yield (
            "split",
            (
                f"of {keys.split.draw}: {keys.split.test:,} presses tested, "
                f"{keys.split.validation:,} of the others stop the training"
            ),
        )
    if keys.recorded is not None:
        shares = f"{100 * keys.recorded.test_share:g} % of the presses of a recording are tested"
        names = keys.recorded.test_frames
        yield "recorded folders", shares + (f"; published frames: {names}" if names else "")
    if keys.transfer is not None:
        shots = ", ".join(str(count) for count in keys.transfer.shots)
        yield "labelled frames of the tested sensor", shots
    for name, extra in keys.regimes.items():
        base = keys.split.draw if keys.split else "recorded presses"
        yield f"regime {name}", f"trained on {' and '.join([base, *extra])}"
    yield "tested on", " and ".join(keys.test.sets)
    yield "gate", f"{keys.test.gate_mm:g} mm" if keys.answer == "contacts" else ""
    yield "intervals", f"{100 * keys.test.level:g} % over presses"
    yield "metrics", ", ".join(keys.metrics.names)
    yield "seed of the presses", str(keys.data_seed)


def _draw(draw: Draw) -> str:
    count = draw.count or (draw.per_distance or 0) * len(draw.distances_mm)
    text = f"{count:,} {draw.indenter}, tip radius {draw.radius_mm:g} mm"
    if draw.distances_mm:
        low, high = min(draw.distances_mm), max(draw.distances_mm)
        each = f", {draw.per_distance} each" if draw.per_distance else ""
        text += f", {len(draw.distances_mm)} distances {low:g} to {high:g} mm{each}"
    if draw.side_mm:
        low, high = min(draw.heights_mm), max(draw.heights_mm)
        text += f", side {draw.side_mm:g} mm, heights {low:g} to {high:g} mm"
    return text


def machines(records: Iterable[Record]) -> Table:
    """One row a hardware fingerprint."""
    found: dict[str, list[Record]] = {}
    for record in records:
        found.setdefault(machine(record), []).append(record)
    rows = tuple((name, *_machine(found[name])) for name in sorted(found))
    heads = ("machine", "runs", "processor", "cores", "memory, GiB", "GPU", "system")
    return Table("Machines", heads, rows, "Speed is compared inside one machine only.")


def _machine(records: Sequence[Record]) -> tuple[str, ...]:
    facts = records[0].environment
    flags = ", ".join(str(flag) for flag in facts.cpu_flags)
    cores = (facts.cores_physical, facts.cores_logical)
    return (
        str(len(records)),
        f"{facts.cpu or 'unknown'}{f' ({flags})' if flags else ''}",
        " / ".join(str(count) for count in cores if count is not None) or "n/a",
        str(facts.memory_gib or "n/a"),
        ", ".join(str(gpu) for gpu in facts.gpu) or "none",
        facts.os or "n/a",
    )


def software(records: Iterable[Record]) -> Table:
    """Every library, plugin and commit that any run was made with, and by how many runs."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for record in records:
        environment, identity = record.environment, record.identity
        found = {("library", "python", environment.python or "n/a")}
        found |= {
            ("library", str(name), str(version)) for name, version in environment.versions.items()
        }
        found |= {
            ("plugin", str(name), f"{_of(facts, 'distribution')} {_of(facts, 'version')}")
            for name, facts in identity.plugins.items()
        }
        commit, _, changed = identity.commit.partition("+")
        found.add(
            ("commit", "tactibench", commit[:12] + " with uncommitted changes" * bool(changed))
        )
        counts.update(found)
    rows = tuple((*key, str(count)) for key, count in sorted(counts.items()))
    return Table("Software", ("kind", "name", "version", "runs"), rows)


def _of(facts: object, name: str) -> str:
    return str(facts.get(name, "n/a")) if isinstance(facts, dict) else "n/a"
