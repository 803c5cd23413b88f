"""The presses of a protocol: what it trains, validates and tests on, with the noise of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactibench.datasets.generating.stretches import Press, Pressing, Stretch
from tactibench.errors import UserError
from tactibench.frames.drawn import FIT, TEST, VALIDATION, WHOLE
from tactibench.protocols.draws import SensorShape, draw_scenes, pressable
from tactibench.protocols.schema import Draw, Protocol
from tactibench.protocols.split import split_presses


@dataclass(frozen=True)
class _Part:
    """Rows of a draw that are pressed with one seed."""

    draw: str
    rows: Sequence[int]
    seed: int


def from_protocol(keys: Protocol, sensor: SensorShape, count: int | None) -> Pressing:
    """Every press of a protocol on a sensor's surface, at most ``count`` of each set.

    The frames are those of ``tactibench run``: presses, their order and their seeds are the same.
    Raises UserError for a protocol that presses nothing, or a sensor that cannot be pressed so.
    """
    if keys.split is None:
        raise UserError(
            f"protocol {keys.id!r} takes the presses of a recorded folder and draws none; name "
            "another protocol, or the presses with --plan FILE."
        )
    if keys.families:
        raise UserError(
            f"protocol {keys.id!r} tests frames with faults, which no data set holds; its training "
            "presses are those of exp1: generate these."
        )
    pressed = pressable(keys, sensor)
    ids: dict[tuple[str, int], list[int]] = {}
    stretches = []
    start = 0
    for part in _parts(keys):
        scenes = draw_scenes(pressed, part.draw).scenes
        rows = part.rows[:count]
        presses = tuple(
            Press(number, f"{part.draw}-{row}", scenes[row], part.draw)
            for number, row in enumerate(rows, start)
        )
        start += len(presses)
        stretches.append(Stretch(presses, (keys.data_seed, keys.draw(part.draw).stream, part.seed)))
        ids[part.draw, part.seed] = [press.id for press in presses]
    return Pressing(tuple(stretches), _splits(keys, ids))


def _parts(keys: Protocol) -> list[_Part]:
    split = keys.split
    assert split is not None, "checked before"  # noqa: S101
    sizes = {draw.name: _size(draw) for draw in keys.draws}
    divided = split_presses(sizes[split.draw], split, keys.data_seed)
    parts = [
        _Part(split.draw, divided.fit, FIT),
        _Part(split.draw, divided.validation, VALIDATION),
    ]
    if split.draw in keys.test.sets:
        parts.append(_Part(split.draw, divided.test, TEST))
    others = [*(name for extra in keys.regimes.values() for name in extra), *keys.test.sets]
    whole = [name for name in dict.fromkeys(others) if name != split.draw]
    return parts + [_Part(name, range(sizes[name]), WHOLE) for name in whole]


def _size(draw: Draw) -> int:
    return draw.count or (draw.per_distance or 0) * len(draw.distances_mm)


def _splits(
    keys: Protocol, ids: dict[tuple[str, int], list[int]]
) -> dict[str, dict[str, list[int]]]:
    """One a regime: what ``fit`` is handed in it, and what the protocol tests on."""
    assert keys.split is not None, "checked before"  # noqa: S101
    draw = keys.split.draw
    test = [ids.get((name, TEST), []) + ids.get((name, WHOLE), []) for name in keys.test.sets]
    return {
        f"{keys.id}-{regime}": {
            "train": [*ids[draw, FIT], *(number for name in extra for number in ids[name, WHOLE])],
            "validation": ids[draw, VALIDATION],
            "test": [number for numbers in test for number in numbers],
        }
        for regime, extra in keys.regimes.items()
    }
