"""Frames that a sensor makes of the presses a protocol draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from tactibench.frames.presser import Presser
from tactibench.frames.source import FramePlan, Wanted, fewer, scored_limit, spread
from tactibench.protocols.draws import SceneSet
from tactibench.protocols.hidden_seed import HiddenSeed
from tactibench.protocols.schema import Protocol, Split
from tactibench.protocols.split import split_presses
from tactibench.run.components import Sensors
from tactibench.run.request import QUICK_FIT, QUICK_VALIDATION, RunRequest

FIT, VALIDATION, TEST, WHOLE = 0, 1, 2, 3
"""PressSplit of a draw; the frames of each have noise of their own."""

Rows = dict[str, Sequence[int]]
"""Draw -> numbers of its presses."""


def drawn_frames(
    request: RunRequest,
    keys: Protocol,
    split: Split,
    parts: Sensors,
    cache: Path,
    hidden: HiddenSeed | None = None,
) -> FramePlan:
    """Draw the presses and divide them; frames are keyed, not made."""
    extra = keys.regimes[parts.regime]
    presser = Presser(keys, parts.sensor, parts.build_sensor, cache)
    draws = {name: presser.draw(name) for name in {split.draw, *extra}}
    divided = split_presses(len(draws[split.draw].scenes), split, keys.data_seed)

    fit: Rows = {
        split.draw: fewer(divided.fit, request),
        **{name: range(len(draws[name].scenes)) for name in extra},
    }
    validation: Sequence[int] = divided.validation
    if request.quick:
        share = max(1, QUICK_FIT // len(fit))
        fit = {name: rows[:share] for name, rows in fit.items()}
        validation = validation[:QUICK_VALIDATION]

    tester = presser_of_test(keys, parts, cache, hidden)
    known = draws if tester.pressed == presser.pressed else {}
    test, rejected = frames_of_test(request, tester, split, known)
    return FramePlan(
        tuple(
            _wanted(presser, draws[name], split, "fit", name, rows, FIT)
            for name, rows in fit.items()
        ),
        (
            _wanted(
                presser, draws[split.draw], split, "validation", split.draw, validation, VALIDATION
            ),
        ),
        test,
        rejected,
        presser.identity,
        tested_identity=None if parts.tested is None else tester.identity,
    )


def presser_of_test(
    keys: Protocol, parts: Sensors, cache: Path, hidden: HiddenSeed | None = None
) -> Presser:
    """What presses the test scenes of a protocol, drawn from its own or a hidden seed."""
    if hidden is not None:
        keys = keys.model_copy(update={"data_seed": hidden.data_seed})
    return Presser(keys, parts.test_sensor, parts.build_test_sensor, cache, hidden is not None)


def frames_of_test(
    request: RunRequest,
    tester: Presser,
    split: Split,
    known: Mapping[str, SceneSet] = MappingProxyType({}),
) -> tuple[tuple[Wanted, ...], int]:
    """Test presses, and how many candidates geometry refused. known: draws that were made."""
    from tactibench.frames.reference import reference_frames

    if tester.keys.families:
        from tactibench.frames.hard_cases import hard_frames

        return hard_frames(request, tester), 0
    if request.tested.reference:
        return reference_frames(request, tester)
    sets = tester.keys.test.sets
    draws = {name: known.get(name) or tester.draw(name) for name in sets}
    rows: Rows = {name: range(len(drawn.scenes)) for name, drawn in draws.items()}
    if split.draw in rows:
        rows[split.draw] = split_presses(len(rows[split.draw]), split, tester.keys.data_seed).test
    wanted = (
        _wanted(tester, draws[name], split, "test", name, kept, TEST)
        for name, kept in thinned(rows, scored_limit(request)).items()
    )
    rejected = sum(drawn.rejected for name, drawn in draws.items() if name != split.draw)
    return tuple(wanted), rejected


def _wanted(
    presser: Presser,
    drawn: SceneSet,
    split: Split,
    role: str,
    name: str,
    rows: Sequence[int],
    part: int,
) -> Wanted:
    scenes = [drawn.scenes[row] for row in rows]
    names = [f"{name}-{row}" for row in rows]
    return presser.want(role, name, scenes, names, part if name == split.draw else WHOLE)


def thinned(test: Rows, limit: int | None) -> Rows:
    """At most ``limit`` presses of all sets together, evenly spread over them."""
    kept = spread([(name, row) for name, rows in test.items() for row in rows], limit)
    found = {name: [row for of, row in kept if of == name] for name in test}
    return {name: rows for name, rows in found.items() if rows}
