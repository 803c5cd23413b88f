"""The schema of a run record and the invariants that every honest record keeps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeInt,
    ValidationError,
    field_serializer,
    field_validator,
)

from tactibench.contacts import Workspace
from tactibench.errors import UserError
from tactibench.plugins import Prior

SCHEMA = 1
OLDER = "; a record of an older form is read by commit e6a49ac9"
SHARES = ("missed", "resolved", "catch_resolved", "coverage")
"""Metrics that are shares of something and lie in 0..1."""

TABLES = ("metrics", "speed")
"""Lists of a record that a file holds as tables: names of columns once, then the rows."""

ROUNDING = 1e-9
"""Share of a value, or of 1, by which sums in another order may differ."""

Value = bool | int | float | str


class _Strict(BaseModel):
    """A part of a record that has no other keys than the declared ones."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    def json_values(self) -> dict[str, Any]:
        """Return the part as it stands in ``record.json``: the keys that were read or given."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


class _Open(_Strict):
    """A part of a record to which keys may be added; keys that are read are declared."""

    model_config = ConfigDict(extra="allow")

    def __bool__(self) -> bool:
        """Return whether the record holds any key of this part."""
        return bool(self.model_fields_set)


def _table(rows: Sequence[_Strict]) -> dict[str, list[Any]]:
    """Return rows as a table of the columns that any of them states, in the declared order."""
    values = [row.json_values() for row in rows]
    stated = {name for row in values for name in row}
    columns = [name for row in rows[:1] for name in type(row).model_fields if name in stated]
    return {"columns": columns, "data": [[row.get(name) for name in columns] for row in values]}


def _rows(table: Any) -> Any:
    """Return the rows of a table by the names of its columns; a list of rows as it is.

    Raises:
        ValueError: It is no table.
    """
    match table:
        case {"columns": [*columns], "data": [*rows], **others} if not others:
            lengths = {len(row) if isinstance(row, list) else -1 for row in rows}
            named = all(isinstance(name, str) for name in columns)
            if named and len({*columns}) == len(columns) and lengths <= {len(columns)}:
                return [dict(zip(columns, row, strict=True)) for row in rows]
        case [*_]:
            return table
    raise ValueError("a table names each column once in 'columns'; rows in 'data' are as long")


class Metric(_Strict):
    """A metric of one group.

    Attributes:
        metric: Name of the metric.
        group: Name of the group.
        value: None for n/a.
        low: Lower end of the interval.
        high: Upper end of the interval.
        n: Number of values averaged.
        clusters: Number of presses; of sensors in a test that several sensors press.
        unit: Unit of the value.
        better: Which values are better.
        censored: "<" or ">" where the value is only a limit.
        method: How the value was estimated where that is not the metric's usual way;
            "interpolated": between measured shares, because no curve fits them.
    """

    metric: str
    group: str
    value: float | None
    low: float | None
    high: float | None
    n: NonNegativeInt
    clusters: NonNegativeInt
    unit: str
    better: Literal["lower", "higher", "none"]
    censored: Literal["<", ">"] | None = None
    method: Literal["interpolated"] | None = None


class SpeedRow(_Strict):
    """Latency of one phase, ms a call.

    Attributes:
        scenario: "single" (one frame a call) or "offline" (batches).
        threads: Number of threads.
        batch: Frames a call.
        phase: Name of the phase, or "total".
        p50_ms: Median.
        p90_ms: 90 % quantile.
        p99_ms: 99 % quantile.
        mean_ms: Mean.
        per_s: Frames per second, from the mean.
        settled: Whether the times neither drifted nor were disturbed.
        cpu_ms: Mean processor time of the process, ms; None: not measured.
        stolen: Share of the processors that other machines took meanwhile; None: not measured.
        foreign: Share of the processors that other processes took meanwhile; None: not measured.
        load: Load average of the minute before; None: not measured.
    """

    scenario: str
    threads: int
    batch: int
    phase: str
    p50_ms: float
    p90_ms: float
    p99_ms: float
    mean_ms: float
    per_s: float
    settled: bool
    cpu_ms: float | None = None
    stolen: float | None = None
    foreign: float | None = None
    load: float | None = None


class ProtocolId(_Strict):
    """The protocol of a run.

    Attributes:
        id: Name of the protocol.
        version: Its version.
        hash: sha256 of its file.
        title: What it asks, in words.
    """

    id: str
    version: int
    hash: str
    title: str

    @property
    def label(self) -> str:
        """Name with the version, such as "exp1@1"."""
        return f"{self.id}@{self.version}"


class Component(_Strict):
    """A model, encoder or sensor with the values of its parameters.

    Attributes:
        name: Name of the spec.
        parameters: Value of every parameter.
        settings: Names of the parameters that are not at their defaults. A record keeps them,
            because a later version may have other defaults.
    """

    name: str
    parameters: dict[str, Value]
    settings: list[str]

    @property
    def changed(self) -> dict[str, Value]:
        """Parameters that are not at their defaults."""
        return {name: self.parameters[name] for name in self.settings if name in self.parameters}

    @property
    def identity(self) -> dict[str, Any]:
        """Name and all parameters, without ``settings``, which depend on a version's defaults."""
        return {"name": self.name, "parameters": self.parameters}

    @property
    def label(self) -> str:
        """Name with the parameters that are not at their defaults, as in a signature."""
        pairs = ",".join(f"{name}={value}" for name, value in self.changed.items())
        return f"{self.name}({pairs})" if pairs else self.name

    def text(self, *, without: str = "") -> str:
        """Return name and changed parameters for a reader, such as "unet, width=32".

        Args:
            without: Name of a parameter that is left out.
        """
        changed = (f"{name}={value}" for name, value in self.changed.items() if name != without)
        return ", ".join([self.place, *changed])

    @property
    def place(self) -> str:
        """Name for a reader; a sensor adds the recording that it read."""
        return self.name


