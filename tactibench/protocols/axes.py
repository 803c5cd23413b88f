"""The graded axis of a family of hard cases, and how its cases are called as groups."""

from __future__ import annotations

from dataclasses import dataclass


def case(family: str, value: float) -> str:
    """Group of one case: "grazing:0.05"."""
    return f"{family}:{value:g}"


def family_of(group: str) -> str:
    """The family of a case's group."""
    return group.partition(":")[0]


@dataclass(frozen=True)
class Axis:
    """A family of cases, from easy to hard.

    values: graded, the easiest first. harder: "rising", "falling", or "unordered". easy: value of
    the reference, None where there is none. reference: its group, "" for none; it may belong to
    another family whose frames this one changes.
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
        """Of the graded cases, the easiest first."""
        return tuple(case(self.family, value) for value in self.values)

    @property
    def ordered(self) -> bool:
        """Whether there is a point on the axis at which an error doubles."""
        return self.harder != "unordered" and self.easy is not None
