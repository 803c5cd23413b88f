"""The ranking and the tables of a protocol, declared in a file beside it.

``exp1.board.toml`` stands beside ``exp1.toml``, so that a change of what is shown leaves the
protocol and its hash alone. A protocol without such a file is not ranked, and its metrics are
shown in one table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import protocol_files
from tactibench.shipped import shipped_folder

SUFFIX = ".board.toml"
COMMON = f"common{SUFFIX}"
"""File beside the protocols of tactibench, with tables that several of them show."""
OVERVIEW = f"overview{SUFFIX}"
"""File beside the protocols of tactibench, with the table over several boards."""

Text = Annotated[str, Field(min_length=1)]
Decimals = Annotated[int, Field(ge=0, le=9)]


SchemaT = TypeVar("SchemaT", bound=BaseModel)


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Ranking(_Frozen):
    """The error that orders a board: a metric of which less is better.

    Attributes:
        metric: Name of the metric.
        group: Group of the metric.
        name: Name of the error in sentences and on axes.
        decimals: Decimals of its values.
        unit: Unit of its values.
    """

    metric: Text
    group: Text
    name: Text
    decimals: Decimals
    unit: str = "mm"


class Column(_Frozen):
    """A metric in a table.

    Attributes:
        metric: Name of the metric.
        group: Group of the metric.
        head: Head of the column.
        decimals: Decimals of the values.
        interval: Whether the interval stands below the value.
        spread: Whether the standard deviation over training seeds stands beside the value.
        percent: Whether a share is shown in per cent whose metric has no unit.
        interpolated: Whether the seeds are counted whose value is interpolated, instead of the
            values shown.
    """

    metric: Text
    group: Text = "all"
    head: Text
    decimals: Decimals
    interval: bool = True
    spread: bool = True
    percent: bool = False
    interpolated: bool = False


class Block(_Frozen):
    """A table of a board.

    Attributes:
        title: Title of the table.
        columns: The metrics in the table. A column with ``groups`` in the file stands for one
            column per group; ``{group}`` in its head becomes the name of the group.
        note: Explanation for the reader of the table.
        optional: Whether the table is left out where no row has its first column.
        sorted: Whether the rows stand in the order of the first column, not in that of the board.
        apart: Name of the test, scored apart, whose error orders and ranks the rows; "": none.
        below: Metric -> name of a share; the share of the column's group stands below the metric.
    """

    title: Text
    columns: Annotated[tuple[Column, ...], Field(min_length=1)]
    note: str = ""
    optional: bool = False
    sorted: bool = False
    apart: str = ""
    below: Mapping[str, str] = {}

    @field_validator("columns", mode="before")
    @classmethod
    def _one_a_group(cls, columns: Any) -> Any:
        if not isinstance(columns, list) or not all(isinstance(entry, dict) for entry in columns):
            return columns  # the check of the type says so in a sentence
        return [single for column in columns for single in _singles(column)]


def _singles(column: dict[str, Any]) -> list[dict[str, Any]]:
    if not isinstance(column.get("groups"), list):
        return [column]
    shared = {name: value for name, value in column.items() if name != "groups"}
    head = str(column.get("head", "{group}"))
    return [
        {**shared, "group": group, "head": head.replace("{group}", str(group).rpartition(":")[2])}
        for group in column["groups"]
    ]


class RunTable(_Frozen):
    """A main table of one run.

    Attributes:
        title: Title of the table.
        metrics: Name of a metric -> decimals of its values.
        groups: The groups that are its rows; (): all distances.
        compared: Whether published rows and other runs follow below the run's own rows.
    """

    title: Text
    metrics: Annotated[dict[str, Decimals], Field(min_length=1)]
    groups: tuple[str, ...] = ()
    compared: bool = True


class Headline(_Frozen):
    """The error to show beside speed, and the share that qualifies it."""

    metric: Text
    group: Text
    qualifier: Text
    decimals: Decimals


class BoardSpec(_Frozen):
    """A protocol's board: its ranking, its tables, and the tables of one run.

    Attributes:
        ranking: The error that orders the board; None: the protocol is not ranked.
        apart: Name of a test that is scored apart -> the error that ranks it.
        headline: The error of one run to show beside its speed.
        note: How to read the tables of a run.
        blocks: Tables of the board.
        common: Names of tables that other protocols show, too.
        run_tables: Main tables of one run.
    """

    ranking: Ranking | None = None
    apart: Mapping[str, Ranking] = {}
    headline: Headline | None = None
    note: str = ""
    blocks: tuple[Block, ...] = ()
    common: tuple[str, ...] = ()
    run_tables: tuple[RunTable, ...] = ()


class OverviewColumn(_Frozen):
    """A metric of the overview.

    Attributes:
        name: Name of the column.
        protocol: Protocol whose rows give the values.
        metric: Name of the metric.
        group: Group of the metric.
        published_frames: Whether the values are those of a real recording, on its published frames.
        head: Head of the column.
        decimals: Decimals of the values.
    """

    name: Text
    protocol: Text
    metric: Text
    group: Text = "all"
    published_frames: bool = False
    head: Text
    decimals: Decimals


class OverviewSpec(_Frozen):
    """The table over several boards.

    Attributes:
        protocol: Protocol whose rows are the lines of the table.
        order: Name of the column that orders the lines.
        note: Explanation for the reader of the table.
        columns: The metrics in the table.
    """

    protocol: Text
    order: Text
    note: Text
    columns: Annotated[tuple[OverviewColumn, ...], Field(min_length=1)]


class _Common(_Frozen):
    blocks: dict[str, Block]


@cache
def board_spec(protocol: str) -> BoardSpec:
    """Return what the board of a protocol shows; an empty spec where it has no board file.

    Args:
        protocol: Id or label of the protocol.

    Raises:
        UserError: The board file cannot be read, has a wrong or missing key, or names a common
            table that does not exist.
    """
    path = protocol_files().get(protocol.partition("@")[0])
    return BoardSpec() if path is None else read_board_spec(path)


def read_board_spec(protocol_file: Path) -> BoardSpec:
    """Read the board file beside a protocol file, with the common tables that it names.

    Without such a file the spec is empty.

    Raises:
        UserError: The file cannot be read, has a wrong or missing key, or names a common table that
            does not exist.
    """
    path = protocol_file.with_suffix(SUFFIX)
    if not path.is_file():
        return BoardSpec()
    spec = _read(path, BoardSpec)
    shared = _common_blocks() if spec.common else {}
    for name in spec.common:
        if name not in shared:
            raise UserError(
                f"board file {path}: key 'common' holds {name!r}; {did_you_mean(name, shared)}"
            )
    blocks = (*spec.blocks, *(shared[name] for name in spec.common))
    return spec.model_copy(update={"blocks": blocks})


@cache
def overview_spec() -> OverviewSpec:
    """Return what the table over several boards shows."""
    return _read(shipped_folder("protocols") / OVERVIEW, OverviewSpec)


def _common_blocks() -> dict[str, Block]:
    return _read(shipped_folder("protocols") / COMMON, _Common).blocks


def _read(path: Path, schema: type[SchemaT]) -> SchemaT:
    try:
        return schema.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        from tactibench.protocols.mistakes import first_mistake

        raise UserError(f"board file {path}: {first_mistake(error, schema)}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"board file {path} cannot be read: {error}.") from None
