"""The schema of a protocol file. Unknown keys are errors."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, model_validator

from tactibench.contacts import Grid

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]*$")]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
Share = Annotated[float, Field(gt=0, lt=1)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Workspace(_Strict):
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


class GridKeys(_Strict):
    """The heatmap grid around the apex."""

    cells: Annotated[int, Field(ge=8, le=512)]
    pitch_mm: PositiveFloat

    def grid(self) -> Grid:
        return Grid.centred(self.cells, self.pitch_mm)


class Defaults(_Strict):
    """What a run takes when nothing is said."""

    sensor: Name
    encoder: Name


class Draw(_Strict):
    """A named set of presses, drawn by rejection from one stream of the data seed."""

    name: Name
    indenter: Literal["single", "dual", "triple"]
    radius_mm: PositiveFloat
    stream: PositiveInt
    count: PositiveInt | None = None
    per_distance: PositiveInt | None = None
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
        if self.per_distance is not None and not dual:
            raise ValueError(f"draw {self.name!r}: per_distance belongs to a dual indenter")
        if triple != bool(self.heights_mm) or triple != (self.side_mm is not None):
            raise ValueError(f"draw {self.name!r}: side_mm and heights_mm belong to a triple")
        return self


class Split(_Strict):
    """How one draw is divided by press into training, validation and test presses."""

    draw: Name
    test: PositiveInt
    validation: PositiveInt


class Recorded(_Strict):
    """How the presses of a recorded folder are divided."""

    test_frames: str | None = None
    test_frames_size: tuple[PositiveInt, PositiveInt] | None = Field(default=None, strict=False)
    test_share: Share
    validation_share: Share


class Test(_Strict):
    """What is scored, and how predictions are matched to the truth."""

    __test__ = False  # not a test case, whatever its name

    sets: Names = Field(min_length=1)
    group: Literal["all", "distance", "indenter"]
    gate_mm: PositiveFloat
    cluster: Literal["press"]
    level: Share
    catch: Name | None = None


class Metrics(_Strict):
    names: tuple[str, ...] = Field(min_length=1, strict=False)


class Published(_Strict):
    tables: Names = ()


class Protocol(_Strict):
    """One protocol file."""

    schema_: Literal[1] = Field(alias="schema")
    id: Name
    version: PositiveInt
    title: str
    answer: Literal["contacts", "plate"]
    data_seed: Annotated[int, Field(ge=0)]
    workspace: Workspace
    grid: GridKeys
    defaults: Defaults
    draws: tuple[Draw, ...] = Field(default=(), strict=False)
    split: Split | None = None
    recorded: Recorded | None = None
    regimes: dict[Name, Names] = Field(min_length=1)
    test: Test
    metrics: Metrics
    published: Published

    def draw(self, name: str) -> Draw:
        return next(draw for draw in self.draws if draw.name == name)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.split is None) == (self.recorded is None):
            raise ValueError("exactly one of [split] and [recorded] is needed")
        names = [draw.name for draw in self.draws]
        if len(set(names)) != len(names):
            raise ValueError("two draws have the same name")
        if len({draw.stream for draw in self.draws}) != len(names):
            raise ValueError("two draws take the same stream: they would share presses")
        known = {*names, *(["recorded"] if self.recorded else [])}
        wanted = {*self.test.sets, *(d for draws in self.regimes.values() for d in draws)}
        wanted |= {self.split.draw} if self.split else set()
        wanted |= {self.test.catch} if self.test.catch else set()
        if wanted - known:
            raise ValueError(f"no draw is named {sorted(wanted - known)[0]!r}")
        if self.split:
            shared = {d for draws in self.regimes.values() for d in draws} & set(self.test.sets)
            if shared:
                raise ValueError(f"draw {sorted(shared)[0]!r} is both trained on and tested")
            count = self.draw(self.split.draw).count or 0
            if self.split.test + self.split.validation >= count:
                raise ValueError("the split leaves no press to train on")
        return self