class TestSensor(Component):
    """The sensor that pressed the test scenes, where it was not the sensor of the training.

    Attributes:
        settings: Always empty: the options say what was set.
        options: Options as given with ``--test``; empty where the model was trained on several
            sensor instances and is tested on the nominal one.
        description: Description in words, such as "finite-element scenes".
        presses: Number of presses that the test frames show.
        trained_on: Description of the training sensor where the model was trained on another
            sensor, such as "real recording 331/model_surface2d".
    """

    __test__ = False  # not a test case, whatever its name

    settings: list[str] = []  # the options say what was set
    options: list[str] = Field(alias="asked")
    description: str = Field(alias="on")
    presses: NonNegativeInt
    trained_on: str | None = None


class RecordingId(_Strict):
    """A recording that a sensor read.

    Attributes:
        label: Name of its folder.
        sha256: Hash of the recording.
        sensor: Sensor that it was made with; "" where the data set does not say.
    """

    label: str
    sha256: str
    sensor: str = ""


class PressedRange(_Strict):
    """The range that was pressed in place of the protocol's range.

    Attributes:
        half_width_mm: Largest x and y, either way.
        depth_min_mm: Smallest depth of a tip; None where depths are not known.
        depth_max_mm: Largest depth of a tip, likewise.
        dome_radius_mm: Radius of the touched surface; None where it is flat.
        gate_mm: Gate in proportion to the half width; None where it was the protocol's.
    """

    half_width_mm: float
    depth_min_mm: float | None = None
    depth_max_mm: float | None = None
    dome_radius_mm: float | None
    gate_mm: float | None = None

    def text(self) -> str:
        """Return a text such as "own range: x and y within 15 mm, 0.5 to 4.5 mm deep, flat"."""
        ends = (self.depth_min_mm, self.depth_max_mm)
        low, high = (math.nan if end is None else end for end in ends)
        radius = math.inf if self.dome_radius_mm is None else self.dome_radius_mm
        text = f"own range: {Workspace(self.half_width_mm, low, high, radius)}"
        return text if self.gate_mm is None else f"{text}, gate {self.gate_mm:.3g} mm"


class SensorId(Component):
    """The sensor of the training.

    Attributes:
        origin: "simulated" or "real".
        test_sensor: Sensor that pressed the test scenes; None where it was this sensor.
        recording: Recording that the sensor read; None where it read none.
        range: Range that was pressed in place of the protocol's; None where it was the protocol's.
    """

    origin: Literal["simulated", "real"]
    test_sensor: TestSensor | None = Field(default=None, alias="tested")
    recording: RecordingId | None = None
    range: PressedRange | None = None

    @property
    def place(self) -> str:
        """Name with the recording, such as "recorded (eFlesh, folder eflesh, sha256 1a2b3c4d)"."""
        if self.recording is None:
            return self.name
        facts = (
            self.recording.sensor,
            f"folder {self.recording.label}",
            f"sha256 {self.recording.sha256[:8]}",
        )
        return f"{self.name} ({', '.join(filter(None, facts))})"

    def text(self, *, without: str = "") -> str:
        """Return name and changed parameters for a reader, with the recording and its own range.

        Args:
            without: Name of a parameter that is left out.
        """
        text = super().text(without=without)
        return text if self.range is None else f"{text}, {self.range.text()}"


