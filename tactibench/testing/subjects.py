"""Models, sensors and encoders under test, and the check of their properties one by one."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from tactibench.contacts import (
    Answer,
    Contacts,
    Frame,
    Grid,
    Indenter,
    PlatePose,
    Pose,
    Scene,
    Sites,
)
from tactibench.errors import (
    PluginError,
    UserError,
    call_plugin,
    describe_exception,
    did_you_mean,
    printable,
)
from tactibench.frames import spread
from tactibench.geometry import plate_pose, true_contacts
from tactibench.plugins import (
    CHANNELS,
    Encoder,
    EncoderSpec,
    FitReport,
    Model,
    ModelContext,
    ModelSpec,
    Owners,
    Parameter,
    PluginHost,
    Sensor,
    SensorContext,
    SensorSpec,
    Value,
)
from tactibench.protocols import Protocol, draw_scenes, load_protocol, pressable
from tactibench.run import NullProgress

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
EXPECTED, UNEXPECTED = "failed as expected", "passed unexpectedly"
RAN = (PASSED, FAILED, EXPECTED, UNEXPECTED)


class Failed(AssertionError):  # noqa: N818 - the name of an outcome
    """A property does not hold; the message tells what was seen."""


class NotApplicable(Exception):  # noqa: N818 - the name of an outcome
    """A property does not apply to this subject; the message tells why."""


@dataclass(frozen=True)
class Property:
    """A behaviour that every plugin of a kind must have.

    Attributes:
        name: Short name, as in ``expected_failed_checks``.
        statement: The assertion in one line.
        check: Function of the subject that raises `Failed` or `NotApplicable`, or returns.
    """

    name: str
    statement: str
    check: Callable[[Any], None]

    @classmethod
    def from_function(cls, check: Callable[[Any], None]) -> Property:
        """Return the property of a function; its docstring's first paragraph is the statement."""
        first_paragraph = (check.__doc__ or "").strip().partition("\n\n")[0]
        return cls(check.__name__, " ".join(first_paragraph.split()).rstrip("."), check)


def properties_of(module: ModuleType) -> tuple[Property, ...]:
    """Return a property for every public function that a module defines, in the module's order."""
    return tuple(
        Property.from_function(value)
        for name, value in vars(module).items()
        if isinstance(value, FunctionType)
        and value.__module__ == module.__name__
        and not name.startswith("_")
    )


@dataclass(frozen=True)
class Finding:
    """The outcome of one property for one subject.

    Attributes:
        checked: The property.
        outcome: PASSED, FAILED, SKIPPED, EXPECTED or UNEXPECTED.
        message: On failure what was seen; otherwise why the property was skipped or expected to
            fail, or "".
        raised: Whether the plugin raised where it must not, so that further properties would tell
            nothing more.
    """

    checked: Property
    outcome: str
    message: str
    raised: bool = False

    @property
    def ok(self) -> bool:
        """True where the property holds, was skipped or failed as expected."""
        return self.outcome not in (FAILED, UNEXPECTED)

    def line(self) -> str:
        """Return outcome, name, statement and message on one line."""
        message = f" -- {self.message}" if self.message else ""
        text = f"{self.outcome:<19} {self.checked.name:<16} {self.checked.statement}{message}"
        return printable(text)


@dataclass(frozen=True)
class Report:
    """All findings about one subject.

    Attributes:
        title: Kind, name and plugin of the subject.
        findings: One for each property, in their order.
        unchecked: Number of properties that were left out because the plugin raised before.
    """

    title: str
    findings: tuple[Finding, ...]
    unchecked: int = 0

    def count(self, *outcomes: str) -> int:
        """Return the number of findings with one of the outcomes."""
        return sum(finding.outcome in outcomes for finding in self.findings)

    @property
    def ran(self) -> int:
        """Number of properties that were not skipped."""
        return self.count(*RAN)

    @property
    def ok(self) -> bool:
        """True where a property was checked, and all findings are ok."""
        return self.ran > 0 and all(finding.ok for finding in self.findings)

    def summary(self) -> str:
        """Return "20 ran: 18 passed, 1 failed, 1 failed as expected; 2 skipped" and the like."""
        counts = Counter(finding.outcome for finding in self.findings)
        always = (PASSED, FAILED)
        parts = [f"{counts[name]} {name}" for name in RAN if counts[name] or name in always]
        text = f"{self.ran} ran: {', '.join(parts)}; {counts[SKIPPED]} skipped"
        if self.unchecked:
            text = f"{text}; {self.unchecked} not checked, fix this first"
        return text if self.ran else f"{text}; nothing ran, which proves nothing"


