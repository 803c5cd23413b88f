"""A model in a process of its own, the worker: it is handed frames and gives answers and times.

On hidden presses, and where a record is reproduced, no plugin that does not ship is imported by the
process that draws the presses and scores:

* its specs come from a worker, as JSON;
* its model is trained by the command ``run --train-only``, which has no hidden seed. What a model
  learns from is public;
* then a worker is sent the trained weights, and frame by frame the signal and its rest frame. It
  has an empty folder of its own, and of the environment what Python and its libraries need.

A message is a JSON object and named arrays, each as the bytes of an ``.npy`` file after their
number. Nothing is pickled. What a worker answers is checked as any answer is.
"""

from __future__ import annotations

import ctypes
import io
import json
import os
import shlex
import subprocess
import sys
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any, TypeVar

import numpy as np

from tactibench.contacts import Answer, Frame, Grid, Pose
from tactibench.errors import NotFiniteError, UserError, describe_exception
from tactibench.plugins import (
    Catalogue,
    EncoderSpec,
    Model,
    ModelContext,
    ModelSpec,
    Origin,
    Parameter,
    PluginHost,
    Problem,
    describe_failure,
    installed,
)
from tactibench.records import Arrays, pack, unpack

if TYPE_CHECKING:
    from tactibench.run.plan import RunPlan
    from tactibench.run.request import RunRequest
    from tactibench.run.timing import Speed

SpecT = TypeVar("SpecT", ModelSpec, EncoderSpec)

SHIPPED = "tactibench"
"""Distribution of the plugins that ship."""
SEED = "TACTIBENCH_HIDDEN_SEED"
ENVIRONMENT = (
    *("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT"),
    *("CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"),
)
"""Variables that a worker is given: places of libraries, processors and cards that may be used."""
TOGETHER = 50
"""Frames of a message: a message a frame would take a third of the time of a fast model."""
PATIENCE_S = 10.0
"""Seconds after which a worker that does not end by itself is ended."""


class WorkerError(UserError):
    """A model raised an exception in its worker, or its worker ended.

    Attributes:
        cause: Type and message of the exception on one line, as a record states failures.
    """

    def __init__(self, message: str, cause: str = "") -> None:
        super().__init__(message)
        self.cause = cause


class NotFiniteWorkerError(WorkerError, NotFiniteError):
    """A model answered NaN or infinity in its worker."""