class Limits(_Open):
    """The options that cut a run short.

    Attributes:
        quick: Whether ``--quick`` was given.
        limit: Value of ``--limit``; None: not given.
        presses: Number of presses that a model was allowed to learn from; None: all.
    """

    quick: bool = False
    limit: int | None = None
    presses: int | None = None


class Identity(_Open):
    """Hashes of all results of a run, beside everything that they were made from.

    The other keys are those of ``RunPlan.identity``: they are compared as a whole and not read.

    Attributes:
        weights: Hash of everything that determines the weights.
        sensor: The sensor, its parameters and its description of itself, or a hash of these.
        commit: Commit of the code, with ``+dirty`` where files were changed.
        hidden: Commitment to the hidden seed of the test presses.
        plugins: Plugin -> distribution, version and start of the hash of its source.
        data: Hash of the pixels of every set of test frames.
        weights_hash: sha256 of the trained weights.
        predictions_hash: sha256 of the stored answers.
        stored: sha256 of every array file, by name.
        checksum: Digest of the record without this key; None before the record is written.
    """

    weights: str | None = None
    sensor: Any = None
    commit: str = "unknown"
    hidden: str | None = None
    plugins: dict[str, dict[str, str]] = {}
    data: list[str] | None = None
    weights_hash: str
    predictions_hash: str
    stored: dict[str, str]
    checksum: str | None = Field(default=None, alias="sealed")


class Environment(_Open):
    """The machine and the software of a run, see ``run.machine.fingerprint``.

    Attributes:
        cpu: Name of the processor.
        cpu_flags: Its instructions that decide speed.
        cores_logical: Number of threads that run at once.
        gpu: Names of the graphics processors.
        os: Operating system.
        torch: Version of torch.
        fingerprint: Hash of the machine; speeds are compared inside one machine only.
        threads: Number of threads that torch used.
        versions: Versions of other packages.
    """

    cpu: str | None = None
    cpu_flags: list[str] = []
    cores_logical: int | None = None
    gpu: list[str] = []
    os: str | None = None
    torch: str | None = None
    fingerprint: str = "unknown"
    threads: int = 1
    versions: dict[str, str] = {}


class Efficiency(_Open):
    """The size of a model and the work of one frame.

    Attributes:
        parameters: Number of trained weights.
        flops_per_frame: Floating-point operations of one frame; a product and a sum count as two.
        peak_memory_mb: Largest resident memory, MB.
        training_s: Time of the training, s.
    """

    parameters: int | None = None
    flops_per_frame: int | float | None = None
    peak_memory_mb: float | None = None
    training_s: float | None = None


class Training(_Open):
    """A training.

    Attributes:
        epochs: Number of epochs.
        seconds: Time of the training in this run, or when the weights were made, s.
        presses: Number of training presses.
        device: "cpu" or "cuda".
        reused: Whether weights of an earlier run were taken.
        history: One entry an epoch.
        notes: Notes of the model.
        prior: Prior knowledge of the model, see ``FitReport``.
    """

    epochs: int | None = None
    seconds: float | None = None
    presses: int | None = None
    device: str | None = None
    reused: bool = False
    history: list[Any] = []
    notes: dict[str, Any] = {}
    prior: Prior | None = None


class AdaptedSensor(_Open):
    """Everything of the tested sensor that a model saw before its test.

    Attributes:
        rest_image: Whether the frames brought an image of the sensor at rest.
        unlabelled_frames: Number of frames without labels that the model saw.
        labelled_frames: Numbers of labelled frames that the model saw, one test each.
        left_out_calibrated: Number of frames left out, because the training sensor was fitted to
            them.
        described: Description of the tested recording.
        adapted: Settings that the model chose for each number of labelled frames.
    """

    rest_image: bool = False
    unlabelled_frames: int = 0
    labelled_frames: list[int] | None = None
    left_out_calibrated: int = 0
    described: dict[str, Any] = {}
    adapted: list[dict[str, Any]] = []


class Cause(_Open):
    """A cause of failures.

    Attributes:
        cause: Text of the cause.
        frames: Number of frames.
        first: Group of the first frame.
    """

    cause: str
    frames: int
    first: str


class Failures(_Open):
    """Frames on which a model failed.

    Attributes:
        frames: Number of frames without an answer.
        causes: The first twenty causes.
    """

    frames: int = 0
    causes: list[Cause] = []


