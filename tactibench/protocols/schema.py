"""The schema of a protocol file. Unknown keys are errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Annotated, Literal, Self

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from tactibench.contacts import Grid
from tactibench.errors import did_you_mean
from tactibench.protocols.families import (
    FAMILIES,
    UNTOUCHED,
    Axis,
    Cases,
    Family,
    Name,
    Names,
    Presses,
    Stream,
    Strict,
)

Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**64)]
Length = Annotated[float, Field(ge=-100, le=100)]
Offset = Annotated[tuple[Length, Length, Length], Field(strict=False)]
"""A tip's place on the holder and its height, mm; a higher tip touches sooner."""

RECORDED = "recorded"
"""Name of the one set of presses that a recorded folder holds."""


class Workspace(Strict):
    """The box of every tip of every press, mm."""

    half_width_mm: PositiveFloat
    dome_radius_mm: PositiveFloat
    depth_min_mm: PositiveFloat
    depth_max_mm: PositiveFloat

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.depth_min_mm >= self.depth_max_mm:
            raise ValueError("depth_min_mm must be smaller than depth_max_mm")
        if self.half_width_mm >= self.dome_radius_mm:
            raise ValueError("half_width_mm must be smaller than dome_radius_mm")
        return self

    @property
    def diagonal_mm(self) -> float:
        """Largest distance between two tips inside the workspace."""
        return 2 * math.sqrt(2) * self.half_width_mm


class GridKeys(Strict):
    """The heatmap grid around the apex."""

    cells: Annotated[int, Field(ge=8, le=512)]
    pitch_mm: PositiveFloat

    def grid(self) -> Grid:
        """Return the grid in millimetres."""
        return Grid.centred(self.cells, self.pitch_mm)


class Defaults(Strict):
    """The plugins of a run for which none are named."""

    sensor: Name
    encoder: Name


class Draw(Strict):
    """A named set of presses, drawn by rejection from one stream of the data seed.

    tip_count, apart_mm: of a scattered indenter, a new one each press. Its tips lie anywhere in the
    workspace, at least so far apart, and each has a depth of its own.
    """

    name: Name
    indenter: Literal["single", "dual", "triple", "tips", "scattered"]
    radius_mm: PositiveFloat
    stream: Stream
    count: Presses | None = None
    per_distance: Presses | None = None
    distances_mm: tuple[PositiveFloat, ...] = Field(default=(), strict=False)
    side_mm: PositiveFloat | None = None
    heights_mm: tuple[Annotated[float, Field(ge=0)], ...] = Field(default=(), strict=False)
    offsets_mm: tuple[Offset, ...] = Field(default=(), strict=False)
    tip_count: Annotated[int, Field(ge=2, le=8)] | None = None
    apart_mm: PositiveFloat | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.count is None) == (self.per_distance is None):
            raise ValueError(f"draw {self.name!r} needs either count or per_distance")
        dual, triple = self.indenter == "dual", self.indenter == "triple"
        if dual != bool(self.distances_mm):
            raise ValueError(f"draw {self.name!r}: distances_mm belongs to a dual indenter")
        if len(set(self.distances_mm)) != len(self.distances_mm):
            raise ValueError(f"draw {self.name!r}: distances_mm holds a distance twice")
        if self.per_distance is not None and not dual:
            raise ValueError(f"draw {self.name!r}: per_distance belongs to a dual indenter")
        if triple != bool(self.heights_mm) or triple != (self.side_mm is not None):
            raise ValueError(f"draw {self.name!r}: side_mm and heights_mm belong to a triple")
        scattered = self.indenter == "scattered"
        if {scattered} != {self.tip_count is not None, self.apart_mm is not None}:
            raise ValueError(
                f"draw {self.name!r}: tip_count and apart_mm belong to a scattered indenter"
            )
        if (self.indenter == "tips") != bool(self.offsets_mm):
            raise ValueError(f"draw {self.name!r}: offsets_mm belongs to indenter 'tips'")
        if len({(x, y) for x, y, _ in self.offsets_mm}) != len(self.offsets_mm):
            raise ValueError(f"draw {self.name!r}: offsets_mm holds two tips at one place")
        return self

    @property
    def tips(self) -> int:
        """Number of tips."""
        several = len(self.offsets_mm) or self.tip_count
        return several or {"single": 1, "dual": 2, "triple": 3}[self.indenter]

    @property
    def span_mm(self) -> float:
        """Largest distance between two tips."""
        places = [(x, y) for x, y, _ in self.offsets_mm]
        apart = (math.dist(a, b) for a, b in combinations(places, 2))
        least = (self.side_mm or 0.0, self.apart_mm or 0.0)
        return max((*self.distances_mm, *least, *apart))


