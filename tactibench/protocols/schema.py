"""The schema of a protocol file: keys, families of hard cases, and rules that keys obey together.

Unknown keys are errors. A family of hard cases is a press, a fault or a sensor parameter, graded by
one number.
"""

from __future__ import annotations

import tomllib
import typing
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)

from tactibench.contacts import Grid
from tactibench.errors import UserError, did_you_mean

SchemaT = TypeVar("SchemaT", bound=BaseModel)

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]*$")]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
Presses = Annotated[int, Field(ge=1, le=1_000_000)]
Stream = Annotated[int, Field(ge=1, lt=1_000_000)]

RECORDED = "recorded"
"""Name of the one set of presses that a recorded folder holds."""
FAMILIES = "families"
"""Name of the one set of presses that a protocol of hard cases tests."""

Press = Literal[
    "nothing",
    "anywhere",
    "depth",
    "tip-radius",
    "sheared",
    "off-axis",
    "distance",
    "equal-depths",
    "symmetric",
    "beside",
    "ring",
]
"""The change that a value makes of the scene, see `tactibench.frames.hard_scenes`."""

Fault = Literal[
    "blur",
    "noise",
    "gain",
    "glare",
    "gain-drift",
    "dead-rows",
    "occlusion",
    "lost-pins",
    "spurious-blobs",
    "shift",
    "rotation",
]
"""The change that a value makes to a frame of the base family, see `tactibench.frames.faults`."""

NEEDS: dict[str, frozenset[str]] = {
    "nothing": frozenset({"radius_mm"}),
    "anywhere": frozenset({"radius_mm"}),
    "depth": frozenset({"radius_mm"}),
    "tip-radius": frozenset({"depth_mm"}),
    "sheared": frozenset({"radius_mm", "depth_mm"}),
    "off-axis": frozenset({"radius_mm", "depth_mm"}),
    "distance": frozenset({"radius_mm"}),
    "equal-depths": frozenset({"radius_mm", "depth_mm"}),
    "symmetric": frozenset({"radius_mm", "depth_mm"}),
    "beside": frozenset({"radius_mm", "depth_mm", "apart_mm"}),
    "ring": frozenset({"radius_mm", "depth_mm", "ring_mm"}),
}
"""Kind of press -> keys of the lengths that stay the same in all cases of a family."""


UNTOUCHED = "untouched"
"""Begins the names of groups of frames in which nothing presses, under a fault: "untouched:dim"."""


def subgroup(whole: str, name: str) -> str:
    """Return the group of a part of a family, or of a test that is scored apart."""
    return f"{whole}:{name}"


def untouched(family: str) -> str:
    """Return the group of frames in which nothing presses, under the fault of a family."""
    return subgroup(UNTOUCHED, family)


def case(family: str, value: float) -> str:
    """Return the group of one case: "grazing:0.05"."""
    return subgroup(family, f"{value:g}")


def family_of(group: str) -> str:
    """Return the family of a case's group, or the test of a group that is scored apart."""
    return group.partition(":")[0]


def _check_lengths(
    what: str, table: Strict, lengths: frozenset[str], needed: frozenset[str]
) -> None:
    """Raise ValueError where a table lacks a key that it needs, or has one that it does not."""
    for key in sorted(lengths):
        if bool(getattr(table, key)) != (key in needed):
            raise ValueError(f"{what} {'needs' if key in needed else 'takes no'} {key}")


class Strict(BaseModel):
    """A table of a protocol file; frozen, nothing converted, no NaN and no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Axis:
    """A family of cases, from easy to hard.

    Attributes:
        family: Name of the family.
        title: The family in words, with what the values are.
        unit: Unit of the values.
        harder: Direction in which values become harder: "rising", "falling", or "unordered".
        easy: Value of the reference case; None where there is none.
        values: Values of the graded cases, the easiest first.
        reference: Group of the reference case, "" for none. It may belong to another family whose
            frames this one changes.
    """

    family: str
    title: str
    unit: str
    harder: str
    easy: float | None
    values: tuple[float, ...]
    reference: str

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the graded cases, the easiest first."""
        return tuple(case(self.family, value) for value in self.values)

    @property
    def ordered(self) -> bool:
        """True where there is a point on the axis at which an error doubles."""
        return self.harder != "unordered" and self.easy is not None


