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
from tactibench.protocols.loader import archived_files, protocol_files
from tactibench.shipped import shipped_folder

SUFFIX = ".board.toml"
COMMON = f"common{SUFFIX}"
"""Beside the protocols of tactibench: tables that several of them show."""
OVERVIEW = f"overview{SUFFIX}"
"""Beside the protocols of tactibench: the table over several boards."""

Text = Annotated[str, Field(min_length=1)]
Decimals = Annotated[int, Field(ge=0, le=9)]


SchemaT = TypeVar("SchemaT", bound=BaseModel)


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Ranking(_Frozen):
    """The error that orders a board: a metric of which less is better.

    name: in sentences and on axes.
    """

    metric: Text
    group: Text
    name: Text
    decimals: Decimals
    unit: str = "mm"


class Column(_Frozen):
    """A metric in a table. interval: shown below the value. spread: over seeds, beside it."""

    metric: Text
    group: Text = "all"
    head: Text
    decimals: Decimals
    interval: bool = True
    spread: bool = True


class Block(_Frozen):
    """A table of a board. optional: left out where no row has its first column.

    columns: one with ``groups`` in the file stands for one a group, ``{group}`` in its head.
    below: metric -> a share that stands below its value in a column of one group. sorted: whether
    the rows stand in the order of the first column, not in that of the board. apart: name of the
    test that is scored apart whose error orders and ranks the rows.
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
        if not isinstance(columns, list) or not all(isinstance(one, dict) for one in columns):
            return columns  # said in a sentence by the check of the type
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
    """A main table of one run. metrics: name -> decimals. groups: its rows, () for all distances.

    compared: whether published rows and other runs follow below the run's own.
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

    apart: the errors that rank tests that are scored apart from the main one, by their names.
    note: how to read a run's tables. common: names of tables that other protocols show, too.
    """

    ranking: Ranking | None = None
    apart: Mapping[str, Ranking] = {}
    headline: Headline | None = None
    note: str = ""
    blocks: tuple[Block, ...] = ()
    common: tuple[str, ...] = ()
    run_tables: tuple[RunTable, ...] = ()


class OverviewColumn(_Frozen):
    """A metric of the overview. published_frames: of a real recording, on the published frames."""

    name: Text
    protocol: Text
    metric: Text
    group: Text = "all"
    published_frames: bool = False
    head: Text
    decimals: Decimals


class OverviewSpec(_Frozen):
    """The table over several boards. protocol: whose rows are its lines. order: a column's name."""

    protocol: Text
    order: Text
    note: Text
    columns: Annotated[tuple[OverviewColumn, ...], Field(min_length=1)]


class _Common(_Frozen):
    blocks: dict[str, Block]


@cache
def board_spec(protocol: str) -> BoardSpec:
    """Return what the board of a protocol shows; nothing special where its file is not known.

    protocol: its id or label. An archived version may have a board file of its own; where it has
    none, it is shown as the present one.

    Raises:
        UserError: its file is no board file.
    """
    path = archived_files().get(protocol)
    if path is None or not path.with_suffix(SUFFIX).is_file():
        path = protocol_files().get(protocol.partition("@")[0])
    return BoardSpec() if path is None else read_board_spec(path)


def read_board_spec(protocol_file: Path) -> BoardSpec:
    """Read the board file beside a protocol file, with the common tables that it names.

    Raises:
        UserError: the file cannot be read, has a wrong or missing key, or names no common table.
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