def require(condition: object, message: str) -> None:
    """Raise `Failed` with the message unless the condition is true."""
    if not condition:
        raise Failed(message)


@contextmanager
def must_refuse(case: str) -> Iterator[None]:
    """Require that the block ends in a UserError with a message.

    Args:
        case: Words for the action of the block, with which the message of `Failed` begins.

    Raises:
        Failed: The block raises something else, or nothing.
    """
    try:
        yield
    except UserError as error:
        require(str(error).strip(), f"{case} was refused without a word")
        return
    except Exception as error:
        raise Failed(f"{case} raised {describe_exception(error)} instead of a UserError") from error
    raise Failed(f"{case} was taken without a word")


def examine(checked: Property, subject: Any, expected: str | None = None) -> Finding:
    """Check one property of a subject.

    Args:
        checked: The property.
        subject: Argument of its function.
        expected: Reason why the property is expected to fail; None where it is not.
    """
    outcome, message, raised = PASSED, "", False
    try:
        call_plugin(lambda: checked.check(subject))
    except PluginError as failure:
        error = failure.__cause__
        if isinstance(error, NotApplicable):
            return Finding(checked, SKIPPED, str(error))
        raised = not isinstance(error, Failed)
        outcome, message = FAILED, f"raised {failure}" if raised else str(error)
        cause = error if raised or error is None else error.__cause__
        place = None if cause is None else Owners().place_of_error(cause)
        message += "" if place is None else f" in {place}"
    if expected is not None and outcome == FAILED:
        outcome, message = EXPECTED, f"{expected} ({message})"
    elif expected is not None:
        outcome = UNEXPECTED
        message = f"it was expected to fail ({expected}), but holds: take it off the list"
    return Finding(checked, outcome, message, raised)


def run_checks(
    properties: Iterable[Property],
    subject: Any,
    expected_failed_checks: Mapping[str, str] | None = None,
    on_finding: Callable[[Finding], None] = lambda _: None,
) -> Report:
    """Check properties one by one, until the plugin raises where it must not.

    Further properties would fail or be skipped for the same cause.

    Args:
        properties: The properties to check.
        subject: Subject of all properties, with a ``title``.
        expected_failed_checks: Name of a property -> reason why it is expected to fail.
        on_finding: Function that is called with each finding.

    Raises:
        UserError: An expected failure names no property, or has no reason.
    """
    checked, expected = tuple(properties), dict(expected_failed_checks or {})
    check_names(checked, expected)
    findings = []
    for one_property in checked:
        findings.append(examine(one_property, subject, expected.get(one_property.name)))
        on_finding(findings[-1])
        if findings[-1].raised and not findings[-1].ok:
            break
    return Report(subject.title, tuple(findings), len(checked) - len(findings))


def check_names(properties: Iterable[Property], expected: Mapping[str, str]) -> None:
    """Raise UserError for an expected failure of an unknown property, or without a reason."""
    names = [one_property.name for one_property in properties]
    for name, reason in expected.items():
        if name not in names:
            raise UserError(
                f"expected_failed_checks names the property {name!r}, which is not among those "
                f"checked; {did_you_mean(name, names)}"
            )
        if not isinstance(reason, str) or not reason.strip():
            raise UserError(
                f"the property {name!r} is expected to fail without a reason; say why in words."
            )


PROTOCOL = "exp1"
"""Protocol whose workspace, grid, draws, default sensor and default encoder the checks use."""


@dataclass(frozen=True)
class Examples:
    """Frames of a sensor, and their truth.

    Attributes:
        frames: The frames as the sensor gives them.
        truth: True answer to every frame.
    """

    frames: tuple[Frame, ...]
    truth: tuple[Answer, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, rows: slice) -> Examples:
        return Examples(self.frames[rows], self.truth[rows])


def writable(frame: Frame) -> Frame:
    """Return a copy of a frame whose signals may be written to."""
    rest = None if frame.rest is None else frame.rest.copy()
    return replace(frame, signal=frame.signal.copy(), rest=rest)