class Cases(Strict):
    """The settings that all families share.

    Attributes:
        presses: Number of presses of every case.
        base: Family whose frames the faults are done to. Its only case is the easy case of every
            family of faults and of sensor parameters.
        empty: Family in which nothing presses.
        untouched: Families whose faults are done to the frames of ``empty``, too, one to a frame.
    """

    presses: Presses
    base: Name
    empty: Name | None = None
    untouched: Names = ()


class Family(Strict):
    """One way in which a press becomes hard. Exactly one of press, fault, parameter is given.

    Attributes:
        name: Name of the family; groups of its cases are named ``name:value``.
        title: The family in words, with what the values are.
        unit: Unit of the values.
        harder: Direction in which values become harder; "unordered": they have no order.
        easy: Value of the reference case; None for a family without one.
        values: A case each, from easy to hard.
        stream: Random stream of the data seed.
        press: The change that a value makes of the scene.
        fault: The change that a value makes to a frame of the base family.
        parameter: Parameter of the sensor, which presses the scenes of the base family with each
            value.
        sensor: Parameters of the sensor in all cases.
        presses: Number of presses of every case; None: that of `Cases`.
        radius_mm: Radius of the tips.
        depth_mm: Range of the deepest tip's depth.
        apart_mm: Distance of two tips.
        ring_mm: Radius of the circle on which several tips stand.
    """

    name: Name
    title: str
    unit: str = ""
    harder: Literal["rising", "falling", "unordered"]
    easy: float | None = None
    values: tuple[float, ...] = Field(min_length=1, strict=False)
    stream: Stream
    press: Press | None = None
    fault: Fault | None = None
    parameter: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] | None = None
    sensor: dict[str, str] = Field(default_factory=dict)
    presses: Presses | None = None
    radius_mm: PositiveFloat | None = None
    depth_mm: tuple[PositiveFloat, PositiveFloat] | None = Field(default=None, strict=False)
    apart_mm: PositiveFloat | None = None
    ring_mm: PositiveFloat | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [kind for kind in ("press", "fault", "parameter") if getattr(self, kind)]
        if len(kinds) != 1:
            raise ValueError(f"family {self.name!r} needs exactly one of press, fault, parameter")
        needed = NEEDS[self.press] if self.press else frozenset()
        _check_lengths(f"family {self.name!r}", self, NEEDS["ring"] | NEEDS["beside"], needed)
        if not self.press and (self.sensor or self.presses):
            raise ValueError(
                f"family {self.name!r} takes the presses of the base family: leave sensor and "
                "presses out"
            )
        return self

    @model_validator(mode="after")
    def _graded(self) -> Self:
        if len({case(self.name, value) for value in self.values}) < len(self.values):
            raise ValueError(f"family {self.name!r} holds a value twice")
        if self.harder != "unordered":
            if self.easy is None:
                raise ValueError(f"family {self.name!r} is {self.harder}: it needs an easy value")
            sign = 1 if self.harder == "rising" else -1
            if any(sign * (b - a) <= 0 for a, b in pairwise((self.easy, *self.values))):
                raise ValueError(
                    f"family {self.name!r} gets harder {self.harder}: easy and values must be in "
                    "that order"
                )
        return self

    @property
    def pressed_values(self) -> tuple[float, ...]:
        """Values of all cases that have frames of their own, the easy one first."""
        presses_easy = self.press is not None and self.easy is not None
        return (self.easy, *self.values) if presses_easy and self.easy is not None else self.values

    def axis(self, base: Family) -> Axis:
        """Return the axis of the family, whose groups are those of a record.

        Args:
            base: The family whose frames faults are done to.
        """
        reference = ""
        if self.easy is not None:
            reference = (
                case(self.name, self.easy) if self.press else case(base.name, base.values[0])
            )
        return Axis(
            self.name, self.title, self.unit, self.harder, self.easy, self.values, reference
        )


