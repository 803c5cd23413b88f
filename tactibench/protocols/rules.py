"""Rules that several keys of a protocol must obey together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from tactibench.errors import did_you_mean
from tactibench.protocols.families import FAMILIES, RECORDED, UNTOUCHED, Cases

if TYPE_CHECKING:
    from tactibench.protocols.schema import Protocol, Split


def contradictions(spec: Protocol) -> Iterator[str]:
    """Yield the rules that a protocol breaks, most telling first."""
    if (spec.split is None) == (spec.recorded is None):
        yield "exactly one of [split] and [recorded] is needed"
    yield from _repeated("draws", (draw.name for draw in spec.draws))
    yield from _repeated("test.sets", spec.test.sets)
    yield from _repeated("metrics.names", spec.metrics.names)
    streams = Counter([*(d.stream for d in spec.draws), *(f.stream for f in spec.families)])
    if streams and max(streams.values()) > 1:
        kind = "draws or families" if spec.families else "draws"
        yield f"two {kind} take the same stream: they would share presses"
    yield from _about_families(spec)
    yield from _about_apart(spec)
    if spec.recorded is not None:
        yield from _about_recorded(spec)
    if spec.split is not None:
        yield from _about_drawn(spec, spec.split)
    yield from _about_transfer(spec)


def _repeated(key: str, names: Iterable[str]) -> Iterator[str]:
    for name, count in Counter(names).items():
        if count > 1:
            yield f"{key} holds {name!r} {count} times; it must hold it once"


def _about_apart(spec: Protocol) -> Iterator[str]:
    if spec.test.apart and (spec.split is None or spec.families):
        yield "[[test.apart]] belongs to a protocol that draws its test presses"
        return
    yield from _repeated("test.apart", (apart_set.name for apart_set in spec.test.apart))
    apart = [name for apart_set in spec.test.apart for name in apart_set.sets]
    yield from _repeated("sets of test.apart", apart)
    names = [draw.name for draw in spec.draws]
    trained = [name for draws in spec.regimes.values() for name in draws]
    for name in apart:
        if name not in names:
            yield f"no draw is named {name!r}; {_near(name, names)}"
        elif name in spec.test.sets or name in trained or name == (spec.split and spec.split.draw):
            yield f"draw {name!r} of [[test.apart]] is trained on or tested with the others, too"


def _about_recorded(spec: Protocol) -> Iterator[str]:
    if spec.draws:
        yield "a protocol of recorded presses draws none: leave out either [recorded] or [[draws]]"
    if any(spec.regimes.values()):
        yield "a protocol of recorded presses has no draws to add to a regime: leave them empty"
    if spec.test.sets != (RECORDED,) or spec.test.catch is not None:
        yield f"a protocol of recorded presses tests sets = [{RECORDED!r}] and has no catch trials"
    if spec.test.group != "all":
        yield "a protocol of recorded presses has group = 'all'"


def _about_transfer(spec: Protocol) -> Iterator[str]:
    for name in ("plates", "transfer"):
        if getattr(spec, name) is not None and (spec.recorded is None or spec.answer != "plate"):
            yield f"[{name}] belongs to a protocol with [recorded] and answer = 'plate'"
    if spec.transfer is None:
        if spec.plates is not None:
            yield "[plates] is what is trained on where [transfer] is tested: add [transfer]"
        return
    if spec.plates is not None and spec.plates.stream == spec.transfer.stream:
        yield "[plates] and [transfer] take the same stream: they would share random numbers"
    if spec.recorded is not None and spec.recorded.test_frames is not None:
        yield "a protocol with [transfer] tests on folders of any kind: leave out test_frames"


def _about_drawn(spec: Protocol, split: Split) -> Iterator[str]:
    if spec.answer == "plate":
        yield "answer = 'plate' needs [recorded]: no draw presses a plate"
    names = [draw.name for draw in spec.draws]
    trained = [name for draws in spec.regimes.values() for name in draws]
    catch = [] if spec.test.catch is None else [spec.test.catch]
    tested = () if spec.families else spec.test.sets
    for name in (split.draw, *trained, *tested, *catch):
        if name not in names:
            yield f"no draw is named {name!r}; {_near(name, names)}"
            return
    for regime, draws in spec.regimes.items():
        yield from _repeated(f"regimes.{regime}", draws)
        if split.draw in draws:
            yield (
                f"regime {regime!r} must not name draw {split.draw!r}: the training share of the "
                "split is always in it"
            )
    for name in trained:
        if name in spec.test.sets:
            yield f"draw {name!r} is both trained on and tested"
    base = spec.draw(split.draw)
    if base.count is None:
        yield f"the split divides draw {base.name!r}, which must have a count"
    elif split.test + split.validation >= base.count:
        yield (
            f"the split takes {split.test} test and {split.validation} validation presses of the "
            f"{base.count} of draw {base.name!r}, which leaves none to train on"
        )
    if not spec.families:
        yield from _about_test(spec, catch)
    for draw in spec.draws:
        if draw.span_mm > spec.workspace.diagonal_mm:
            yield (
                f"draw {draw.name!r} has tips {draw.span_mm} mm apart, but the workspace is "
                f"{spec.workspace.diagonal_mm:.1f} mm across"
            )


def _about_families(spec: Protocol) -> Iterator[str]:
    if not spec.families:
        if spec.cases is not None:
            yield "[cases] is about [[families]], but there are none: add some, or leave it out"
        if spec.test.group == "case":
            yield "test.group = 'case' needs [[families]]"
        return
    names = [family.name for family in spec.families]
    yield from _repeated("families", names)
    if spec.split is None:
        yield "[[families]] are pressed by a sensor: a protocol with them needs [split]"
    if spec.test.sets != (FAMILIES,) or spec.test.group != "case" or spec.test.catch is not None:
        yield (
            f"a protocol with [[families]] tests sets = [{FAMILIES!r}], has group = 'case' and no "
            "catch trials"
        )
    if spec.cases is None:
        yield "[[families]] need [cases], which says how many presses a case has"
        return
    base = next((family for family in spec.families if family.name == spec.cases.base), None)
    if base is None:
        yield f"cases.base: no family is named {spec.cases.base!r}; {_near(spec.cases.base, names)}"
    elif base.press is None or len(base.pressed_values) != 1:
        yield f"cases.base {base.name!r} must press scenes and have one value and no easy one"
    elif base.sensor or (base.presses or spec.cases.presses) < spec.cases.presses:
        yield (
            f"cases.base {base.name!r} must be pressed by the sensor as it is, and as often as any "
            "case: faults are done to its frames"
        )
    yield from _about_untouched(spec, spec.cases, names)


def _about_untouched(spec: Protocol, cases: Cases, names: list[str]) -> Iterator[str]:
    if (cases.empty is None) != (not cases.untouched):
        yield "cases.empty and cases.untouched belong together"
        return
    yield from _repeated("cases.untouched", cases.untouched)
    if UNTOUCHED in names:
        yield f"no family may be named {UNTOUCHED!r}: groups of cases.untouched begin so"
    for name in (*cases.untouched, *([] if cases.empty is None else [cases.empty])):
        if name not in names:
            yield f"[cases]: no family is named {name!r}; {_near(name, names)}"
        elif name == cases.empty and spec.family(name).press != "nothing":
            yield f"cases.empty {name!r} must press 'nothing'"
        elif name != cases.empty and spec.family(name).fault is None:
            yield f"cases.untouched names {name!r}, which is no family of a fault"


def _near(name: str, names: list[str]) -> str:
    return did_you_mean(name, names).rstrip(".")


def _about_test(spec: Protocol, catch: list[str]) -> Iterator[str]:
    for name in catch:
        if name not in spec.test.sets:
            yield f"test.catch {name!r} must be one of test.sets"
        if spec.draw(name).indenter != "single":
            yield f"test.catch {name!r} must be a draw of single presses"
    if spec.test.group == "distance":
        for name in spec.test.sets:
            if name not in catch and spec.draw(name).indenter != "dual":
                yield f"test.group = 'distance' needs dual presses, which draw {name!r} has not"