class SimulatorError(_Open):
    """Bounds on how far a marker is from finite elements in the scenes of a simulated test set, mm.

    Attributes:
        name: Name of the test set.
        scenes: Number of scenes.
        unknown: Number of scenes whose error nobody measured.
        median_mm: Median over the other scenes.
        p95_mm: 95 % quantile over the other scenes.
        max_mm: Largest over the other scenes.
        terms: Term of the simulated field -> number of scenes that need it.
    """

    name: str
    scenes: NonNegativeInt
    unknown: NonNegativeInt
    median_mm: float | None
    p95_mm: float | None
    max_mm: float | None
    terms: dict[str, int] = {}


class FrameCounts(_Open):
    """Numbers of frames, and how exact they are.

    Attributes:
        train: Number of training presses.
        validation: Number of validation presses.
        test: Number of test presses.
        rejected: Number of candidates that geometry rejected when presses were drawn.
        published_frames: Whether the test frames are those of a published data set.
        simulator: Error of the simulator by test set, for simulated frames.
        of_tested_sensor: What a model saw of the tested sensor; None where it saw nothing.
        failures: Frames on which the model failed.
    """

    train: int = 0
    validation: int = 0
    test: int = 0
    rejected: int = 0
    published_frames: bool = False
    simulator: list[SimulatorError] = []
    of_tested_sensor: AdaptedSensor | None = None
    failures: Failures | None = None


class Reproduction(_Strict):
    """A note that the run of a committed record was made again, with metrics within tolerance.

    Attributes:
        by: Who made it again.
        machine: Processor and fingerprint of the machine.
        date: Day, such as "2026-11-27".
    """

    by: str
    machine: str
    date: str


class _MetricIndex:
    """The rows of a list of metrics by metric and group; of two equal ones the first counts."""

    def __init__(self) -> None:
        self.rows: list[Metric] | None = None
        self.count = 0
        self.by_name: dict[tuple[str, str], Metric] = {}


class Record(_Strict):
    """The contents of ``record.json``.

    Attributes:
        schema_: Version of this format, key ``schema``.
        name: Name of the run and of its folder.
        created: Date and time in UTC, ISO 8601.
        protocol: Protocol that was run.
        model: Model that answered, with all its parameters.
        regime: Training frames of the protocol that the model learned from.
        encoder: Encoder that a network was trained through; None for models that use none.
        sensor: Sensor that made the frames.
        seed: Seed of the training; the presses have the protocol's seed.
        partial: Whether the run was cut short; no board takes such a run.
        limits: Options that cut the run short.
        identity: Everything that determines the result; its hash ends ``name``.
        environment: Machine and software.
        metrics: Results, one row a metric and group.
        speed: Times, one row a scenario, batch, number of threads and phase.
        timed: Of a row that was timed in another arithmetic than it was scored in: that arithmetic.
            Nothing but its ``configuration`` is read.
        efficiency: Size of the model and work of one frame.
        training: Training of the model.
        data: Numbers of presses, and what was seen of a tested sensor.
        signature: One line that makes the numbers reproducible; it is printed under every table.
        reproduced: Reproduction of the run by somebody else; None: as submitted.
    """

    schema_: Literal[1] = Field(alias="schema")
    name: str
    created: str
    protocol: ProtocolId
    model: Component
    regime: str
    encoder: Component | None
    sensor: SensorId
    seed: int
    partial: bool
    limits: Limits
    identity: Identity
    environment: Environment
    metrics: list[Metric]
    speed: list[SpeedRow]
    timed: dict[str, Any] = {}
    efficiency: Efficiency = Efficiency()
    training: Training
    data: FrameCounts
    signature: str
    reproduced: Reproduction | None = None

    _read_tables = field_validator(*TABLES, mode="before")(_rows)
    _write_tables = field_serializer(*TABLES)(_table)

    @property
    def shots(self) -> int:
        """Number of labelled presses of the tested sensor that were shown before every answer.

        The options of the test say it; 0 where groups of answers state their own numbers.
        """
        options = [] if self.test_sensor is None else self.test_sensor.options
        counts = [text.removeprefix("shots=") for text in options if text.startswith("shots=")]
        return int(counts[0]) if counts else 0

    @property
    def test_sensor(self) -> TestSensor | None:
        """The sensor that pressed the test scenes, where it was not the sensor of the training."""
        return self.sensor.test_sensor

    def metric(self, metric: str, group: str) -> Metric | None:
        """Return the row of a metric and group, None where there is none."""
        rows, index = self.metrics, self.metric_index
        # The list may have been replaced, or have grown, since the last look-up.
        if index.rows is not rows or index.count != len(rows):
            index.rows, index.count, index.by_name = rows, len(rows), {}
            for row in rows:
                index.by_name.setdefault((row.metric, row.group), row)
        return index.by_name.get((metric, group))

    @cached_property
    def metric_index(self) -> _MetricIndex:
        """The rows of ``metrics`` by name: a board looks up about a hundred of three thousand."""
        return _MetricIndex()

    def value(self, metric: str, group: str) -> float | None:
        """Return the value of a metric and group; None where it is n/a or the row is missing."""
        row = self.metric(metric, group)
        return None if row is None else row.value


