"""The schema of a run record and the invariants that every honest record keeps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, ValidationError

from tactibench.errors import UserError

SCHEMA = 1
SHARES = ("missed", "resolved", "catch_resolved", "coverage")
"""Metrics that are shares of something and lie in 0..1."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Metric(_Strict):
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


class SpeedRow(_Strict):
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


class ProtocolId(_Strict):
    id: str
    version: int
    hash: str
    title: str


class PartId(_Strict):
    name: str
    parameters: dict[str, bool | int | float | str]


class TestedId(PartId):
    """What pressed the test scenes, where it was not the sensor. asked: with ``--test``.

    on: in words, "finite-element scenes". presses: how many the test frames are of. trained_on: in
    words, where the model was trained on another sensor: "real recording 331/model_surface2d".
    """

    asked: list[str]
    on: str
    presses: NonNegativeInt
    trained_on: str | None = None


class SensorId(PartId):
    """account: by role, how many scenes the sensor made in which way, if in more than one."""

    origin: Literal["simulated", "real"]
    account: dict[str, dict[str, int]] = {}
    tested: TestedId | None = None


class Identity(BaseModel):
    """Hashes of what was made, beside all that it was made from. stored: of every array file."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    weights_hash: str
    predictions_hash: str
    stored: dict[str, str]


class Record(_Strict):
    """What ``record.json`` holds."""

    schema_: Literal[1] = Field(alias="schema")
    name: str
    created: str
    protocol: ProtocolId
    model: PartId
    regime: str
    encoder: PartId | None
    sensor: SensorId
    seed: int
    partial: bool
    limits: dict[str, bool | int | None]
    identity: Identity
    environment: dict[str, Any]
    metrics: list[Metric]
    speed: list[SpeedRow]
    timed: dict[str, Any]
    efficiency: dict[str, Any] = {}
    training: dict[str, Any]
    data: dict[str, Any]
    signature: str

    def value(self, metric: str, group: str) -> float | None:
        """A metric's value, None when it is n/a or not there."""
        return next((m.value for m in self.metrics if (m.metric, m.group) == (metric, group)), None)


def checked(record: dict[str, Any], where: str) -> Record:
    """Validate a record. Raises UserError for another schema, a wrong key or a broken invariant."""
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        found = record.get("schema") if isinstance(record, dict) else type(record).__name__
        raise UserError(
            f"{where} has record schema {found!r}, this tactibench reads schema {SCHEMA}; "
            "make the record again with this version."
        )
    try:
        valid = Record.model_validate(record)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{where} is no valid record: key {place!r}: {first['msg']}.") from None
    broken = next(_broken(valid), None)
    if broken:
        raise UserError(f"{where} is no valid record: {broken}.")
    return valid


def _broken(record: Record) -> Iterator[str]:
    """Sentences about what cannot be true of correct measurements."""
    slack = 1e-9
    if record.identity.stored.get("predictions") != record.identity.predictions_hash:
        yield "the stored predictions are not those of its identity"
    for axis in ("x", "y", "z", "mean"):
        mae, rmse = record.value("mae_mm", axis), record.value("rmse_mm", axis)
        if mae is not None and rmse is not None and mae > rmse + slack:
            yield f"mae_mm {mae} of {axis} exceeds its rmse_mm {rmse}"
    for row in record.metrics:
        value = row.value
        if value is not None and row.metric in SHARES and not -slack <= value <= 1 + slack:
            yield f"{row.metric} of {row.group} is {value}, a share lies in 0..1"
        if row.clusters > row.n:
            yield f"{row.metric} of {row.group} has more presses than values"
        if value is not None and not _inside(value, row.low, row.high, slack):
            yield f"the interval of {row.metric} of {row.group} does not hold its value"
    for speed in record.speed:
        if not 0 <= speed.p50_ms <= speed.p90_ms <= speed.p99_ms:
            yield f"the latency quantiles of phase {speed.phase!r} are out of order"


def _inside(value: float, low: float | None, high: float | None, slack: float) -> bool:
    return (low is None or low - slack <= value) and (high is None or value <= high + slack)
