"""Subjects: models, sensors and encoders under test, with the data that their checks share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, Grid, PlatePose, Scene
from tactibench.errors import PluginError, UserError, call_plugin
from tactibench.frames import spread
from tactibench.plugins import (
    IMAGE,
    Encoder,
    EncoderSpec,
    FitReport,
    Model,
    ModelContext,
    ModelSpec,
    Sensor,
    SensorContext,
    SensorSpec,
    Value,
)
from tactibench.protocols import Protocol, draw_scenes, load_protocol, pressable
from tactibench.run import NullProgress
from tactibench.testing.presses import (
    PROTOCOL,
    Examples,
    SensorPresses,
    changed_images,
    writable,
)
from tactibench.testing.runner import NotApplicable, require

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
        answer: Kind of its answers, "contacts" or "plate"; "" for contacts where it declares them.
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
        return self.answer or ("contacts" if "contacts" in self.spec.answers else "plate")

    def skip_without_images(self) -> None:
        """Raise NotApplicable where the frames of the model are channels."""
        if self.presses.sensor.signal != IMAGE:
            raise NotApplicable(f"{self.presses.name} gives no images")

    def briefly(self, answer: str = "") -> ModelSubject:
        """Return the same model with one epoch, if it has epochs, for another kind of answer.

        Args:
            answer: "contacts" or "plate"; "" for the same kind.
        """
        declared = {parameter.name for parameter in self.spec.parameters}
        values = {**self.values, "epochs": 1} if "epochs" in declared else self.values
        return replace(self, values=values, answer=answer or self.answer)

    def context(self, checkpoints: Path | None = None) -> ModelContext:
        """Return the context in which the model is built."""
        protocol = self.presses.protocol
        encoder = None
        if self.encoder is not None:
            spec, values = self.encoder
            encoder = spec.load()(**values)
        return ModelContext(
            answer=self.answer_kind,
            grid=protocol.grid.grid(),
            max_depth=protocol.workspace.depth_max_mm,
            encoder=encoder,
            checkpoints=checkpoints,
        )

    def build(self, values: Mapping[str, Value] | None = None) -> Model:
        """Return a new, untrained model, with other values of its parameters if they are given."""
        return self.spec.load()(self.context(), **(self.values if values is None else values))

    @cached_property
    def examples(self) -> Examples:
        """All frames: presses by one tip, or by a plate where answers are plate poses."""
        count = FIT + VALIDATION + TEST
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
            model = self.spec.load()(self.context(Path(folder)), **self.values)
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
        kind = PlatePose if plate else Contacts
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
        return self.spec.load()(context, **(self.values if values is None else values))

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
    grid: Grid = field(default_factory=lambda: Grid.centred(64, 0.4))
    noise_cells: float = 1.0

    def build(self, values: Mapping[str, Value]) -> Encoder:
        """Return an encoder with given values of its parameters."""
        return self.spec.load()(**values)

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

    def skip_unless_heat(self) -> None:
        """Raise NotApplicable for maps that are no heat."""
        if not self.is_heat:
            raise NotApplicable(f"its maps, of kind {self.spec.kind!r}, are no heat")

    def skip_unless_several(self) -> None:
        """Raise NotApplicable for an encoder of one contact."""
        if self.spec.max_contacts == 1:
            raise NotApplicable("it shows one contact only")


def difference(first: Sequence[Answer | None], second: Sequence[Answer | None]) -> float:
    """Return the largest difference between two lists of answers, in mm, deg and score.

    It is inf where two answers differ in kind or number of contacts.
    """
    worst = 0.0
    for answer, other in zip(first, second, strict=True):
        a, b = _numbers(answer), _numbers(other)
        if a.shape != b.shape:
            return float("inf")
        worst = max([worst, *np.abs(a - b).ravel().tolist()])
    return worst


def _numbers(answer: Answer | None) -> npt.NDArray[np.float64]:
    """Return an answer as numbers, without its std."""
    if answer is None:
        return np.empty(0)
    if isinstance(answer, PlatePose):
        return np.array([answer.depth, answer.tilt])
    return np.column_stack([answer.xy, answer.depth, answer.score])