def changed_images(before: Sequence[Frame], after: Sequence[Frame]) -> str:
    """Return words for the first images that differ between two lists of frames, "" for none."""
    for first, second in zip(before, after, strict=True):
        if first.signal.tobytes() != second.signal.tobytes():
            return "the image of a frame"
        rests = [frame.rest.tobytes() for frame in (first, second) if frame.rest is not None]
        if len(set(rests)) > 1:
            return "the rest image of a frame"
    return ""


@dataclass(frozen=True)
class SensorPresses:
    """Presses by one sensor.

    Attributes:
        protocol: The protocol whose presses are drawn, on the sensor's own surface.
        name: Name of the sensor.
        sensor: The sensor.
    """

    protocol: Protocol
    name: str
    sensor: Sensor

    @classmethod
    def by_name(cls, host: PluginHost, name: str = "") -> SensorPresses:
        """Return the presses of a sensor with its default parameters.

        Args:
            host: The plugins.
            name: Name of the sensor; "" for the protocol's default sensor.

        Raises:
            UserError: The sensor is unknown, or presses only recorded or reference scenes.
        """
        protocol = load_protocol(PROTOCOL).spec
        spec = host.sensors[name or protocol.defaults.sensor]
        if spec.needs_data or spec.reference_of:
            raise UserError(
                f"sensor {spec.name!r} presses only the scenes that it has, but the checks of a "
                f"model draw their own; take another, such as {protocol.defaults.sensor!r}."
            )
        sensor = spec.build(SensorContext(np.random.SeedSequence(1)), **spec.settings({}))
        return cls(pressable(protocol, sensor), spec.name, sensor)

    def singles(self, count: int) -> Examples:
        """Return presses of one spherical tip within the workspace."""
        draws = list(self.protocol.draws)
        draws[0] = draws[0].model_copy(update={"count": count})
        shortened = self.protocol.model_copy(update={"draws": tuple(draws)})
        scenes = draw_scenes(shortened, draws[0].name).scenes
        radius = self.protocol.workspace.dome_radius_mm
        truth = tuple(true_contacts(scene, radius) for scene in scenes)
        return Examples(self._press(scenes), truth)

    def plates(self, count: int) -> Examples:
        """Return presses of a plate that is tilted along x.

        Raises:
            UserError: The sensor cannot press a plate.
        """
        rng = np.random.default_rng(5)
        tilts, depths = rng.uniform(-15, 15, count), rng.uniform(1, 4, count)
        scenes = [
            Scene(Indenter.plate(), Pose(tilt=float(tilt), depth=float(depth)))
            for tilt, depth in zip(tilts, depths, strict=True)
        ]
        return Examples(self._press(scenes), tuple(map(plate_pose, scenes)))

    def _press(self, scenes: Iterable[Scene]) -> tuple[Frame, ...]:
        with self.sensor as opened:
            frames = tuple(opened.press_many(scenes))
        for frame in frames:
            frame.signal.setflags(write=False)  # as in frames that a run takes from its cache
        return frames


def touch_places(count: int) -> Examples:
    """Return trials of a drawn skin on which one place or several are touched at once."""
    rng = np.random.default_rng(7)
    fields, rest = rng.standard_normal((len(PLACES), 24)), rng.standard_normal(24)
    most = rng.integers(len(PLACES), size=count)
    touched = [np.roll(np.arange(len(PLACES)) <= n, row) for row, n in enumerate(most)]
    noise = 0.1 * rng.standard_normal((count, 24))
    signals = np.asarray(rest + touched @ fields + noise, dtype=np.float32)
    signals.setflags(write=False)
    at_rest = rest.astype(np.float32)
    frames = (
        Frame(signal, float(row), Pose(), at_rest, session=f"day {row % 2}")
        for row, signal in enumerate(signals)
    )
    return Examples(tuple(frames), tuple(Sites.truth(PLACES, some) for some in touched))


PLACES = ("thumb", "palm", "wrist", "knuckle")
"""Named places of the drawn skin."""
FIT, VALIDATION, TEST = 40, 10, 12
"""Frames that a model under test is trained on, validated on and tested on."""
SEED = 3
"""Seed of the trainings."""
PRESSES = 8
"""Presses of the check of a sensor."""
MOST_CONTACTS = 64
"""Most contacts that an encoder may read from any map, if it does not declare a number."""


