"""Rules between the tables of a protocol file; each broken one is a sentence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from tactibench.errors import did_you_mean

if TYPE_CHECKING:
    from tactibench.protocols.schema import Protocol, Split


def contradictions(keys: Protocol) -> Iterator[str]:
    """What is wrong, most telling first."""
    if (keys.split is None) == (keys.recorded is None):
        yield "exactly one of [split] and [recorded] is needed"
    yield from _repeated("draws", (draw.name for draw in keys.draws))
    yield from _repeated("test.sets", keys.test.sets)
    yield from _repeated("metrics.names", keys.metrics.names)
    streams = Counter([*(d.stream for d in keys.draws), *(f.stream for f in keys.families)])
    if streams and max(streams.values()) > 1:
        kind = "draws or families" if keys.families else "draws"
        yield f"two {kind} take the same stream: they would share presses"
    yield from _about_families(keys)
    if keys.recorded is not None:
        yield from _about_recorded(keys)
    if keys.split is not None:
        yield from _about_drawn(keys, keys.split)
    yield from _about_transfer(keys)


def _repeated(key: str, names: Iterable[str]) -> Iterator[str]:
    for name, count in Counter(names).items():
        if count > 1:
            yield f"{key} holds {name!r} {count} times; it must hold it once"


def _about_recorded(keys: Protocol) -> Iterator[str]:
    from tactibench.protocols.schema import RECORDED

    if keys.draws:
        yield "a protocol of recorded presses draws none: leave out either [recorded] or [[draws]]"
    if any(keys.regimes.values()):
        yield "a protocol of recorded presses has no draws to add to a regime: leave them empty"
    if keys.test.sets != (RECORDED,) or keys.test.catch is not None:
        yield f"a protocol of recorded presses tests sets = [{RECORDED!r}] and has no catch trials"
    if keys.test.group != "all":
        yield "a protocol of recorded presses has group = 'all'"


def _about_transfer(keys: Protocol) -> Iterator[str]:
    for name in ("plates", "transfer"):
        if getattr(keys, name) is not None and (keys.recorded is None or keys.answer != "plate"):
            yield f"[{name}] belongs to a protocol with [recorded] and answer = 'plate'"
    if keys.transfer is None:
        if keys.plates is not None:
            yield "[plates] is what is trained on where [transfer] is tested: add [transfer]"
        return
    if keys.plates is not None and keys.plates.stream == keys.transfer.stream:
        yield "[plates] and [transfer] take the same stream: they would share random numbers"
    if keys.recorded is not None and keys.recorded.test_frames is not None:
        yield "a protocol with [transfer] tests on folders of any kind: leave out test_frames"


def _about_drawn(keys: Protocol, split: Split) -> Iterator[str]:
    if keys.answer == "plate":
        yield "answer = 'plate' needs [recorded]: no draw presses a plate"
    names = [draw.name for draw in keys.draws]
    trained = [name for draws in keys.regimes.values() for name in draws]
    catch = [] if keys.test.catch is None else [keys.test.catch]
    tested = () if keys.families else keys.test.sets
    for name in (split.draw, *trained, *tested, *catch):
        if name not in names:
            yield f"no draw is named {name!r}; {_near(name, names)}"
            return
    for regime, draws in keys.regimes.items():
        yield from _repeated(f"regimes.{regime}", draws)
        if split.draw in draws:
            yield (
                f"regime {regime!r} must not name draw {split.draw!r}: the training share of the "
                "split is always in it"
            )
    for name in trained:
        if name in keys.test.sets:
            yield f"draw {name!r} is both trained on and tested"
    base = keys.draw(split.draw)
    if base.count is None:
        yield f"the split divides draw {base.name!r}, which must have a count"
    elif split.test + split.validation >= base.count:
        yield (
            f"the split takes {split.test} test and {split.validation} validation presses of the "
            f"{base.count} of draw {base.name!r}, which leaves none to train on"
        )
    if not keys.families:
        yield from _about_test(keys, catch)
    for draw in keys.draws:
        if draw.span_mm > keys.workspace.diagonal_mm:
            yield (
                f"draw {draw.name!r} has tips {draw.span_mm} mm apart, but the workspace is "
                f"{keys.workspace.diagonal_mm:.1f} mm across"
            )


def _about_families(keys: Protocol) -> Iterator[str]:
    from tactibench.protocols.families import FAMILIES

    if not keys.families:
        if keys.cases is not None:
            yield "[cases] is about [[families]], but there are none: add some, or leave it out"
        if keys.test.group == "case":
            yield "test.group = 'case' needs [[families]]"
        return
    names = [family.name for family in keys.families]
    yield from _repeated("families", names)
    if keys.split is None:
        yield "[[families]] are pressed by a sensor: a protocol with them needs [split]"
    if keys.test.sets != (FAMILIES,) or keys.test.group != "case" or keys.test.catch is not None:
        yield (
            f"a protocol with [[families]] tests sets = [{FAMILIES!r}], has group = 'case' and no "
            "catch trials"
        )
    if keys.cases is None:
        yield "[[families]] need [cases], which says how many presses a case has"
        return
    base = next((one for one in keys.families if one.name == keys.cases.base), None)
    if base is None:
        yield f"cases.base: no family is named {keys.cases.base!r}; {_near(keys.cases.base, names)}"
    elif base.press is None or len(base.pressed_values) != 1:
        yield f"cases.base {base.name!r} must press scenes and have one value and no easy one"
    elif base.sensor or (base.presses or keys.cases.presses) < keys.cases.presses:
        yield (
            f"cases.base {base.name!r} must be pressed by the sensor as it is, and as often as any "
            "case: faults are done to its frames"
        )


def _near(name: str, names: list[str]) -> str:
    return did_you_mean(name, names).rstrip(".")


def _about_test(keys: Protocol, catch: list[str]) -> Iterator[str]:
    for name in catch:
        if name not in keys.test.sets:
            yield f"test.catch {name!r} must be one of test.sets"
        if keys.draw(name).indenter != "single":
            yield f"test.catch {name!r} must be a draw of single presses"
    if keys.test.group == "distance":
        for name in keys.test.sets:
            if name not in catch and keys.draw(name).indenter != "dual":
                yield f"test.group = 'distance' needs dual presses, which draw {name!r} has not"