def contradictions(spec: Protocol) -> Iterator[str]:
    """Yield the rules that a protocol breaks, most telling first."""
    if sum(table is not None for table in (spec.split, spec.recorded, spec.sites)) != 1:
        yield "exactly one of [split], [recorded] and [sites] is needed"
    if (spec.sites is None) != (spec.answer != "sites"):
        yield "[sites] and answer = 'sites' belong together"
    yield from _repeated("draws", (draw.name for draw in spec.draws))
    yield from _repeated("families", (family.name for family in spec.families))
    lone = (table for table in (spec.plates, spec.transfer) if table is not None)
    streams = Counter(table.stream for table in (*spec.draws, *spec.families, *lone))
    if streams and max(streams.values()) > 1:
        yield "two tables take the same stream: they would share presses"
    yield from _about_families(spec)
    yield from _about_apart(spec)
    if spec.split is None and (
        spec.draws
        or any(spec.regimes.values())
        or (spec.test.sets, spec.test.group, spec.test.catch) != ((RECORDED,), "all", None)
    ):
        yield (
            "a protocol of recorded presses has no draws, empty regimes, no catch trials, "
            f"sets = [{RECORDED!r}] and group = 'all'"
        )
    if spec.split is not None:
        yield from _about_drawn(spec, spec.split)
    if (spec.plates or spec.transfer) and (spec.recorded is None or spec.answer != "plate"):
        yield "[plates] and [transfer] belong to a protocol with [recorded] and answer = 'plate'"


def _repeated(key: str, names: Iterable[str]) -> Iterator[str]:
    for name, count in Counter(names).items():
        if count > 1:
            yield f"{key} holds {name!r} {count} times; it must hold it once"


def _about_apart(spec: Protocol) -> Iterator[str]:
    if spec.test.apart and (spec.split is None or spec.families):
        yield "[[test.apart]] belongs to a protocol that draws its test presses"
    names = [draw.name for draw in spec.draws]
    used = {*spec.test.sets, *(name for draws in spec.regimes.values() for name in draws)}
    for name in (name for apart_set in spec.test.apart for name in apart_set.sets):
        if name not in names:
            yield f"no draw is named {name!r}; {_near(name, names)}"
        elif name in used or name == (spec.split and spec.split.draw):
            yield f"draw {name!r} of [[test.apart]] is trained on or tested with the others, too"


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
    if split.draw in trained:
        yield f"no regime may name draw {split.draw!r}: its training share is always in it"
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
    for name in catch:
        if name not in spec.test.sets or spec.draw(name).indenter != "single":
            yield f"test.catch {name!r} must be a draw of single presses and one of test.sets"
    if spec.test.group == "distance":
        for name in tested:
            if name not in catch and spec.draw(name).indenter != "dual":
                yield f"test.group = 'distance' needs dual presses, which draw {name!r} has not"


def _about_families(spec: Protocol) -> Iterator[str]:
    if (spec.cases is None) != (not spec.families):
        yield "[cases] and [[families]] belong together"
    if (spec.test.group == "case") != bool(spec.families):
        yield "[[families]] and test.group = 'case' belong together"
    if spec.cases is None or not spec.families:
        return
    if spec.split is None or spec.test.sets != (FAMILIES,) or spec.test.catch is not None:
        yield (
            f"a protocol with [[families]] has [split], tests sets = [{FAMILIES!r}], and has no "
            "catch trials"
        )
    cases, families = spec.cases, {family.name: family for family in spec.families}
    empty = () if cases.empty is None else (cases.empty,)
    for name in (cases.base, *empty, *cases.untouched):
        if name not in families:
            yield f"[cases]: no family is named {name!r}; {_near(name, list(families))}"
            return
    base = families[cases.base]
    if base.press is None or len(base.pressed_values) != 1 or base.sensor or base.presses:
        yield (
            f"cases.base {base.name!r} must press scenes with the sensor as it is, and have one "
            "value and no easy one: faults are done to its frames"
        )
    if bool(empty) != bool(cases.untouched) or any(families[n].press != "nothing" for n in empty):
        yield "cases.untouched needs cases.empty, a family that presses 'nothing'"
    for name in cases.untouched:
        if families[name].fault is None:
            yield f"cases.untouched names {name!r}, which is no family of a fault"


def _near(name: str, names: list[str]) -> str:
    return did_you_mean(name, names).rstrip(".")


Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**64)]
Length = Annotated[float, Field(ge=-100, le=100)]
Offset = Annotated[tuple[Length, Length, Length], Field(strict=False)]
"""A tip's place on the holder and its height, mm; a higher tip touches sooner."""