@dataclass(frozen=True, eq=False)
class ModelSubject:
    """A model under test, and the frames that it is trained and tested on.

    Attributes:
        title: Kind, name and plugin.
        spec: The model.
        values: Values of its parameters.
        presses: Source of its frames.
        encoder: The encoder that it is trained through, with its parameters; None where it uses
            none.
        answer: Kind of its answers, "contacts", "plate" or "sites"; "" for contacts where it has
            them, otherwise its first kind.
    """

    title: str
    spec: ModelSpec
    values: Mapping[str, Value]
    presses: SensorPresses
    encoder: tuple[EncoderSpec, Mapping[str, Value]] | None = None
    answer: str = ""

    @property
    def answer_kind(self) -> str:
        """Kind of answer that the model must give."""
        answers = self.spec.answers
        return self.answer or ("contacts" if "contacts" in answers else answers[0])

    @property
    def signal(self) -> str:
        """Kind of signal of its frames."""
        return CHANNELS if self.answer_kind == "sites" else self.presses.sensor.signal

    def rest(self) -> Frame:
        """Return a frame of the undeformed sensor."""
        if self.answer_kind == "sites":
            frame = self.examples.frames[0]
            return frame if frame.rest is None else replace(frame, signal=frame.rest)
        with self.presses.sensor as opened:
            return opened.rest()

    def context(self, checkpoints: Path | None = None) -> ModelContext:
        """Return the context in which the model is built."""
        protocol = self.presses.protocol
        encoder = None
        if self.encoder is not None:
            spec, values = self.encoder
            encoder = spec.build(**values)
        return ModelContext(
            answer=self.answer_kind,
            grid=protocol.grid.grid(),
            max_depth=protocol.workspace.depth_max_mm,
            encoder=encoder,
            checkpoints=checkpoints,
        )

    def build(self, values: Mapping[str, Value] | None = None) -> Model:
        """Return a new, untrained model, with other values of its parameters if they are given."""
        return self.spec.build(self.context(), **(self.values if values is None else values))

    @cached_property
    def examples(self) -> Examples:
        """All frames: presses by one tip, by a plate, or trials of named places."""
        count = FIT + VALIDATION + TEST
        if self.answer_kind == "sites":
            return touch_places(count)
        if self.answer_kind == "contacts":
            return self.presses.singles(count)
        try:
            return self.presses.plates(count)
        except UserError as error:
            raise NotApplicable(f"{self.presses.name} presses no plate ({error})") from None

    @property
    def test_examples(self) -> Examples:
        """Frames that the model was not trained on."""
        return self.examples[-TEST:]

    def fit(self, model: Model, training: Examples | None = None, seed: int = SEED) -> FitReport:
        """Train a model and return its report.

        Args:
            model: The model.
            training: Training frames; None for those of all checks.
            seed: Seed of the training.
        """
        training = training or self.examples[:FIT]
        validation = self.examples[FIT : FIT + VALIDATION]
        return model.fit(
            list(training.frames),
            list(training.truth),
            validation=(list(validation.frames), list(validation.truth)),
            rng=np.random.default_rng(seed),
            progress=NullProgress(),
        )

    @cached_property
    def _training(self) -> tuple[Model, FitReport] | BaseException:
        """The trained model and its report, or the exception that the plugin raised."""
        _ = self.examples

        def train() -> tuple[Model, FitReport]:
            model = self.build()
            return model, self.fit(model)

        try:
            return call_plugin(train)
        except PluginError as error:  # the check `fit` reports it, the others refer to `fit`
            return error.__cause__ or error

    def report(self) -> FitReport:
        """Return the report of the training.

        Raises:
            BaseException: The exception that the training raised.
        """
        if isinstance(self._training, BaseException):
            raise self._training
        return self._training[1]

    def trained(self) -> Model:
        """Return the trained model.

        Raises:
            NotApplicable: The training failed, see ``fit``.
        """
        if isinstance(self._training, BaseException):
            raise NotApplicable("the model does not train, see fit")
        return self._training[0]

    @cached_property
    def trained_again(self) -> tuple[Model, str]:
        """Another model, trained in the same way on writable copies, and words for changed images.

        It may store checkpoints, as in a run, while the first model may not.
        """
        _ = self.trained()
        training = self.examples[:FIT]
        copies = Examples(tuple(map(writable, training.frames)), training.truth)
        with TemporaryDirectory() as folder:
            model = self.spec.build(self.context(Path(folder)), **self.values)
            self.fit(model, copies)
        return model, changed_images(training.frames, copies.frames)

    @cached_property
    def answers(self) -> list[Answer | None]:
        """Answers of the trained model to all test frames at once."""
        return self.predict(self.trained(), self.test_examples.frames)

    def predict(self, model: Model, frames: Sequence[Frame]) -> list[Answer | None]:
        """Return the answers of a model to frames.

        Raises:
            Failed: There is not one allowed answer for every frame.
        """
        return self.check_answers(model.predict(list(frames)), len(frames))

    def check_answers(self, given: Sequence[Answer | None], count: int) -> list[Answer | None]:
        """Return answers after a check that there is one allowed answer for every frame.

        Args:
            given: Answers of a model.
            count: Number of frames.

        Raises:
            Failed: The number of answers is wrong, or an answer is of another kind, has too many
                contacts or is not finite.
        """
        answers, most = list(given), self.spec.max_contacts
        require(len(answers) == count, f"{len(answers)} answers to {count} frames")
        plate = self.answer_kind == "plate"
        kinds: dict[str, type] = {"plate": PlatePose, "sites": Sites, "contacts": Contacts}
        kind = kinds[self.answer_kind]
        for number, answer in enumerate(answers, 1):
            if answer is None and plate:
                continue
            require(
                isinstance(answer, kind),
                f"answer {number} is of type {type(answer).__name__}, expected {kind.__name__}",
            )
            if isinstance(answer, Contacts):
                require(
                    most is None or len(answer) <= most,
                    f"answer {number} holds {len(answer)} contacts, but max_contacts is {most}",
                )
            elif isinstance(answer, PlatePose):
                finite = np.isfinite([answer.depth, answer.tilt, *(answer.std or ())]).all()
                require(finite, f"answer {number} is not finite: {answer}")
            elif isinstance(answer, Sites):
                right = answer.names == PLACES
                require(right, f"answer {number} names {answer.names}, but it learned {PLACES}")
        return answers