class Worker:
    """A process that holds a model. It ends when this object is no longer used."""

    def __init__(self, runner: str | None) -> None:
        """Start the process.

        Args:
            runner: Command that starts it, see ``--runner``; None or "": this Python.

        Raises:
            UserError: The command cannot be started.
        """
        withhold_seed()
        command = shlex.split(runner or "") or [sys.executable, "-P", "-m", "tactibench.run.worker"]
        environment = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment)
        except OSError as error:
            raise UserError(
                f"--runner {runner!r} cannot be started ({error}); name a command that ends in "
                "`python -m tactibench.run.worker`."
            ) from None
        assert process.stdin is not None and process.stdout is not None  # noqa: S101, PT018 - pipes
        self._process, self._to, self._from = process, process.stdin, process.stdout
        weakref.finalize(self, _end, process)

    def ask(
        self, task: str, arrays: Mapping[str, Any] | None = None, **values: Any
    ) -> tuple[dict[str, Any], Arrays]:
        """Return values and arrays that the worker answers.

        Raises:
            WorkerError: The worker raised an exception, ended, or answered anything else.
        """
        try:
            write_message(self._to, {"task": task, **values}, arrays or {})
            told, given = read_message(self._from)
        except (OSError, ValueError, TypeError, KeyError, MemoryError):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1)
            raise WorkerError(
                f"the process in which the model answers ended (status {self._process.poll()}) or "
                "sent no answer; what it wrote stands above."
            ) from None
        if "error" in told:
            kind = WorkerError if told.get("finite", True) else NotFiniteWorkerError
            raise kind(str(told["error"]), str(told.get("cause", "")))
        return told, given


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let a worker end: it does when its pipe is closed."""
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):
            if stream is not None:
                stream.close()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def withhold_seed() -> None:
    """Overwrite the hidden seed where other processes of this user could read it.

    ``/proc/PID/environ`` shows the variables that a process was started with, also after they were
    removed. ``os.environ`` is a copy and stays.
    """
    if os.name == "posix":
        library = ctypes.CDLL(None)
        library.getenv.restype = ctypes.c_void_p
        place = library.getenv(SEED.encode())
        if place:
            ctypes.memset(place, ord("-"), len(ctypes.string_at(place)))


class WorkerModel(Model):
    """A trained model in a worker, which is started when it is first asked."""

    def __init__(self, plan: RunPlan) -> None:
        self._plan, self._weights = plan, Path()

    @cached_property
    def _worker(self) -> Worker:
        plan = self._plan
        model, encoder = plan.components.model, plan.components.encoder
        worker = Worker(plan.request.runner)
        files = [path for path in self._weights.rglob("*") if path.is_file()]
        worker.ask(
            "load",
            {p.relative_to(self._weights).as_posix(): np.fromfile(p, np.uint8) for p in files},
            model=model.name,
            values=dict(model.values),
            encoder=encoder and {"name": encoder.name, "values": dict(encoder.values)},
            context=asdict(replace(plan.context(encoder=False), checkpoints=None)),
        )
        return worker

    def fit(self, *_: Any, **__: Any) -> Any:
        """Refuse: a worker gets a model that was trained."""
        raise NotImplementedError

    save = predict = fit

    def load(self, directory: Path) -> None:
        """Name the folder of the weights that are sent to the worker."""
        self._weights = directory

    def answers(self, frames: Sequence[Frame]) -> Iterator[tuple[Answer | None, Any]]:
        """Yield the answer to each frame, with its first map, (1, H, W), or None.

        The worker answers one frame at a time; several travel in one message.
        """
        for start in range(0, len(frames), TOGETHER):
            some = frames[start : start + TOGETHER]
            _, arrays = self._worker.ask("answer", frame_arrays(some), count=len(some))
            maps = arrays.pop("maps", None)
            try:
                answers = unpack(arrays, self._plan.spec.answer)
                yield from zip(answers, [None] * len(some) if maps is None else maps, strict=True)
            except (ValueError, KeyError, TypeError, IndexError) as error:
                raise WorkerError(
                    f"the process in which the model answers sent no answer ({error})."
                ) from None

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any] | None:
        """Let the model adapt to labelled frames of the tested sensor."""
        arrays = {**frame_arrays(frames), **pack(truth, self._plan.spec.answer)}
        told, _ = self._worker.ask("adapt", arrays, count=len(frames))
        chosen: Mapping[str, Any] | None = told["chosen"]
        return chosen

    def time(self, frames: Sequence[Frame], *, quick: bool) -> Speed:
        """Return times and cost of the model, measured in the worker."""
        from tactibench.run.timing import Speed

        told, raw = self._worker.ask("time", frame_arrays(frames), count=len(frames), quick=quick)
        return Speed(told["rows"], raw, told["efficiency"])


class WorkerHost(PluginHost):
    """A host that imports the plugins that ship; the specs of the others a worker tells."""

    def __init__(self, runner: str | None) -> None:
        super().__init__([pair for pair in installed() if pair[1].distribution == SHIPPED])
        self._told = Worker(runner).ask("specs")[0]

    @cached_property
    def models(self) -> Catalogue[ModelSpec]:
        """Models of all plugins."""
        return self._with(super().models)

    @cached_property
    def encoders(self) -> Catalogue[EncoderSpec]:
        """Encoders of all plugins."""
        return self._with(super().encoders)

    def _with(self, own: Catalogue[SpecT]) -> Catalogue[SpecT]:
        """Return a catalogue with the specs of the other plugins; a shipped one keeps its name."""
        specs, origins = dict(own.specs), dict(own.origins)
        for entry in self._told[own.kind]:
            spec = _spec_of(own.kind, entry["spec"])
            if spec.name not in own.specs:
                specs[spec.name], origins[spec.name] = spec, Origin(**entry["origin"])
        told: list[Problem] = [
            Problem(Origin(**p.pop("origin")), **p) for p in self._told["problems"]
        ]
        return replace(own, specs=specs, origins=origins, problems=(*own.problems, *told))


def _spec_of(kind: str, values: Mapping[str, Any]) -> Any:
    """Return the spec of a model or encoder from JSON, whose lists were tuples."""
    fields: Any = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    parameters = [Parameter(**{**p, "choices": tuple(p["choices"])}) for p in values["parameters"]]
    if kind == "encoder":
        return EncoderSpec(**{**fields, "parameters": parameters})
    if values["refinable"]:  # such a spec adds the parameter by itself
        parameters.pop()
    if values["of_sites"] is not None:
        fields["of_sites"] = _spec_of(kind, values["of_sites"])
    return ModelSpec(**{**fields, "parameters": parameters})


def train_by_command(plan: RunPlan) -> dict[str, Any]:
    """Train the model of a plan in a process without the hidden seed.

    Returns:
        The manifest of the weights in the cache.

    Raises:
        UserError: The training failed.
    """
    withhold_seed()
    cache = plan.weights.folder.parents[1]
    environment = {name: value for name, value in os.environ.items() if name != SEED}
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tactibench", *training_words(plan.request, plan.device)],
        check=False,
        stdout=subprocess.DEVNULL,
        env={**environment, "TACTIBENCH_CACHE": str(cache.resolve())},
    )
    manifest = plan.weights.read()
    if done.returncode or manifest is None:
        raise UserError(
            f"the training of {plan.components.model.label} left no weights (exit code "
            f"{done.returncode}); what it said stands above."
        )
    return manifest


def training_words(request: RunRequest, device: str) -> list[str]:
    """Return the words of the command that trains what a request asks for."""
    given = {
        "regime": request.regime,
        "sensor": request.sensor,
        "encoder": request.encoder,
        "data": request.data,
        "presses": request.presses,
        "test": None if request.test.data is None else f"data={request.test.data}",
    }
    options = [f"--{name}={value}" for name, value in given.items() if value is not None]
    for kind, parameters in request.parameters.items():
        options += [f"--param={kind}.{name}={value}" for name, value in parameters.items()]
    if request.quick:
        options.append("--quick")
    own = [f"--model={request.model}", f"--seed={request.seed}", f"--device={device}"]
    return ["run", request.protocol, "--train-only", *own, *options]


# -- messages ----------------------------------------------------------------------------------


def write_message(stream: IO[bytes], values: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write values and named arrays."""
    text = json.dumps({**values, "arrays": list(arrays)}, default=_plain)
    for array in (np.frombuffer(text.encode(), np.uint8), *arrays.values()):
        content = io.BytesIO()
        np.lib.format.write_array(content, np.asarray(array), allow_pickle=False)
        stream.write(content.tell().to_bytes(8))
        stream.write(content.getbuffer())
    stream.flush()


