"""Files beside the protocols: what a board shows, and the numbers that papers published.

``exp1.board.toml`` stands beside ``exp1.toml``, so that a change of what is shown leaves the
protocol and its hash alone. A protocol without such a file is not ranked, and its metrics are
shown in one table.

There is one TOML file per paper under ``leaderboards/published``. Names of metrics and groups are
those of a run's record, so that a published row stands beside a measured one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, field_validator

from tactibench.errors import UserError, did_you_mean, read_file
from tactibench.protocols.loader import protocol_files
from tactibench.protocols.schema import Protocol, SchemaT, parse_toml
from tactibench.shipped import shipped_folder

SUFFIX = ".board.toml"
COMMON = f"common{SUFFIX}"
"""File beside the protocols of tactibench, with tables that several of them show."""
OVERVIEW = f"overview{SUFFIX}"
"""File beside the protocols of tactibench, with the table over several boards."""
REAL = f"real{SUFFIX}"
"""File beside the protocols of tactibench, with the page of real recordings."""

Text = Annotated[str, Field(min_length=1)]
Decimals = Annotated[int, Field(ge=0, le=9)]


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Shown(_Frozen):
    """A metric of a group, as it is shown.

    Attributes:
        metric: Name of the metric.
        group: Group of the metric.
        decimals: Decimals of its values.
    """

    metric: Text
    group: Text = "all"
    decimals: Decimals


class Ranking(Shown):
    """The error that orders a board: a metric of which less is better.

    Attributes:
        name: Name of the error in sentences and on axes.
        unit: Unit of its values.
    """

    name: Text
    unit: str = "mm"

    @property
    def head(self) -> str:
        """Name and unit, for the head of a column and for an axis."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


class Column(Shown):
    """A metric in a table.

    Attributes:
        head: Head of the column.
        interval: Whether the interval stands below the value.
        spread: Whether the standard deviation over training seeds stands beside the value.
        percent: Whether a share is shown in per cent whose metric has no unit.
    """

    head: Text
    interval: bool = True
    spread: bool = True
    percent: bool = False


class Block(_Frozen):
    """A table of a board.

    Attributes:
        title: Title of the table.
        columns: The metrics in the table. A column with ``groups`` in the file stands for one
            column per group; ``{group}`` in its head becomes the name of the group.
        note: Explanation for the reader of the table.
        optional: Whether the table is left out where no row has its first column.
        apart: Name of the test, scored apart, whose error orders and ranks the rows; "": none.
        below: Metric -> name of a share; the share of the column's group stands below the metric.
    """

    title: Text
    columns: Annotated[tuple[Column, ...], Field(min_length=1)]
    note: str = ""
    optional: bool = False
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


class BoardSpec(_Frozen):
    """A protocol's board: its ranking, its tables, and the tables of one run.

    Attributes:
        ranking: The error that orders the board; None: the protocol is not ranked.
        apart: Name of a test that is scored apart -> the error that ranks it.
        depth: The error of the depth, which stands beside one in the plane; None: it needs none.
        note: How to read the tables of a run.
        remark: What a reader of the board has to know: the error that ranks it, and the rows.
        blocks: Tables of the board.
        common: Names of tables that other protocols show, too.
        run_tables: Main tables of one run.
    """

    ranking: Ranking | None = None
    apart: Mapping[str, Ranking] = {}
    depth: Ranking | None = None
    note: str = ""
    remark: str = ""
    blocks: tuple[Block, ...] = ()
    common: tuple[str, ...] = ()
    run_tables: tuple[RunTable, ...] = ()

    @property
    def metrics(self) -> frozenset[str]:
        """Names of all metrics that are shown."""
        columns = (column for block in self.blocks for column in block.columns)
        shown = (self.ranking, self.depth, *self.apart.values(), *columns)
        in_runs = {name for table in self.run_tables for name in table.metrics}
        return frozenset({one.metric for one in shown if one is not None} | in_runs)


class OverviewColumn(Shown):
    """A metric of the overview.

    Attributes:
        name: Name of the column.
        protocol: Protocol whose rows give the values.
        recording: First eight digits of the sha256 of the real recording whose rows give the
            values; "": the row of the same training.
        brief: Whether the column stands in the short table, too.
        head: Head of the column.
    """

    name: Text
    protocol: Text
    recording: str = ""
    brief: bool = False
    head: Text


class OverviewSpec(_Frozen):
    """The table over several boards.

    Attributes:
        protocol: Protocol whose rows are the lines of the table.
        order: Names of columns. The first orders the lines; those without a value follow, in the
            order of the next one.
        note: Explanation for the reader of the table.
        columns: The metrics in the table.
    """

    protocol: Text
    order: Annotated[tuple[Text, ...], Field(min_length=1)]
    note: Text
    columns: Annotated[tuple[OverviewColumn, ...], Field(min_length=1)]


class RealLine(Ranking):
    """A column of the page of real recordings: an error on each recording of a protocol.

    Attributes:
        protocol: Id of the protocol.
        table: Title of its table.
    """

    protocol: Text
    table: Text


class RealSpec(_Frozen):
    """The page of real recordings.

    Attributes:
        simulated: Protocol of the simulated boards whose order of models is compared.
        note: Explanation of the tables of errors.
        tau_note: Explanation of the comparison with simulated boards.
        names: First eight digits of the sha256 of a recording -> its name.
        lines: The errors that are shown, in the order of the columns.
    """

    simulated: Text
    note: Text
    tau_note: Text
    names: Mapping[str, Text]
    lines: tuple[RealLine, ...]


class _Common(_Frozen):
    blocks: dict[str, Block]


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


@cache
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


@cache
def real_spec() -> RealSpec:
    """Return what the page of real recordings shows."""
    return _read(shipped_folder("protocols") / REAL, RealSpec)


def _common_blocks() -> dict[str, Block]:
    return _read(shipped_folder("protocols") / COMMON, _Common).blocks


def _read(path: Path, schema: type[SchemaT]) -> SchemaT:
    return parse_toml(read_file(path, "board file"), schema, f"board file {path}")


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


def load_published(names: Iterable[str], folder: Path | None = None) -> list[PublishedTable]:
    """Read ``folder/NAME.toml`` for every name, in that order; None: the tables that ship.

    Raises:
        UserError: A name is unknown, or its file cannot be read, is not TOML, or has a wrong or
            missing key.
    """
    folder = folder or shipped_folder("leaderboards/published")
    known, tables = published_names(folder), []
    for name in names:
        if name not in known:
            raise UserError(
                f"{folder} holds no published table {name!r}; {did_you_mean(name, known)}"
            )
        path = folder / f"{name}.toml"
        table = parse_toml(read_file(path, "published table"), PublishedTable, str(path))
        if table.name != name:
            raise UserError(f"{path}, key name: is {table.name!r}, but must be {name!r}.")
        tables.append(table)
    return tables


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
