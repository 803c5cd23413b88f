"""The base of all tables of a protocol file: unknown keys are errors, names are plain words."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]*$")]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
Presses = Annotated[int, Field(ge=1, le=1_000_000)]
Stream = Annotated[int, Field(ge=1, lt=1_000_000)]


class Strict(BaseModel):
    """A table; frozen, nothing converted, no NaN and no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
