"""The models of one board timed together, from trained weights, apart from their training.

A run times its model after training it, while the machine may do other work. Here all models of a
protocol are timed in turns in one job on a quiet machine, so that their times can be compared, and
the new rows replace the old ones in their records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tactibench.board.submissions import FOLDER, add
from tactibench.contacts import Answer, Frame
from tactibench.errors import UserError
from tactibench.frames import spread
from tactibench.plugins import PluginHost, Stage
from tactibench.protocols import version_of
from tactibench.records import (
    PARTS,
    BoundSpec,
    Record,
    SpeedRow,
    StoredRun,
    Timed,
    unpack_contacts,
    unpack_plates,
    write_run,
)
from tactibench.run import (
    BATCHES,
    BUDGET_S,
    CALLS,
    HIDDEN,
    OFFLINE_CALLS,
    QUIET,
    ROUNDS,
    TIMED_FRAMES,
    Load,
    Reporter,
    RunPlan,
    RunRequest,
    Speed,
    TestFrames,
    all_threads,
    answers_of,
    blinded,
    compare,
    declared_stages,
    environment_facts,
    limited_threads,
    make_plan,
    offline_block,
    race_briefly,
    read_test_options,
    time_in_rounds,
    weights_folder,
)


@dataclass(frozen=True)
class TimedModel:
    """The model of a run, ready to be timed.

    Attributes:
        run: Run whose record takes the times.
        stages: Stages of the configuration that is timed.
        frames: Test frames, as a model may see them.
        timed: Description of the configuration and its cost in accuracy, as a record holds it.
    """

    run: StoredRun
    stages: Sequence[Stage]
    frames: Sequence[Frame]
    timed: Mapping[str, Any]


@dataclass
class Timekeeper:
    """Opens the models of runs; test frames that runs share are opened once.

    Attributes:
        host: The plugins.
        cache: Folder of frames and weights.
        reporter: Shows the progress.
        data: Folder of recorded frames.
    """

    host: PluginHost
    cache: Path
    reporter: Reporter
    data: Path | None = None
    _frames: dict[tuple[str, ...], TestFrames] = field(default_factory=dict)
    _fingerprint: str = field(default_factory=lambda: environment_facts()["fingerprint"])

    def open(self, run: StoredRun) -> TimedModel:
        """Return the model of a run with the weights that it was scored with.

        Raises:
            UserError: The run has no times to replace or is of another machine, or its weights are
                not in the cache or do not give its answers.
        """
        record = run.record
        _refuse_untimed(record)
        if record.environment.fingerprint != self._fingerprint:
            raise UserError(
                f"{record.name} is a run of another machine ({record.environment.fingerprint}, "
                f"this one is {self._fingerprint}); its times would not be those of its record."
            )
        plan = make_plan(request_of_record(record, self.host, self.data), self.host, self.cache)
        folder = weights_folder(self.cache, record.identity.weights_hash)
        if folder is None:
            raise UserError(
                f"the weights of {record.name} ({record.identity.weights_hash[:12]}) are not in "
                "the cache; run the protocol again, which trains and times them."
            )
        model = plan.components.build_model(plan.context())
        model.load(folder)
        test = self._test_frames(plan)
        rows = spread(range(test.main_frames), TIMED_FRAMES)
        frames = [blinded(test.frames[row]) for row in rows]
        truth = [test.truth[row] for row in rows]
        scored = _scored(run, plan.spec.answer, rows)
        configuration, stages = model.timed_as, declared_stages(model)
        raced: list[dict[str, Any]] = []
        if model.configurations:
            best, raced = race_briefly(model, frames, scored, truth, BUDGET_S)
            configuration, stages = best.description, list(best.stages)
        difference = compare(answers_of(stages, frames), scored, truth)
        if not difference.allowed:
            raise UserError(
                f"the weights of {record.name} do not answer as its record says; run the protocol "
                "again with --fresh."
            )
        timed = {"configuration": configuration, **difference.as_row(), "raced": raced}
        return TimedModel(run, stages, frames, timed)

    def _test_frames(self, plan: RunPlan) -> TestFrames:
        key = tuple(frame_set.key for frame_set in plan.frames.test)
        if key not in self._frames:
            self._frames[key] = TestFrames.open(plan, self.reporter)
        return self._frames[key]


def request_of_record(record: Record, host: PluginHost, data: Path | None) -> RunRequest:
    """Return the request that a run was made with, with all parameters of its record."""
    test, bound = record.test_sensor, {"model": BoundSpec.of_record(host.models, record.model)}
    bound["sensor"] = BoundSpec.of_record(host.sensors, record.sensor)
    if record.encoder is not None:
        bound["encoder"] = BoundSpec.of_record(host.encoders, record.encoder)
    options = () if test is None else tuple(test.options)
    return RunRequest(
        record.protocol.id,
        record.model.name,
        regime=record.regime,
        sensor=record.sensor.name,
        encoder=None if record.encoder is None else record.encoder.name,
        data=data,
        seed=record.seed,
        device=record.training.device or "cpu",
        parameters={
            kind: {name: str(value) for name, value in spec.values.items()}
            for kind, spec in bound.items()
        },
        presses=record.limits.presses,
        test=read_test_options(
            tuple(option for option in options if option != HIDDEN), hidden=HIDDEN in options
        ),
    )


def time_models(
    models: Sequence[TimedModel],
    reporter: Reporter,
    *,
    calls: int = CALLS,
    batches: Sequence[int] = BATCHES,
) -> dict[str, Speed]:
    """Time all models in turns: one frame a call with one thread and with all, and in batches.

    Args:
        models: Models of runs with different names.
        reporter: Shows the progress.
        calls: Number of calls of each model at batch 1.
        batches: Batch sizes of the scenario ``offline``.

    Returns:
        Times by the name of the run.
    """
    moment = datetime.now(UTC).isoformat(timespec="seconds")
    together = {"interleaved": len(models), "at": moment}
    speeds = {model.run.record.name: Speed(timed={**model.timed, **together}) for model in models}
    stages = {model.run.record.name: model.stages for model in models}
    frames = {model.run.record.name: model.frames for model in models}
    count, threads = len(models), sorted({1, all_threads()})
    with reporter.task("time", ROUNDS * (len(threads) + len(batches))) as advance:

        def measure(scenario: str, threads: int, calls: int, budget_s: float, **more: Any) -> None:
            with limited_threads(threads):
                samples = time_in_rounds(
                    stages,
                    frames,
                    threads=threads,
                    calls=max(calls, ROUNDS),
                    rounds=ROUNDS,
                    budget_s=budget_s * count,
                    advance=advance,
                    **more,
                )
            for name, sample in samples.items():
                speeds[name].add(scenario, sample)

        for number in threads:
            measure("single", number, calls, BUDGET_S)
        for batch in batches:
            block = offline_block(batch)
            more = {"batch": batch, "block": block}
            measure("offline", all_threads(), OFFLINE_CALLS, BUDGET_S / 6, **more)
    return speeds


def store_times(run: StoredRun, speed: Speed) -> StoredRun:
    """Return the run with new times in its record and beside it; all else stays as it is.

    Raises:
        UserError: An array of the run is damaged, or the record breaks an invariant.
    """
    parts = {name: run.arrays(name) for name in PARTS if name != "times"}
    rows = [SpeedRow.model_validate(row) for row in speed.rows]
    changes = {"speed": rows, "timed": Timed.model_validate(speed.timed)}
    record = run.record.model_copy(update=changes)
    return write_run(run.folder.parent, record, {**parts, "times": speed.raw})


def commit_times(run: StoredRun, board: Path) -> Path | None:
    """Write the record of a run over the committed one of the same name; None where there is none.

    Raises:
        UserError: As ``add``.
    """
    path = board / FOLDER / run.record.protocol.id / f"{run.record.name}.json"
    return add(run, board).path if path.is_file() else None


def refuse_noise(load: Load) -> None:
    """Raise UserError where other processes or machines use this machine, with their shares."""
    if load.quiet is False:
        stolen, foreign = (round(100 * (share or 0)) for share in (load.stolen, load.foreign))
        raise UserError(
            f"the machine is not quiet: other processes take {foreign} % of its processors and "
            f"other machines {stolen} % (at most {100 * QUIET:.0f} % together, load average "
            f"{load.average}); stop them, or add --anyway, and the times count as not settled."
        )


def _refuse_untimed(record: Record) -> None:
    """Raise UserError for a run whose model changes between frames or that has no times."""
    protocol = version_of(record.protocol.id, record.protocol.hash)
    if protocol is None:
        raise UserError(f"{record.name} is of an earlier version of its protocol; run it again.")
    if protocol.spec.families:
        raise UserError(f"{record.name} is of a protocol that times no model.")
    if protocol.spec.transfer is not None or record.shots:
        raise UserError(
            f"{record.name} times a model that was shown frames of the tested sensor; only the run "
            "itself can time it."
        )


def _scored(run: StoredRun, kind: str, rows: Sequence[int]) -> list[Answer | None]:
    unpack: Callable[[Mapping[str, Any]], Sequence[Answer | None]] = (
        unpack_plates if kind == "plate" else unpack_contacts
    )
    answers = unpack(run.arrays("predictions"))
    return [answers[row] for row in rows]
