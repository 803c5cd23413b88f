"""Published numbers: the tables of a paper, and notes on their consistency.

There is one TOML file per paper under ``leaderboards/published``. Names of metrics and groups are
those of a run's record, so that a published row stands beside a measured one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.schema import Protocol

Text = Annotated[str, Field(min_length=1)]


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PublishedSpeed(_Frozen):
    """A published rate.

    Attributes:
        phase: The phase that was timed.
        per_s: Items per second.
        hardware: The machine.
    """

    phase: Text
    per_s: Annotated[FiniteFloat, Field(gt=0)]
    hardware: Text


class ReleasedAnswers(_Frozen):
    """Answers to every test frame that a paper released, in a CSV file beside its data.

    The rows of the file stand in the order of the protocol's test frames.

    Attributes:
        file: Name of the file.
        sha256: sha256 of the file.
        depth: Columns of the depth that was answered and of the label that it was meant for.
        tilt: Columns of the tilt that was answered and of the label that it was meant for.
    """

    file: Annotated[str, Field(pattern=r"^[\w-][\w.-]*$")]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    depth: tuple[Text, Text]
    tilt: tuple[Text, Text]


class PublishedRow(_Frozen):
    """One row of a published table.

    Attributes:
        protocol: Id of the protocol that the row belongs to.
        model: Name of the model.
        regime: Training regime; None where the paper has none.
        source: Place of the row in the paper.
        n: Number of ``unit`` behind the values; None where the paper does not say.
        unit: The things that ``n`` counts.
        decimals: Decimals of the values as printed.
        comparable: Whether the row may be compared with one that was measured with tactibench.
        note: Why it may be compared, or why not.
        metrics: Name of a metric -> group -> value.
        speed: Published rate of the model.
        released: Its answers to the single frames, for a comparison frame for frame.
    """

    protocol: Text
    model: Text
    regime: Literal["single", "multiple"] | None = None
    source: Text
    n: Annotated[int, Field(gt=0)] | None = None
    unit: Text = "presses"
    decimals: Annotated[int, Field(ge=0, le=9)]
    comparable: Literal["yes", "partly", "no"]
    note: Text
    metrics: Annotated[
        dict[Text, Annotated[dict[Text, FiniteFloat], Field(min_length=1)]], Field(min_length=1)
    ]
    speed: PublishedSpeed | None = None
    released: ReleasedAnswers | None = None

    @property
    def label(self) -> str:
        """Model, with its regime where there is one."""
        return self.model if self.regime is None else f"{self.model} ({self.regime})"

    def value(self, metric: str, group: str) -> float | None:
        """Return a printed value; None where the paper has none."""
        return self.metrics.get(metric, {}).get(group)


class PublishedTable(_Frozen):
    """One paper: its rows, what they were measured on, and notes on their consistency.

    Attributes:
        sensor: Sensor of the recording that the rows belong to, where the protocols were not made
            for that sensor; "" where they were.
    """

    schema_version: Literal[1]
    name: Text
    title: Text
    authors: Text
    year: Annotated[int, Field(ge=1900, le=2200)]
    measured_on: Text
    sensor: str = ""
    recipe: str = ""
    notes: tuple[Text, ...] = ()
    rows: Annotated[tuple[PublishedRow, ...], Field(min_length=1)]


def published_names(folder: Path) -> list[str]:
    """Return the names of the tables in a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def load_published(names: Iterable[str], folder: Path) -> list[PublishedTable]:
    """Read ``folder/NAME.toml`` for every name, in that order.

    Raises:
        UserError: A name is unknown, or its file cannot be read, is not TOML, or has a wrong or
            missing key.
    """
    available = published_names(folder)
    return [_load(name, folder, available) for name in names]


def _load(name: str, folder: Path, known: Sequence[str]) -> PublishedTable:
    if name not in known:
        raise UserError(f"{folder} holds no published table {name!r}; {did_you_mean(name, known)}")
    path = folder / f"{name}.toml"
    try:
        table = PublishedTable.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not a TOML file: {error}.") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}.") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{path}, key {key}: {first['msg']} ({first['type']}).") from None
    if table.name != name:
        raise UserError(f"{path}, key name: is {table.name!r}, but must be {name!r}, as the file.")
    return table


def published_for(spec: Protocol, folder: Path) -> list[PublishedTable]:
    """Return the tables that a protocol names, and those of other sensors with rows for it.

    Raises:
        UserError: The protocol names an unknown table, or a file cannot be read, is not TOML, or
            has a wrong or missing key.
    """
    named = spec.published.tables
    others = [name for name in published_names(folder) if name not in named]
    tables = load_published(others, folder)
    extra = [table for table in tables if table.sensor and rows_for(spec.id, table)]
    return [*load_published(named, folder), *extra]


def rows_for(protocol: str, table: PublishedTable) -> tuple[PublishedRow, ...]:
    """Return the rows of a table that belong to a protocol, in the order of the file."""
    return tuple(row for row in table.rows if row.protocol == protocol)


def published_means(tables: Sequence[PublishedTable]) -> list[tuple[str, float]]:
    """Return the label and the mean distance error, mm, of every published row of exp2."""
    pairs = (
        (row.label, row.value("distance_mae_mm", "all"))
        for table in tables
        for row in rows_for("exp2", table)
    )
    return [(label, value) for label, value in pairs if value is not None]