class Workspace(Strict):
    """The box of every tip of every press, mm.

    Attributes:
        half_width_mm: Largest |x| and |y| of a tip.
        dome_radius_mm: Radius of the undeformed skin.
        depth_min_mm: Depth of the shallowest tip.
        depth_max_mm: Depth of the deepest tip, which is 1 in a heatmap.
    """

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


class GridKeys(Strict):
    """The heatmap grid around the apex.

    Attributes:
        cells: Number of cells along each side.
        pitch_mm: Distance of two cells; the grid is centred on the apex.
    """

    cells: Annotated[int, Field(ge=8, le=512)]
    pitch_mm: PositiveFloat

    def grid(self) -> Grid:
        """Return the grid in millimetres."""
        return Grid.centred(self.cells, self.pitch_mm)


class Defaults(Strict):
    """The sensor and the encoder of a run that names none.

    Attributes:
        sensor: Name of the sensor that makes the frames.
        encoder: Name of the encoder of models that name none themselves.
    """

    sensor: Name
    encoder: Name


INDENTERS: dict[str, frozenset[str]] = {
    "dual": frozenset({"distances_mm"}),
    "triple": frozenset({"side_mm", "heights_mm"}),
    "tips": frozenset({"offsets_mm"}),
    "scattered": frozenset({"tip_count", "apart_mm"}),
}
"""Indenter -> keys of its shape."""
SHAPES = frozenset().union(*INDENTERS.values())
"""Keys of the shape of any indenter."""


