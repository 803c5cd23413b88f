"""Families of hard cases: a press, a fault or a sensor parameter, graded by one number."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, model_validator

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
        for key in ("radius_mm", "depth_mm", "apart_mm", "ring_mm"):
            if (getattr(self, key) is not None) != (key in needed):
                verb = "needs" if key in needed else "takes no"
                change = self.press or self.fault or "parameter"
                raise ValueError(f"family {self.name!r} of {change!r} {verb} {key}")
        if not self.press and (self.sensor or self.presses):
            raise ValueError(
                f"family {self.name!r} takes the presses of the base family: leave sensor and "
                "presses out"
            )
        if self.depth_mm is not None and self.depth_mm[0] > self.depth_mm[1]:
            raise ValueError(f"family {self.name!r}: depth_mm must not fall")
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
        elif self.easy in self.values:
            raise ValueError(f"family {self.name!r} has its easy value among its values")
        if self.press == "ring" and any(v != round(v) or v < 1 for v in self.pressed_values):
            raise ValueError(f"family {self.name!r}: values are numbers of tips, 1 and more")
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
