"""A model under test: how it is built, what it is shown, and what it answered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame, PlatePose
from tactibench.errors import UserError, describe_exception
from tactibench.plugins.base import Encoder, FitReport, Model, ModelContext
from tactibench.plugins.specs import EncoderSpec, ModelSpec, Value
from tactibench.run.reporter import SilentProgress
from tactibench.testing.pressed import Examples, Presser, changes, writable
from tactibench.testing.property import Failed, NotApplicable, require

FIT, VALIDATION, SEEN = 40, 10, 12
"""Frames that the model under test is trained on, validated on and asked about."""
SEED = 3


@dataclass(frozen=True, eq=False)
class ModelSubject:
    """spec, values: the model and its parameters. presser: where its frames are from.

    encoder: what it is trained through, with its parameters; None where it uses none.
    answer: "contacts" or "plate", what it is asked for; "" is the first that it declares.
    """

    title: str
    spec: ModelSpec
    values: Mapping[str, Value]
    presser: Presser
    encoder: tuple[EncoderSpec, Mapping[str, Value]] | None = None
    answer: str = ""

    @property
    def asked(self) -> str:
        """What the model is asked for."""
        return self.answer or ("contacts" if "contacts" in self.spec.answers else "plate")

    def briefly(self, answer: str = "") -> ModelSubject:
        """The same model, trained for one epoch, if it has epochs. answer: another one to ask."""
        known = {parameter.name for parameter in self.spec.parameters}
        values = {**self.values, "epochs": 1} if "epochs" in known else self.values
        return replace(self, values=values, answer=answer or self.answer)

    def context(self, checkpoints: Path | None = None) -> ModelContext:
        keys = self.presser.keys
        return ModelContext(
            answer=self.asked,
            grid=keys.grid.grid(),
            max_depth=keys.workspace.depth_max_mm,
            encoder=self._built_encoder(),
            checkpoints=checkpoints,
        )

    def build(self, values: Mapping[str, Value] | None = None) -> Model:
        """A new, untrained model. values: of all parameters; None: those of the subject."""
        return self.spec.load()(self.context(), **(self.values if values is None else values))

    @cached_property
    def examples(self) -> Examples:
        """All frames: presses of one tip, or of a plate where plate poses are asked for."""
        count = FIT + VALIDATION + SEEN
        if self.asked == "contacts":
            return self.presser.singles(count)
        try:
            return self.presser.plates(count)
        except UserError as error:
            raise NotApplicable(f"{self.presser.name} presses no plate ({error})") from None

    @property
    def seen(self) -> Examples:
        """The frames that the model is asked about; it was not trained on them."""
        return self.examples[-SEEN:]

    def fit(self, model: Model, training: Examples | None = None) -> FitReport:
        """Train a model with the seed of all checks. training: other frames than the subject's."""
        frames = self.examples[:FIT] if training is None else training
        held_out = self.examples[FIT : FIT + VALIDATION]
        return model.fit(
            list(frames.frames),
            list(frames.truth),
            validation=(list(held_out.frames), list(held_out.truth)),
            rng=np.random.default_rng(SEED),
            progress=SilentProgress(),
        )

    @cached_property
    def _trained(self) -> tuple[Model, FitReport] | str:
        """The model and its report, or what went wrong."""
        _ = self.examples
        try:
            model = self.build()
            return model, self.fit(model)
        except Exception as error:  # noqa: BLE001 - `fit` reports it, the others point there
            return describe_exception(error)

    def report(self) -> FitReport:
        """What training told. Raises Failed when it did not end."""
        if isinstance(self._trained, str):
            raise Failed(f"training on {FIT} frames raised {self._trained}")
        return self._trained[1]

    def trained(self) -> Model:
        """The trained model. Raises NotApplicable when training failed, which ``fit`` reports."""
        if isinstance(self._trained, str):
            raise NotApplicable("the model does not train, see fit")
        return self._trained[0]

    @cached_property
    def again(self) -> tuple[Model, str]:
        """Another model, trained alike on copies that may be written to; what it changed, or "".

        This one may keep checkpoints, as in a run; the first may not.
        Raises NotApplicable where ``trained`` does.
        """
        _ = self.trained()
        training = self.examples[:FIT]
        own = Examples(tuple(map(writable, training.frames)), training.truth)
        with TemporaryDirectory() as folder:
            model = self.spec.load()(self.context(Path(folder)), **self.values)
            self.fit(model, own)
        return model, changes(training, own)

    @cached_property
    def answers(self) -> list[Answer | None]:
        """Of the trained model to the seen frames, all at once, as a run sees them."""
        return self.ask(self.trained(), self.seen.frames)

    def ask(self, model: Model, frames: Sequence[Frame]) -> list[Answer | None]:
        """Answers, checked for their number and kind. Raises Failed."""
        found = model.predict(list(frames))
        return checked(found, len(frames), self.asked, self.spec.max_contacts)

    def _built_encoder(self) -> Encoder | None:
        if self.encoder is None:
            return None
        spec, values = self.encoder
        return spec.load()(**values)


def checked(
    found: Sequence[Answer | None], count: int, answer: str, most: int | None
) -> list[Answer | None]:
    """One allowed answer a frame. Raises Failed."""
    answers = list(found)
    require(len(answers) == count, f"{len(answers)} answers to {count} frames")
    wanted = PlatePose if answer == "plate" else Contacts
    for number, one in enumerate(answers, 1):
        if one is None and answer == "plate":
            continue
        require(
            isinstance(one, wanted),
            f"answer {number} is of type {type(one).__name__}, expected {wanted.__name__}",
        )
        if isinstance(one, Contacts):
            require(
                most is None or len(one) <= most,
                f"answer {number} holds {len(one)} contacts, but max_contacts is {most}",
            )
        elif isinstance(one, PlatePose):
            require(
                np.isfinite([one.depth, one.tilt, *(one.std or ())]).all(),
                f"answer {number} is not finite: {one}",
            )
    return answers


def difference(first: Sequence[Answer | None], second: Sequence[Answer | None]) -> float:
    """Largest difference of a number in two lists of answers; inf where their shapes differ."""
    worst = 0.0
    for one, other in zip(first, second, strict=True):
        a, b = _numbers(one), _numbers(other)
        if a.shape != b.shape:
            return float("inf")
        worst = max([worst, *np.abs(a - b).ravel().tolist()])
    return worst


def _numbers(answer: Answer | None) -> npt.NDArray[np.float64]:
    """An answer as numbers, its std left out."""
    if answer is None:
        return np.empty(0)
    if isinstance(answer, PlatePose):
        return np.array([answer.depth, answer.tilt])
    return np.column_stack([answer.xy, answer.depth, answer.score])