class Draw(Strict):
    """A named set of presses, drawn by rejection from one stream of the data seed.

    A scattered indenter is a new one in each press: its tips lie anywhere in the workspace, and
    each has a depth of its own.

    Attributes:
        name: Name by which split, regimes and tests call the draw.
        indenter: Arrangement of the tips that press.
        radius_mm: Radius of the tips.
        stream: Random stream of the data seed; equal streams in several protocols are the same
            presses.
        count: Number of presses; None where ``per_distance`` is given.
        per_distance: Number of presses of every distance of a dual indenter.
        distances_mm: Distances between the tips of a dual indenter.
        side_mm: Side of the triangle of a triple indenter.
        heights_mm: Heights of a triple indenter's tips, drawn independently for each tip.
        offsets_mm: x, y and height of every tip of indenter ``tips``; a higher tip touches sooner.
        tip_count: Number of tips of a scattered indenter.
        apart_mm: Least distance between the tips of a scattered indenter.
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
        if self.per_distance is not None and self.indenter != "dual":
            raise ValueError(f"draw {self.name!r}: per_distance belongs to a dual indenter")
        what = f"draw {self.name!r} of indenter {self.indenter!r}"
        _check_lengths(what, self, SHAPES, INDENTERS.get(self.indenter, frozenset()))
        return self

    @property
    def tips(self) -> int:
        """Number of tips."""
        stated = len(self.offsets_mm) or self.tip_count
        return stated or {"single": 1, "dual": 2, "triple": 3}[self.indenter]


class Split(Strict):
    """The division of one draw by press into training, validation and test presses.

    Attributes:
        draw: Name of the draw that is divided.
        test: Number of test presses.
        validation: Number of presses of the training share that are kept for early stopping.
    """

    draw: Name
    test: Presses
    validation: Presses


class Recorded(Strict):
    """The division of the presses of a recorded folder.

    Attributes:
        test_frames: File with the names of the test frames, for a folder that has them all.
        test_frames_size: Height and width of these frames, pixels.
        test_share: Share of the presses of any other folder that is tested.
        validation_share: Share of the training presses that is kept for early stopping.
    """

    test_frames: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")] | None = None
    test_frames_size: tuple[PositiveInt, PositiveInt] | None = Field(default=None, strict=False)
    test_share: Share
    validation_share: Share

    @model_validator(mode="after")
    def _together(self) -> Self:
        if (self.test_frames is None) != (self.test_frames_size is None):
            raise ValueError("test_frames and test_frames_size belong together")
        return self


class SiteTests(Strict):
    """The training and test trials of a recording that knows which named places are touched.

    A regime that is named here learns from the trials with at most so many touched places, and is
    tested on those with more. Any other regime is tested on sets of places that its training never
    saw, fold by fold, and on each session after a training on the others.

    Attributes:
        most: Regime -> largest number of touched places in a training trial.
        folds: Number of folds of the sets of places.
    """

    most: dict[Name, PositiveInt]
    folds: Annotated[int, Field(ge=2, le=100)]


class Plates(Strict):
    """Presses of a tilted plate for a sensor that makes its own frames.

    Depth is drawn uniformly over the workspace, tilt uniformly to either side.

    Attributes:
        count: Number of presses.
        stream: Random stream of the data seed.
        tilt_deg: Largest tilt to either side.
        yaw_deg: Direction in which a positive tilt moves the contact on the frame; 0: right, 90:
            down.
    """

    count: Annotated[int, Field(ge=10, le=1_000_000)]
    stream: Stream
    tilt_deg: Annotated[float, Field(gt=0, le=45)]
    yaw_deg: Annotated[float, Field(gt=-360, lt=360)]


class Transfer(Strict):
    """A test on another sensor than the trained one.

    Attributes:
        shots: Numbers of labelled frames of the tested sensor that a model is given.
        stream: Random stream of the data seed.
    """

    shots: tuple[Annotated[int, Field(ge=0, le=100_000)], ...] = Field(min_length=1, strict=False)
    stream: Stream

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.shots[0] != 0 or list(self.shots) != sorted(set(self.shots)):
            raise ValueError("shots must begin with 0 and rise")
        return self


class ApartTest(Strict):
    """Presses that are tested after the others and scored apart, in groups of their own.

    Attributes:
        name: Name of the test, with which the groups of its metrics begin.
        sets: Draws that are scored.
        metrics: Metrics that are computed of the presses.
        instances: Instances of the sensor, which press the scenes in turn. Empty: the sensor itself
            presses them, so that they are geometries that no training has seen.
    """

    name: Annotated[str, Field(pattern=r"^[a-z]+$")]
    sets: Names = Field(min_length=1)
    metrics: tuple[str, ...] = Field(min_length=1, strict=False)
    instances: tuple[Annotated[int, Field(ge=1)], ...] = Field(default=(), strict=False)


class Test(Strict):
    """The presses that are scored, and the matching of predictions to the truth.

    Attributes:
        sets: Draws that are scored.
        group: Property by which the rows of a metric are divided.
        gate_mm: Largest distance of a predicted and a true contact that can be a pair.
        cluster: Unit of every interval.
        level: Level of the intervals, such as 0.95.
        catch: Draw of single presses that must not be seen as two.
        psychometric: Curve of a two-point threshold: it has a lapse rate.
        apart: Tests that are scored apart from the main one, after it.
    """

    __test__ = False  # not a test case, whatever its name

    sets: Names = Field(min_length=1)
    group: Literal["all", "distance", "indenter", "case"]
    gate_mm: PositiveFloat
    cluster: Literal["press"]
    level: Share
    catch: Name | None = None
    psychometric: Literal["lapse"] = "lapse"
    apart: tuple[ApartTest, ...] = Field(default=(), strict=False)


class Metrics(Strict):
    """The metrics of a protocol, in the order of its tables.

    Attributes:
        names: Names of the metrics.
    """

    names: tuple[str, ...] = Field(min_length=1, strict=False)


class Published(Strict):
    """Names of the published tables that stand beside the results.

    Attributes:
        tables: Names of files of ``leaderboards/published``.
    """

    tables: Names = ()


class Protocol(Strict):
    """One protocol file.

    Attributes:
        schema_: Version of this format, key ``schema``.
        id: Name of the protocol, as in ``tactibench run ID``.
        version: Version of the protocol, raised with every change.
        title: Question that the protocol asks, in words.
        answer: Kind of answer that a model must return.
        data_seed: Public seed of every press of every draw and split.
        workspace: Box in which the tips lie.
        grid: Grid of the heatmaps.
        defaults: Sensor and encoder of a run that names none.
        draws: Sets of presses.
        split: Division of one draw; a protocol has either this or ``recorded``.
        recorded: Division of the presses of a recorded folder.
        sites: Division of the trials of a recording that knows which named places are touched.
        plates: Presses of a simulated sensor where recordings are tested.
        transfer: Test on another sensor than the trained one.
        cases: Settings that all families of hard cases share.
        families: Families of hard cases, each graded from easy to hard.
        regimes: Name of a regime -> draws that are trained on beside the training share of the
            split.
        test: Presses that are scored, and how.
        metrics: Metrics of the record.
        published: Tables that are printed beside the result.
    """

    schema_: Literal[1] = Field(alias="schema")
    id: Name
    version: PositiveInt
    title: str
    answer: Literal["contacts", "plate", "sites"]
    data_seed: Seed
    workspace: Workspace
    grid: GridKeys
    defaults: Defaults
    draws: tuple[Draw, ...] = Field(default=(), strict=False)
    split: Split | None = None
    recorded: Recorded | None = None
    sites: SiteTests | None = None
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
        apart = (
            name
            for apart_set in self.test.apart
            if not apart_set.instances
            for name in apart_set.sets
        )
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


LONGEST = 40
"""Most characters of a wrong value that are shown."""

_UNKNOWN = {"extra_forbidden", "unexpected_keyword_argument"}
"""pydantic's types of mistake for a key that is not in the schema: of a model, of a dataclass."""