def training_instances(record: Record) -> int:
    """Return how many sensors of one make pressed the training frames; 0 for the sensor alone."""
    count = record.sensor.parameters.get("instances", 0)
    return count if isinstance(count, int) and count > 1 else 0


def measured_on(record: Record) -> str:
    """Return "simulated sensor tactip-127", with the test sensor where that is another one."""
    test = record.test_sensor
    if test is not None and test.trained_on:
        return f"real {test.description}, trained on {test.trained_on}"
    text = f"{record.sensor.origin} sensor {record.sensor.place}"
    if count := training_instances(record):
        text += f", trained on {count} instances"
    return text if test is None else f"{text}, tested on {test.description}"


def make_signature(record: Record) -> str:
    """Return one line that makes the numbers of a record reproducible."""
    test = record.test_sensor
    presses = record.limits.presses
    fields = {
        "protocol": f"{record.protocol.label}+{record.protocol.hash[:8]}",
        "model": record.model.label,
        "regime": record.regime,
        "encoder": record.encoder.label if record.encoder else "none",
        "sensor": record.sensor.label,
        "seed": record.seed,
        **({} if presses is None else {"presses": presses}),
        **({} if test is None else {"test": ",".join(test.options) or "nominal"}),
        "weights": record.identity.weights_hash[:8],
        "partial": "yes" if record.partial else "no",
        "machine": record.environment.fingerprint,
        "version": record.environment.versions.get("tactibench", "unknown"),
    }
    return "|".join(f"{name}:{value}" for name, value in fields.items())


def parse_record(values: Any, where: str) -> Record:
    """Return the validated record of a JSON object.

    Args:
        values: JSON object of a record file.
        where: Name of the record in messages.

    Raises:
        UserError: The record has an older form, a key is wrong, or an invariant is broken.
    """
    try:
        record = Record.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        what = f"key {place!r}: {first['msg']}" if place else first["msg"]
        older = OLDER if first["type"] in ("missing", "extra_forbidden", "literal_error") else ""
        raise UserError(f"{where} is no valid record: {what}{older}.") from None
    check_invariants(record, where)
    return record


def check_invariants(record: Record, where: str) -> None:
    """Raise UserError where a record breaks an invariant of correct measurements.

    Args:
        record: The record.
        where: Name of the record in messages.
    """
    broken = next(_broken_invariants(record), None)
    if broken:
        raise UserError(f"{where} is no valid record: {broken}.")


def _broken_invariants(record: Record) -> Iterator[str]:
    """Yield a sentence for every invariant of correct measurements that the record breaks."""
    if record.identity.stored.get("predictions") != record.identity.predictions_hash:
        yield "the stored predictions are not those of its identity"
    for axis in ("x", "y", "z", "mean"):
        mae, rmse = record.value("mae_mm", axis), record.value("rmse_mm", axis)
        if mae is not None and rmse is not None and mae > rmse + _rounding(rmse):
            yield f"mae_mm {mae} of {axis} exceeds its rmse_mm {rmse}"
    for row in record.metrics:
        value = row.value
        if value is not None and row.metric in SHARES and not -ROUNDING <= value <= 1 + ROUNDING:
            yield f"{row.metric} of {row.group} is {value}, a share lies in 0..1"
        if row.clusters > row.n:
            yield f"{row.metric} of {row.group} has more presses than values"
        if value is not None and not _inside(value, row.low, row.high):
            yield f"the interval of {row.metric} of {row.group} does not hold its value"
    for speed in record.speed:
        if not 0 <= speed.p50_ms <= speed.p90_ms <= speed.p99_ms:
            yield f"the latency quantiles of phase {speed.phase!r} are out of order"


def _inside(value: float, low: float | None, high: float | None) -> bool:
    slack = _rounding(value)
    return (low is None or low - slack <= value) and (high is None or value <= high + slack)


def _rounding(value: float) -> float:
    """Return how far rounding may change a value, which grows with the value, such as 10^9 mm."""
    return ROUNDING * max(1.0, abs(value))
