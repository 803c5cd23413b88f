"""Published numbers: what a paper prints, and what its tables say about themselves.

One TOML file a paper under ``leaderboards/published``. Metric and group names are those of a run's
record, so that a published row stands beside a measured one.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from tactibench.errors import UserError, did_you_mean

Text = Annotated[str, Field(min_length=1)]
AXES = ("x", "y", "z")


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PublishedSpeed(_Frozen):
    """A published rate: which phase, items per second, on what."""

    phase: Text
    per_s: Annotated[FiniteFloat, Field(gt=0)]
    hardware: Text


class ReleasedAnswers(_Frozen):
    """Answers released to every test frame, in a CSV file that ships beside the data.

    Its rows stand in the order of the protocol's test frames. sha256: of the file. depth, tilt:
    columns of the answer and of the label that it was meant for.
    """

    file: Annotated[str, Field(pattern=r"^[\w-][\w.-]*$")]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    depth: tuple[Text, Text]
    tilt: tuple[Text, Text]


class PublishedRow(_Frozen):
    """One row of a published table.

    metrics: name -> group -> value. decimals: of the values as printed. comparable: whether it may
    be read against a row measured here; note says why or why not. released: where its answers to
    the single frames are, for a comparison frame for frame.
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
        """A printed value; None where the paper has none."""
        return self.metrics.get(metric, {}).get(group)


class Claim(_Frozen):
    """A figure or word of a note, and the quantity that it stands for.

    note, row: their numbers in the file, from 1. says: as it stands in the note. values: what the
    quantity is computed from where that is no row: low and high of a uniform range, or how many of
    how many were dropped.
    """

    note: Annotated[int, Field(ge=1)]
    says: Text
    quantity: Literal[
        "printed",
        "printed, %",
        "n",
        "mean of axes",
        "root mean square of axes",
        "aggregation",
        "target sd",
        "target sd, least",
        "target sd, most",
        "half width of uniform targets",
        "sd of uniform targets",
        "kept, %",
    ]
    row: Annotated[int, Field(ge=1)] | None = None
    metric: Text | None = None
    group: Text | None = None
    values: tuple[FiniteFloat, ...] = ()


class PublishedTable(_Frozen):
    """One paper: its rows, what they were measured on, and notes on their consistency.

    claims: the figures of the notes, for `tactibench published check`.
    """

    schema_version: Literal[1]
    name: Text
    title: Text
    authors: Text
    year: Annotated[int, Field(ge=1900, le=2200)]
    measured_on: Text
    recipe: str = ""
    notes: tuple[Text, ...] = ()
    claims: tuple[Claim, ...] = ()
    rows: Annotated[tuple[PublishedRow, ...], Field(min_length=1)]


def published_names(folder: Path) -> list[str]:
    """Names of the tables in a folder, sorted."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def load_published(names: Iterable[str], folder: Path) -> list[PublishedTable]:
    """Read ``folder/NAME.toml`` for every name, in that order.

    Raises UserError for an unknown name, a file that is no TOML, or a wrong or missing key.
    """
    known = published_names(folder)
    return [_load(name, folder, known) for name in names]


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


def rows_for(protocol: str, table: PublishedTable) -> tuple[PublishedRow, ...]:
    """The rows of a table that belong to a protocol, in file order."""
    return tuple(row for row in table.rows if row.protocol == protocol)


def published_means(tables: Sequence[PublishedTable]) -> list[tuple[str, float]]:
    """Label and mean distance error of every published row of exp2."""
    pairs = (
        (row.label, row.value("distance_mae_mm", "all"))
        for table in tables
        for row in rows_for("exp2", table)
    )
    return [(label, value) for label, value in pairs if value is not None]


def mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def root_mean_square(values: Sequence[float]) -> float:
    return math.sqrt(math.fsum(value * value for value in values) / len(values))


def aggregation(axes: Sequence[float], stated: float, decimals: int) -> str:
    """How a stated average came from its axes: "mean", "root mean square", "either" or "neither".

    All values are rounded to ``decimals``. A rounding error of h in every axis moves either average
    by at most h, and the stated one has its own h, hence a tolerance of 2 h = 10^-decimals.
    """
    tolerance = 10.0**-decimals
    is_mean = abs(mean(axes) - stated) <= tolerance
    is_square = abs(root_mean_square(axes) - stated) <= tolerance
    if is_mean and is_square:
        return "either"
    return "mean" if is_mean else "root mean square" if is_square else "neither"


def target_sd(rmse: float, r2: float) -> float:
    """Standard deviation of the targets that an RMSE and an R2 imply: RMSE / sqrt(1 - R2).

    From R2 = 1 - RMSE^2 / sd^2. Raises ValueError for R2 >= 1.
    """
    if r2 >= 1:
        raise ValueError(f"R2 is {r2}, but must be below 1 to imply a spread of the targets")
    return rmse / math.sqrt(1 - r2)


def target_sd_range(rmse: float, r2: float, decimals: int) -> tuple[float, float]:
    """Smallest and largest ``target_sd`` of all values that round to the two printed ones."""
    half = 0.5 * 10.0**-decimals
    high = math.inf if r2 + half >= 1 else target_sd(rmse + half, r2 + half)
    return target_sd(rmse - half, r2 - half), high


def uniform_sd(low: float, high: float) -> float:
    """Standard deviation of values drawn uniformly from low to high."""
    return (high - low) / math.sqrt(12)


@dataclass(frozen=True)
class Finding:
    """Something a published row implies. low, high: what the rounding of the print allows."""

    row: str
    metric: str
    group: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    note: str = ""


def findings(table: PublishedTable) -> list[Finding]:
    """What the rows of a table say about themselves, recomputed from the printed values."""
    return [finding for row in table.rows for finding in (*_averages(row), *_implied_targets(row))]


def _averages(row: PublishedRow) -> Iterable[Finding]:
    for metric in ("mae_mm", "rmse_mm"):
        axes = _axes(row.metrics.get(metric, {}))
        stated = row.value(metric, "mean")
        if stated is None or axes is None:
            continue
        kind = aggregation(axes, stated, row.decimals)
        note = f"printed {stated}, which is {kind}"
        yield Finding(row.label, f"{metric}_average", "mean", mean(axes), "mm", note=note)
        square = root_mean_square(axes)
        yield Finding(row.label, f"{metric}_average", "root mean square", square, "mm", note=note)


def _implied_targets(row: PublishedRow) -> Iterable[Finding]:
    for axis in "xyz":
        rmse, r2 = row.value("rmse_mm", axis), row.value("r2", axis)
        if rmse is None or r2 is None or r2 >= 1:
            continue
        low, high = target_sd_range(rmse, r2, row.decimals)
        yield Finding(row.label, "target_sd_mm", axis, target_sd(rmse, r2), "mm", low, high)


def _axes(groups: Mapping[str, float]) -> tuple[float, ...] | None:
    return tuple(groups[axis] for axis in "xyz") if set("xyz") <= set(groups) else None