@dataclass(frozen=True, eq=False)
class SensorSubject:
    """A sensor under test, and the scenes that it presses.

    Attributes:
        title: Kind, name and plugin.
        spec: The sensor.
        values: Values of its parameters.
        data: Folder of its recorded frames; None where it needs none.
    """

    title: str
    spec: SensorSpec
    values: Mapping[str, Value]
    data: Path | None = None

    def build(self, values: Mapping[str, Value] | None = None, seed: int = 0) -> Sensor:
        """Return a sensor that is not opened.

        Args:
            values: Values of its parameters; None for those of the subject.
            seed: Seed of the sensor.
        """
        context = SensorContext(np.random.SeedSequence(seed), self.data)
        return self.spec.build(context, **(self.values if values is None else values))

    @cached_property
    def unopened(self) -> Sensor:
        """A sensor that is only described, never pressed."""
        return self.build()

    @property
    def has_own_scenes(self) -> bool:
        """True for a sensor that presses only the scenes that it has."""
        return self.unopened.scenes() is not None

    @cached_property
    def protocol(self) -> Protocol:
        """The protocol whose presses are drawn, on the sensor's own surface."""
        return pressable(load_protocol(PROTOCOL).spec, self.unopened)

    @cached_property
    def scenes(self) -> tuple[Scene, ...]:
        """A few scenes of the protocol, or of the sensor where it has its own."""
        own_scenes = self.unopened.scenes()
        if own_scenes is not None:
            return spread(list(own_scenes.values()), PRESSES)
        return draw_scenes(self.protocol, self.protocol.draws[0].name).scenes[:PRESSES]

    def press(self, *scenes: Scene, seed: int = 0) -> list[Frame]:
        """Return the frames of a new sensor that presses one scene after the other."""
        with self.build(seed=seed) as opened:
            return [opened.press(scene) for scene in scenes]

    def skip_unless_any_scene(self) -> None:
        """Raise NotApplicable for a sensor that presses only its own scenes."""
        if self.has_own_scenes:
            raise NotApplicable("it presses only the scenes that it has")

    def skip_unless_repeatable(self) -> None:
        """Raise NotApplicable where a seed cannot determine the frames."""
        if self.spec.origin == "real" and not self.has_own_scenes:
            raise NotApplicable("no seed determines the noise of a real sensor")