def _plain(value: Any) -> Any:
    """Return a number of numpy, a mapping or a spec as JSON can hold it."""
    if isinstance(value, np.generic):
        return value.item()
    return dict(value) if isinstance(value, Mapping) else vars(value)


def read_message(stream: IO[bytes]) -> tuple[dict[str, Any], Arrays]:
    """Return values and named arrays.

    Raises:
        ValueError: The stream has ended, or holds something else.
    """
    values = json.loads(_read_array(stream).tobytes())
    return values, {name: _read_array(stream) for name in values.pop("arrays")}


def _read_array(stream: IO[bytes]) -> Any:
    content = io.BytesIO(stream.read(int.from_bytes(stream.read(8))))
    return np.lib.format.read_array(content, allow_pickle=False)


def frame_arrays(frames: Sequence[Frame]) -> Arrays:
    """Return the signals of frames, and their rest frames where they have one."""
    arrays: Arrays = {f"signal{row}": frame.signal for row, frame in enumerate(frames)}
    rests = {f"rest{row}": f.rest for row, f in enumerate(frames) if f.rest is not None}
    return {**arrays, **rests}


def _frames_of(arrays: Arrays, count: int) -> list[Frame]:
    return [
        Frame(arrays[f"signal{row}"], 0.0, Pose(), arrays.get(f"rest{row}")) for row in range(count)
    ]


