"""What a sweep's file may hold."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    StrictStr,
    model_validator,
)

AXES = ("protocol", "model", "regime", "encoder", "sensor", "seed")
ANY = "*"
"""Stands for every name, in a table by name."""


def _listed(value: Any) -> Any:
    """One thing is a list of one."""
    return value if isinstance(value, list | tuple) else [value]


def _by_name(value: Any) -> Any:
    """One text is that of every name."""
    return {ANY: value} if isinstance(value, str) else value


Text = Annotated[StrictStr, Field(min_length=1)]
Seed = Annotated[StrictInt, Field(ge=0)]
Count = Annotated[StrictInt, Field(ge=1)]
Texts = Annotated[tuple[Text, ...], BeforeValidator(_listed)]
Seeds = Annotated[tuple[Seed, ...], BeforeValidator(_listed)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Exclusion(_Strict):
    """Cells that are left out: those that have one of the values on every axis that is named."""

    protocol: Texts = ()
    model: Texts = ()
    regime: Texts = ()
    encoder: Texts = ()
    sensor: Texts = ()
    seed: Seeds = ()

    @model_validator(mode="after")
    def _names_something(self) -> Exclusion:
        if not self.model_fields_set:
            raise ValueError(f"name what is left out, by one or more of {', '.join(AXES)}")
        return self


class GenerateKeys(_Strict):
    """A data set to be pressed; the keys are the options of ``tactibench data generate``."""

    out: Text
    protocol: Text | None = None
    plan: Text | None = None
    sensor: Text | None = None
    params: Texts = ()
    count: Count | None = None
    seed: Seed | None = None


class SweepKeys(_Strict):
    """One list an axis, and what holds for all cells.

    device, data: one for all cells, or a table by model or by protocol ("*": any other).
    """

    protocol: Texts = ()
    model: Texts = ()
    regime: Texts = ()
    encoder: Texts = ()
    sensor: Texts = ()
    seed: Seeds = (0,)
    device: Annotated[dict[str, Literal["cpu", "cuda"]], BeforeValidator(_by_name)] = {ANY: "cpu"}
    data: Annotated[dict[str, Text], BeforeValidator(_by_name)] = {}
    params: Texts = ()
    test: Texts = ()
    quick: StrictBool = False
    limit: Count | None = None
    presses: Count | None = None
    exclude: Annotated[tuple[Exclusion, ...], BeforeValidator(_listed)] = ()
    generate: Annotated[tuple[GenerateKeys, ...], BeforeValidator(_listed)] = ()

    @model_validator(mode="after")
    def _asks_for_something(self) -> SweepKeys:
        runs = bool(self.protocol or self.model)
        if not runs and not self.generate:
            raise ValueError(
                "nothing is asked for; name runs with 'protocol' and 'model', or data sets with "
                "[[generate]]"
            )
        for axis in ("protocol", "model") if runs else ():
            if not getattr(self, axis):
                raise ValueError(f"the key {axis!r} is missing; runs need 'protocol' and 'model'")
        if not self.seed:
            raise ValueError("the key 'seed' holds no seed; leave it out, or list one")
        return self