def parse_toml(content: bytes, schema: type[SchemaT], where: str) -> SchemaT:
    """Return the content of a TOML file as a validated pydantic model.

    Args:
        content: Bytes of the file.
        schema: The model.
        where: Words for the file in messages, with its path.

    Raises:
        UserError: The file is not TOML, or a key is wrong or missing.
    """
    try:
        tables = tomllib.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:  # TOML's and Unicode's errors are ValueErrors
        raise UserError(f"{where} is not valid TOML: {error}.") from None
    try:
        return schema.model_validate(tables)
    except ValidationError as error:
        raise UserError(f"{where}: {first_mistake(error, schema)}") from None


def first_mistake(error: ValidationError, schema: type[Any]) -> str:
    """Return the first mistake in a sentence: its key, the wrong value and what is allowed.

    Args:
        error: The exception that the validation raised.
        schema: The pydantic model or the dataclass that the file was validated by.
    """
    mistakes: Sequence[Any] = error.errors(include_url=False)
    # A misspelt key is also a missing one: the misspelling says more.
    mistakes = sorted(mistakes, key=lambda mistake: mistake["type"] not in _UNKNOWN)
    mistake = mistakes[0]
    others = len(mistakes) - 1
    more = f" (and {others} more mistake{'s' if others > 1 else ''})" if others else ""
    where = _key(mistake["loc"])
    if mistake["type"] in _UNKNOWN:
        allowed = sibling_keys(schema, mistake["loc"][:-1])
        return f"unknown key {where!r}{more}; {did_you_mean(str(mistake['loc'][-1]), allowed)}"
    if mistake["type"] in {"missing", "missing_argument"}:
        return f"the key {where!r} is missing{more}; add it."
    text = str(mistake["msg"]).removeprefix("Value error, ").rstrip(".")
    if mistake["type"] == "value_error":
        return f"{f'[{where}] ' if where else ''}{text}{more}."
    text = text[:1].lower() + text[1:]
    if not where:
        return f"{text}{more}; restore the file."
    return f"key {where!r} is {_found(mistake['input'])}: {text}{more}."


def _key(where: Sequence[int | str]) -> str:
    """Return the key as ``draws.2.count``, counted from 1 as a reader counts."""
    return ".".join(str(part + 1) if isinstance(part, int) else str(part) for part in where)


def _found(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def sibling_keys(schema: type[Any], where: Sequence[int | str]) -> list[str]:
    """Return the names of the keys that are allowed at a place of the schema.

    Args:
        schema: The pydantic model or the dataclass.
        where: Keys and list indices that lead to the place.
    """
    model: type[Any] | None = schema
    for part in where:
        if isinstance(part, int) or model is None:
            continue
        model = _model_in(_keys(model).get(str(part)))
    return [] if model is None else list(_keys(model))


def _keys(model: type[Any]) -> dict[str, Any]:
    """Return key -> type of its value."""
    if is_dataclass(model):
        return {field.name: field.type for field in fields(model)}
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def _model_in(annotation: Any) -> type[Any] | None:
    """Return the table behind ``Table``, ``Table | None`` or ``tuple[Table, ...]``."""
    for candidate in (annotation, *typing.get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None