# -- the worker itself -------------------------------------------------------------------------


class Tasks:
    """What a worker does for a run: a method for each task, from arrays and values to the same."""

    def __init__(self) -> None:
        self._model: Any = None
        self._rules: Any = None

    def specs(self, _: Arrays) -> tuple[dict[str, Any], Arrays]:
        """Return the specs of models and encoders of plugins that do not ship."""
        host = PluginHost()
        specs: dict[str, Any] = {
            catalogue.kind: [
                {"origin": catalogue.origins[spec.name], "spec": spec}
                for spec in catalogue
                if catalogue.origins[spec.name].distribution != SHIPPED
            ]
            for catalogue in (host.models, host.encoders)
        }
        return {**specs, "problems": host.problems}, {}

    def load(
        self,
        arrays: Arrays,
        model: str,
        values: dict[str, Any],
        encoder: dict[str, Any] | None,
        context: dict[str, Any],
    ) -> tuple[dict[str, Any], Arrays]:
        """Build the model and load its weights."""
        from tactibench.run.predict import AnswerRules

        folder, host = Path("weights").resolve(), PluginHost()
        for name, content in arrays.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            content.tofile(folder / name)
        cells = context["grid"]
        grid = Grid(tuple(cells["shape"]), tuple(cells["origin"]), cells["pitch"])
        built = encoder and host.encoders[encoder["name"]].build(**encoder["values"])
        kind, spec = context["answer"], host.models.for_answer(context["answer"])[model]
        made_for = ModelContext(**{**context, "grid": grid, "encoder": built})
        self._model = spec.build(made_for, **values)
        self._model.load(folder)
        self._rules = AnswerRules(kind, spec.max_contacts, grid.shape, depth=False)
        return {}, {}

    def answer(self, arrays: Arrays, count: int) -> tuple[dict[str, Any], Arrays]:
        """Return the answers to frames, and the first map of each."""
        from tactibench.run.predict import predict_frames

        frames = _frames_of(arrays, count)
        answers, maps = predict_frames(self._model, frames, self._rules, lambda _: None)
        shown = {} if maps is None else {"maps": maps[:, np.newaxis]}
        return {}, {**pack(answers, self._rules.kind), **shown}

    def adapt(self, arrays: Arrays, count: int) -> tuple[dict[str, Any], Arrays]:
        """Let the model adapt to labelled frames."""
        truth: Any = unpack(arrays, self._rules.kind)
        return {"chosen": self._model.adapt(_frames_of(arrays, count), truth)}, {}

    def time(self, arrays: Arrays, count: int, *, quick: bool) -> tuple[dict[str, Any], Arrays]:
        """Time the model."""
        from tactibench.run.timing import time_model

        speed = time_model(self._model, _frames_of(arrays, count), quick=quick)
        return {"rows": speed.rows, "efficiency": speed.efficiency}, speed.raw


def serve(source: IO[bytes], sink: IO[bytes]) -> None:
    """Do the tasks of a run until it closes the pipe."""
    from tactibench.run.machine import limited_threads
    from tactibench.run.predict import failure_cause

    tasks = Tasks()
    while True:
        try:
            values, arrays = read_message(source)
        except ValueError:
            return
        try:
            with limited_threads(1):  # as a run in one process does; ``time`` sets its own
                told, given = getattr(tasks, values.pop("task"))(arrays, **values)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin's
            own = str(error) if isinstance(error, UserError) else describe_failure(error)
            finite, cause = not isinstance(error, NotFiniteError), failure_cause(error)
            told, given = {"error": own or describe_exception(error), "cause": cause}, {}
            told |= {"finite": finite}
        write_message(sink, told, given)


def main() -> None:
    """Be a worker: answer on the standard output, in an empty folder."""
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a plugin prints is no answer
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    with TemporaryDirectory(prefix="tactibench-", ignore_cleanup_errors=True) as folder:
        os.chdir(folder)
        os.environ["HOME"] = folder
        with suppress(KeyboardInterrupt, BrokenPipeError):
            serve(source, sink)


if __name__ == "__main__":
    main()
