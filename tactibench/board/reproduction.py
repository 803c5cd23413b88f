"""A committed record reproduced: its run is made again from its request, and the metrics compared.

The request of a record is its protocol, model, parameters, regime, sensor, encoder and seed. The
plugins that are installed carry it out. Frames, weights and answers are made anew, unless a cache
is named.

Tolerances. A model that draws nothing when it is trained gives the same metric to ``EXACT``.
Another training, on another machine or with another version of a library, ends elsewhere; its
metric must lie in the interval of the record, widened by ``SLACK``. A row is reproduced where the
error that orders its board and its misses are; the other metrics are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tactibench.board.rows import draws_nothing
from tactibench.board.submissions import read_submission, refuse_names
from tactibench.board.verification import headline, options_of_test
from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.protocols import load_protocol, recorded_version
from tactibench.records import BoundSpec, Metric, Record, Reproduction, write_record
from tactibench.run import (
    Reporter,
    RunPlan,
    RunRequest,
    environment_facts,
    execute,
    folder_label,
    make_plan,
)

EXACT = 1e-3
"""Largest difference of a metric of a model that draws nothing: a share of its value, or in its
unit. Frames differ in single pixels between processors."""
SLACK = 5e-3
"""By how much, in its unit, another training may leave the interval: one without a width, such as
that of no miss in 1,000 presses, would allow no difference at all."""


@dataclass(frozen=True)
class ReproducedMetric:
    """A metric of a record beside that of the run made again.

    Attributes:
        stated: Row of the record.
        value: Value of the run made again; None for n/a.
        low: Smallest value that reproduces the record; None: only n/a does.
        high: Largest value that does.
        decides: Whether the row stands or falls with it.
    """

    stated: Metric
    value: float | None
    low: float | None
    high: float | None
    decides: bool

    @property
    def within(self) -> bool:
        """Return whether the value reproduces that of the record."""
        if self.value is None or self.low is None or self.high is None:
            return self.value is None and self.low is None
        return self.low <= self.value <= self.high


@dataclass(frozen=True)
class ReproducedRun:
    """A record and the run made again from its request.

    Attributes:
        path: File of the record.
        record: The record.
        again: The record of the run made again.
        metrics: Metrics of both.
    """

    path: Path
    record: Record
    again: Record
    metrics: tuple[ReproducedMetric, ...]

    @property
    def reproduced(self) -> bool:
        """Return whether every metric that decides is within its tolerance."""
        return all(metric.within for metric in self.metrics if metric.decides)

    @property
    def same_frames(self) -> bool:
        """Return whether the test frames are the same to the last pixel."""
        return self.record.identity.data == self.again.identity.data


def reproduce(
    path: Path,
    host: PluginHost,
    reporter: Reporter,
    *,
    data: Path | None = None,
    cache: Path | None = None,
    runner: str = "",
) -> ReproducedRun:
    """Make the run of a committed record again and compare its metrics.

    Args:
        path: File of the record.
        host: The plugins, such as those of ``WorkerHost``.
        reporter: Shows the work.
        data: Folder of the recording that the run read, or a folder above its recordings.
        cache: Folder of frames, weights and answers that may be used; None: all are made anew.
        runner: Command that starts the process in which the model answers; "": this Python.

    Raises:
        UserError: The record is invalid, or its run cannot be made with what is installed here.
    """
    record = read_submission(path)
    refuse_names(record, str(path))
    recorded_version(record.protocol.label, record.protocol.hash, str(path))
    request = replace(request_of_record(record, host, data), runner=runner)
    with TemporaryDirectory(prefix="tactibench-") as folder:
        place = Path(folder)
        cache, seed = cache or place / "cache", record.identity.hidden
        plan = make_plan(request, host, cache, store=place / "runs", hidden_hash=seed)
        _refuse_another_recording(record, plan)
        again = execute(plan, reporter, timed=False).record
    return ReproducedRun(path, record, again, tuple(_compare(record, again)))


def request_of_record(record: Record, host: PluginHost, data: Path | None) -> RunRequest:
    """Return the request that a run was made with, with all parameters of its record.

    Args:
        record: Record of a run.
        host: The plugins.
        data: Folder of the recording that the run read, or a folder above its recordings.

    Raises:
        UserError: The protocol or a plugin is not installed or does not have a value of the
            record, or the recording is not given.
    """
    models = host.models.for_answer(load_protocol(record.protocol.id).spec.answer)
    bound = {
        "model": BoundSpec.of_record(models, record.model),
        "sensor": BoundSpec.of_record(host.sensors, record.sensor),
    }
    test = options_of_test(record)
    if test.data is not None:
        test = replace(test, data=_folder(record, str(test.data), data))
    if record.encoder is not None:
        bound["encoder"] = BoundSpec.of_record(host.encoders, record.encoder)
    return RunRequest(
        record.protocol.id,
        record.model.name,
        regime=record.regime,
        sensor=record.sensor.name,
        encoder=None if record.encoder is None else record.encoder.name,
        data=_recording(record, data) if bound["sensor"].spec.needs_data else None,
        seed=record.seed,
        parameters={
            kind: {name: str(value) for name, value in spec.values.items()}
            for kind, spec in bound.items()
        },
        presses=record.limits.presses,
        test=test,
    )


def _recording(record: Record, data: Path | None) -> Path:
    """Return the folder of the recording that trained."""
    test, recording = record.test_sensor, record.sensor.recording
    if test is not None and test.trained_on is not None:
        return _folder(record, test.trained_on.removeprefix("real recording "), data)
    return _folder(record, "" if recording is None else recording.label, data)


def _folder(record: Record, label: str, data: Path | None) -> Path:
    """Return the one folder with a label: a folder of recordings, or one in it.

    Raises:
        UserError: No folder is given, or several folders inside it have the label.
    """
    if data is None:
        raise UserError(
            f"{record.name} read a recording; name its folder, or one above it, with --data DIR."
        )
    inside = (data, *sorted(data.glob("*/")), *sorted(data.glob("*/*/")))
    found = [f for f in inside if f"/{folder_label(f)}".endswith(f"/{label}")]
    if len(found) > 1:
        names = " or ".join(map(str, found))
        raise UserError(f"{data} holds several recordings {label!r}; name one: --data {names}.")
    return found[0] if found else data


def _refuse_another_recording(record: Record, plan: RunPlan) -> None:
    recording, here = record.sensor.recording, plan.frames.sensor_identity["describe"]
    if recording is not None and here.get("sha256") != recording.sha256:
        raise UserError(
            f"{plan.request.data} is not the recording that {record.name} read, whose sha256 "
            f"begins with {recording.sha256[:8]}; name its folder with --data DIR."
        )


def _compare(record: Record, again: Record) -> Iterator[ReproducedMetric]:
    """Yield the metrics of a record beside those of the run made again."""
    exact, deciding = draws_nothing(record), headline(record)
    for row in record.metrics:
        low = high = row.value
        if row.value is not None:
            ends = (row.value, *((row.low, row.high) if not exact else ()))
            known = [end for end in ends if end is not None]
            wide = max(EXACT, EXACT * abs(row.value)) if exact else SLACK
            low, high = min(known) - wide, max(known) + wide
        value = again.value(row.metric, row.group)
        yield ReproducedMetric(row, value, low, high, (row.metric, row.group) in deciding)


def note_reproduction(run: ReproducedRun, by: str) -> Reproduction:
    """Write into a record that its run was reproduced on this machine, and return the note.

    Args:
        run: The run, made again.
        by: Who reproduced it.

    Raises:
        UserError: The run was not reproduced.
    """
    if not run.reproduced:
        raise UserError(f"{run.path} was not reproduced, so that nothing is noted in it.")
    facts = environment_facts()
    machine = f"{facts['cpu'] or 'unknown'} ({facts['fingerprint']})"
    note = Reproduction(by=by, machine=machine, date=datetime.now(UTC).date().isoformat())
    write_record(run.path, run.record.model_copy(update={"reproduced": note}))
    return note


def reproduction_rows(run: ReproducedRun) -> Iterator[dict[str, Any]]:
    """Yield a tidy row for every metric of a record and of the run made again."""
    for metric in run.metrics:
        yield {
            "file": run.path.name,
            "metric": metric.stated.metric,
            "group": metric.stated.group,
            "unit": metric.stated.unit,
            "record": metric.stated.value,
            "reproduced": metric.value,
            "low": metric.low,
            "high": metric.high,
            "within": metric.within,
            "decides": metric.decides,
        }