class Split(Strict):
    """The division of one draw by press into training, validation and test presses."""

    draw: Name
    test: Presses
    validation: Presses


class Recorded(Strict):
    """The division of the presses of a recorded folder."""

    test_frames: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")] | None = None
    test_frames_size: tuple[PositiveInt, PositiveInt] | None = Field(default=None, strict=False)
    test_share: Share
    validation_share: Share

    @model_validator(mode="after")
    def _together(self) -> Self:
        if (self.test_frames is None) != (self.test_frames_size is None):
            raise ValueError("test_frames and test_frames_size belong together")
        return self


class Plates(Strict):
    """Presses of a tilted plate for a sensor that makes its own frames, drawn uniformly.

    depth: over the workspace. tilt_deg: at most, to either side. yaw_deg: where on the frame a
    positive tilt moves the contact to.
    """

    count: Annotated[int, Field(ge=10, le=1_000_000)]
    stream: Stream
    tilt_deg: Annotated[float, Field(gt=0, le=45)]
    yaw_deg: Annotated[float, Field(gt=-360, lt=360)]


class Transfer(Strict):
    """The test is on another sensor. shots: how many of its labelled frames a model is given."""

    shots: tuple[Annotated[int, Field(ge=0, le=100_000)], ...] = Field(min_length=1, strict=False)
    stream: Stream

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.shots[0] != 0 or list(self.shots) != sorted(set(self.shots)):
            raise ValueError("shots must begin with 0 and rise")
        return self


class ApartTest(Strict):
    """Presses that are tested after the others and scored apart, in groups of their own.

    metrics: that are computed of them. instances: of the sensor, which press them in turn; empty:
    the sensor itself presses them, so that they are geometries that no training has seen.
    """

    name: Annotated[str, Field(pattern=r"^[a-z]+$")]
    sets: Names = Field(min_length=1)
    metrics: tuple[str, ...] = Field(min_length=1, strict=False)
    instances: tuple[Annotated[int, Field(ge=1)], ...] = Field(default=(), strict=False)


class Test(Strict):
    """The presses that are scored, and the matching of predictions to the truth."""

    __test__ = False  # not a test case, whatever its name

    sets: Names = Field(min_length=1)
    group: Literal["all", "distance", "indenter", "case"]
    gate_mm: PositiveFloat
    cluster: Literal["press"]
    level: Share
    catch: Name | None = None
    # Without the key it is the fit of the first versions of exp2 and fine.
    psychometric: Literal["logistic", "lapse"] = "logistic"
    apart: tuple[ApartTest, ...] = Field(default=(), strict=False)


class Metrics(Strict):
    """The metrics of a protocol, in the order of its tables."""

    names: tuple[str, ...] = Field(min_length=1, strict=False)


class Published(Strict):
    """Names of the published tables that stand beside the results."""

    tables: Names = ()


class Protocol(Strict):
    """One protocol file."""

    schema_: Literal[1] = Field(alias="schema")
    id: Name
    version: PositiveInt
    title: str
    answer: Literal["contacts", "plate"]
    data_seed: Seed
    workspace: Workspace
    grid: GridKeys
    defaults: Defaults
    draws: tuple[Draw, ...] = Field(default=(), strict=False)
    split: Split | None = None
    recorded: Recorded | None = None
    plates: Plates | None = None
    transfer: Transfer | None = None
    cases: Cases | None = None
    families: tuple[Family, ...] = Field(default=(), strict=False)
    regimes: dict[Name, Names] = Field(min_length=1)
    test: Test
    metrics: Metrics
    published: Published

    @property
    def label(self) -> str:
        """Name with version, as "exp1@1"."""
        return f"{self.id}@{self.version}"

    def draw(self, name: str) -> Draw:
        """Return the draw of that name."""
        return next(draw for draw in self.draws if draw.name == name)

    @property
    def tested_draws(self) -> tuple[str, ...]:
        """The draws that are tested on the sensor itself, those that are scored apart last."""
        apart = (name for one in self.test.apart if not one.instances for name in one.sets)
        return (*self.test.sets, *apart)

    def family(self, name: str) -> Family:
        """Return the family of that name."""
        return next(family for family in self.families if family.name == name)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of all families, in their order; empty for a protocol without hard cases."""
        if self.cases is None:
            return ()
        base = self.family(self.cases.base)
        return tuple(family.axis(base) for family in self.families)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for sentence in contradictions(self):
            raise ValueError(sentence)
        return self


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
    yield from _repeated("test.apart", (one.name for one in spec.test.apart))
    apart = [name for one in spec.test.apart for name in one.sets]
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
