"""The model ``kernel``: frames -> displacements of the pins -> components -> kernel regression."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, FitReport, Frame, Model, ModelContext, Progress, UserError
from tactibench.training import (
    ANSWER_WIDTH,
    Normalisation,
    answer_vectors,
    load_weights,
    pack_image,
    regressable,
    save_weights,
    unpack_image,
)
from tactibench_pins.choose import MOST, START, Features, best
from tactibench_pins.components import Components
from tactibench_pins.correction import Correction
from tactibench_pins.eye import LATTICE, Sight, displacements, sight, sight_at
from tactibench_pins.presence import answers_of, least, went
from tactibench_pins.ridge import Setting, kernel, weights
from tactibench_pins.views import views

Array = npt.NDArray[np.float64]

_BATCH = 32
"""Frames that are tracked at once in ``predict``."""
_VIEWS = 64
_UNLIKE = 0.003
"""As in ``model``: where other sensors are read, frames are learned through views, with noise."""


class Kernel(Model):
    """Kernel ridge regression with reweighting towards the median; no contact where the pins
    hardly moved.

    Its setting is chosen on the validation frames; without such frames it is ``START``.
    """

    name = "kernel"

    def __init__(self, context: ModelContext) -> None:
        self.context = context
        count = ANSWER_WIDTH[context.answer]
        self._sight: Sight | None = None
        self._correction: Correction | None = None
        self._setting = START
        self._scale = Normalisation(np.zeros(count), np.ones(count))
        self._components = Components(np.zeros(1), np.zeros((1, 1)), np.ones(1))
        self._places, self._alpha = np.zeros((0, 1)), np.zeros((0, count))
        self._length = 1.0
        self._least = 0.0

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,  # noqa: ARG002 - there are no epochs
    ) -> FitReport:
        """Choose the setting, then fit. Raises UserError for frames it cannot learn from."""
        began = time.perf_counter()
        given = len(frames)
        frames, known = self._known(frames, truth)
        if len(frames) < 2:
            raise UserError(
                f"model {self.name!r} was given {len(frames)} training frames that it can learn "
                "from, but needs two; raise the training count."
            )
        self._sight = sight(frames, known, self.context.transfers)
        self._scale = Normalisation.of(known)
        moved = displacements(self._sight, frames, self.name)
        self._least = least(moved, self.context.answer)
        components = Components.fit(moved, min(MOST, len(frames) - 1))
        seen, wanted = self._known(*validation)
        held = displacements(self._sight, seen, self.name) if seen else moved[:0]
        if self.context.transfers:
            shown = views(LATTICE, _VIEWS, np.random.default_rng(0))  # the same for every seed
            moved, held = (_through(shown, one, rng) for one in (moved, held))
            components = Components.fit(moved, min(MOST, len(frames) - 1))
        learned = Features(components, moved, self._scale.apply(known))
        self._setting = best(learned, held, self._scale.apply(wanted)) if seen else START
        self._components = components.first(self._setting.components)
        self._places, self._length = learned.places(self._setting)
        self._alpha = weights(
            kernel(self._places, self._places, self._length), learned.targets, self._setting
        )
        notes = {"left_out": given - len(frames), **asdict(self._setting)}
        return FitReport(seconds=time.perf_counter() - began, notes=notes)

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any]:
        """Correct the answers by what labelled frames of another sensor lack (``Correction``).

        Frames that cannot be learned from are left out; without any the answers are the trained
        ones. Returns what was chosen, for the record.
        """
        self._correction = None
        frames, known = self._known(frames, truth)
        if not frames:
            return {"frames": 0}
        moved = displacements(self._sight, frames, self.name)
        lacking = self._scale.apply(known) - self._scale.apply(self._regress(moved))
        self._correction = Correction.fit(self._near(moved), lacking)
        return {"frames": len(frames), "ridge": list(self._correction.ridges)}

    def predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """One answer per frame, computed in float64."""
        found: list[Answer | None] = []
        for start in range(0, len(frames), _BATCH):
            value: Any = frames[start : start + _BATCH]
            for _, stage in self.stages():
                value = stage(value)
            found += value
        return found

    timed_as = "float64"

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """Pins, regression, answers."""
        return [
            ("preprocess", lambda frames: displacements(self._sight, frames, self.name)),
            ("forward", lambda moved: np.column_stack([self._regress(moved), went(moved)])),
            ("decode", lambda values: answers_of(values, self.context.answer, self._least)),
        ]

    def save(self, directory: Path) -> None:
        """Write all that ``predict`` needs into the folder. Raises UserError before a training."""
        if self._sight is None:
            raise UserError(f"model {self.name!r} has learned nothing yet; train it first.")
        arrays = {
            "places": self._places,
            "alpha": self._alpha,
            "mean": self._components.mean,
            "basis": self._components.basis,
            "spread": self._components.spread,
        }
        save_weights(
            directory,
            {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()},
            model=self.name,
            architecture=self._architecture,
            extra={
                "rest": pack_image(self._sight.still),
                "setting": asdict(self._setting),
                "scale": self._scale.plain(),
                "length": self._length,
                "least": self._least,
            },
        )

    def load(self, directory: Path) -> None:
        """Read weights. Raises UserError for those of another model or answer."""
        tensors, extra = load_weights(directory, model=self.name, architecture=self._architecture)
        arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
        self._sight = sight_at(unpack_image(extra["rest"]), self.context.transfers)
        self._setting = Setting(**extra["setting"])
        self._scale = Normalisation.of_plain(extra["scale"])
        self._components = Components(arrays["mean"], arrays["basis"], arrays["spread"])
        self._places, self._alpha = arrays["places"], arrays["alpha"]
        self._length = extra["length"]
        self._least = extra["least"]

    @property
    def _architecture(self) -> dict[str, Any]:
        """Weights of the common lattice are none of one sensor's pins."""
        shared = {"transfers": True} if self.context.transfers else {}
        return {"answer": self.context.answer, **shared}

    def parameter_count(self) -> int:
        """Return how many numbers a training leaves: places, their weights, the components."""
        kept = (self._places, self._alpha, self._components.mean, self._components.basis)
        return sum(array.size for array in kept)

    def flops(self, frame: Frame) -> int | None:  # noqa: ARG002 - the same for every frame
        """Of the two products and the distances; exponentials and the tracking are not counted."""
        return 2 * self._components.basis.size + 3 * self._places.size + 2 * self._alpha.size

    def _regress(self, moved: Array) -> Array:
        """(N, T) in mm and deg of displacements (N, 2 P)."""
        near = self._near(moved)
        found = near @ self._alpha
        if self._correction is not None:
            found = found + self._correction(near)
        return self._scale.invert(found)

    def _near(self, moved: Array) -> Array:
        """(N, M) how near frames are to each of the M training frames."""
        places = self._components.of(moved, self._setting.whitening)
        return kernel(places, self._places, self._length)

    def _known(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> tuple[list[Frame], Array]:
        rows = regressable(truth, self.context.answer, self.name)
        known = answer_vectors(truth, self.context.answer, self.name)[rows]
        return [frames[row] for row in rows], known


def _through(shown: Sequence[Array], moved: Array, rng: np.random.Generator) -> Array:
    """(N, 2 L) each frame as some sensor like the trained one would have seen it."""
    out = moved + _UNLIKE * rng.standard_normal(moved.shape)
    for number, chosen in enumerate(np.array_split(rng.permutation(len(moved)), len(shown))):
        out[chosen] = out[chosen] @ shown[number].T
    return out
