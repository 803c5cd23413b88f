"""The schema of a protocol file. Unknown keys are errors."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Annotated, Literal, Self

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from tactibench.contacts import Grid
from tactibench.protocols.families import (
    Axis,
    Cases,
    Family,
    Name,
    Names,
    Presses,
    Stream,
    Strict,
)
from tactibench.protocols.rules import contradictions

Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**64)]
Length = Annotated[float, Field(ge=-100, le=100)]
Offset = Annotated[tuple[Length, Length, Length], Field(strict=False)]
"""A tip's place on the holder and its height, mm; a higher tip touches sooner."""


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
    """The sensor and the encoder of a run that names none."""

    sensor: Name
    encoder: Name


class Draw(Strict):
    """A named set of presses, drawn by rejection from one stream of the data seed.

    A scattered indenter is a new one in each press: its tips lie anywhere in the workspace, and
    each has a depth of its own.

    Attributes:
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
        stated = len(self.offsets_mm) or self.tip_count
        return stated or {"single": 1, "dual": 2, "triple": 3}[self.indenter]

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
    """The presses that are scored, and the matching of predictions to the truth."""

    __test__ = False  # not a test case, whatever its name

    sets: Names = Field(min_length=1)
    group: Literal["all", "distance", "indenter", "case"]
    gate_mm: PositiveFloat
    cluster: Literal["press"]
    level: Share
    catch: Name | None = None
    # The curve of a two-point threshold has a lapse rate.
    psychometric: Literal["lapse"] = "lapse"
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