@dataclass(frozen=True, eq=False)
class EncoderSubject:
    """An encoder under test.

    Attributes:
        title: Kind, name and plugin.
        spec: The encoder.
        values: Values of its parameters.
        grid: Cells of the maps.
        noise_cells: Largest rms error of position, in cells, of contacts 2 to 6 mm deep on maps
            with white noise of 0.02.
    """

    title: str
    spec: EncoderSpec
    values: Mapping[str, Value]
    grid: Grid
    noise_cells: float = 1.0

    def build(self, values: Mapping[str, Value]) -> Encoder:
        """Return an encoder with given values of its parameters."""
        return self.spec.build(**values)

    @cached_property
    def encoder(self) -> Encoder:
        """The encoder with the parameters of the subject."""
        return self.build(self.values)

    @property
    def is_heat(self) -> bool:
        """True for maps that are heat, which is 0 without contact and at most 1."""
        return self.spec.kind == "heat"

    @property
    def most_contacts(self) -> int:
        """Most contacts that it may read from any map."""
        return self.spec.max_contacts or int(self.values.get("max_count", MOST_CONTACTS))

    def encode(self, contacts: Sequence[Contacts]) -> npt.NDArray[np.float32]:
        """Return (N, C, H, W) maps, encoded one by one."""
        return np.stack([self.encoder.encode(item, self.grid) for item in contacts])

    def decode(self, maps: npt.NDArray[Any]) -> list[Contacts]:
        """Return the contacts of (N, C, H, W) maps."""
        return self.encoder.decode_batch(maps, self.grid)

    def skip_unless_several(self) -> None:
        """Raise NotApplicable for an encoder of one contact."""
        if self.spec.max_contacts == 1:
            raise NotApplicable("it shows one contact only")


def as_json(value: object, what: str) -> str:
    """Return a value as JSON; numbers of numpy are numbers.

    Args:
        value: The value.
        what: Words for it, with which the message of `Failed` begins.

    Raises:
        Failed: The value cannot be written as JSON.
    """
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise Failed(f"{what} cannot be written as JSON: {error}") from error


def difference(first: Sequence[Answer | None], second: Sequence[Answer | None]) -> float:
    """Return the largest difference between two lists of answers, in mm, deg and score.

    Contacts of a frame are matched, in whatever order they are given. It is inf where two answers
    differ in kind or number of contacts.
    """
    worst = 0.0
    for answer, other in zip(first, second, strict=True):
        a, b = _numbers(answer), _numbers(other)
        if a.shape != b.shape:
            return float("inf")
        apart = np.abs(a[:, None] - b).max(axis=2, initial=0.0)
        worst = max([worst, *apart[linear_sum_assignment(apart)].tolist()])
    return worst


def _numbers(answer: Answer | None) -> npt.NDArray[np.float64]:
    """Return an answer as rows of numbers, without its std: a row a contact, or one of a plate."""
    if answer is None:
        return np.empty((0, 0))
    if isinstance(answer, PlatePose):
        return np.array([[answer.depth, answer.tilt]])
    if isinstance(answer, Sites):
        return np.array([(*answer.probability, *answer.touched)])
    return np.column_stack([answer.xy, answer.depth, answer.score])


Build = Callable[[Mapping[str, Value]], Any]


def check_parameters(spec: Any, values: Mapping[str, Value], build: Build) -> None:
    """Check that every allowed value at the edge of what is allowed builds, or is refused.

    Args:
        spec: The spec whose parameters are checked.
        values: Values of all parameters; one at a time is changed.
        build: Function that builds the target from the values of all parameters.

    Raises:
        Failed: An allowed value raises something else than a UserError.
    """
    for parameter in spec.parameters:
        for value in _edge_values(parameter):
            try:
                build({**values, parameter.name: value})
            except UserError:
                continue
            except Exception as error:
                raise Failed(
                    f"{parameter.name}={value!r} is allowed, but building with it raised "
                    f"{describe_exception(error)}; narrow its bounds or refuse it with a UserError"
                ) from error


def _edge_values(parameter: Parameter) -> Iterator[Value]:
    """Yield allowed values that an author may have forgotten."""
    if parameter.choices:
        yield from parameter.choices
        return
    default = parameter.default
    if isinstance(default, bool):
        yield not default
    elif isinstance(default, str):
        yield "no such value"
    else:
        kind, is_integer = type(default), isinstance(default, int)
        low, high = parameter.low, parameter.high
        yield kind(-1) if low is None else kind(ceil(low) if is_integer else low)
        if low is None or low < 0:
            yield kind(0)
        if high is not None:
            yield kind(floor(high) if is_integer else high)
