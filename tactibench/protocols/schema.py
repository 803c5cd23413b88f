"""The schema of a protocol file. Unknown keys are errors."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from tactibench.contacts import Grid
from tactibench.protocols.axes import Axis
from tactibench.protocols.families import Cases, Family
from tactibench.protocols.strict import Name, Names, Presses, Stream, Strict

Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**64)]

RECORDED = "recorded"
"""Name of the one set of presses that a recorded folder holds."""


class Workspace(Strict):
    """Where every tip of every press lies, mm."""

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
        return Grid.centred(self.cells, self.pitch_mm)


class Defaults(Strict):
    """What a run takes when nothing is said."""

    sensor: Name
    encoder: Name


class Draw(Strict):
    """A named set of presses, drawn by rejection from one stream of the data seed."""

    name: Name
    indenter: Literal["single", "dual", "triple"]
    radius_mm: PositiveFloat
    stream: Stream
    count: Presses | None = None
    per_distance: Presses | None = None
    distances_mm: tuple[PositiveFloat, ...] = Field(default=(), strict=False)
    side_mm: PositiveFloat | None = None
    heights_mm: tuple[Annotated[float, Field(ge=0)], ...] = Field(default=(), strict=False)

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
        return self

    @property
    def span_mm(self) -> float:
        """Largest distance between two tips."""
        return max((*self.distances_mm, self.side_mm or 0.0))


class Split(Strict):
    """How one draw is divided by press into training, validation and test presses."""

    draw: Name
    test: Presses
    validation: Presses


class Recorded(Strict):
    """How the presses of a recorded folder are divided."""

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


class Test(Strict):
    """What is scored, and how predictions are matched to the truth."""

    __test__ = False  # not a test case, whatever its name

    sets: Names = Field(min_length=1)
    group: Literal["all", "distance", "indenter", "case"]
    gate_mm: PositiveFloat
    cluster: Literal["press"]
    level: Share
    catch: Name | None = None


class Metrics(Strict):
    names: tuple[str, ...] = Field(min_length=1, strict=False)


class Published(Strict):
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

    def draw(self, name: str) -> Draw:
        return next(draw for draw in self.draws if draw.name == name)

    def family(self, name: str) -> Family:
        return next(family for family in self.families if family.name == name)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Of all families, in their order; empty for a protocol without hard cases."""
        if self.cases is None:
            return ()
        base = self.family(self.cases.base)
        return tuple(family.axis(base) for family in self.families)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        from tactibench.protocols.consistency import contradictions

        for sentence in contradictions(self):
            raise ValueError(sentence)
        return self
