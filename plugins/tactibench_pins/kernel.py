"""The model ``kernel``: frames -> displacements of the pins -> components -> kernel regression.

Kernel regression of the median: a radial kernel, ridge, and weights that forgive outliers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from tactibench import Answer, FitReport, Frame, Model, ModelContext, Progress, UserError
from tactibench.training import (
    ANSWER_WIDTH,
    Normalisation,
    load_weights,
    regression_rows,
    save_weights,
)
from tactibench_pins.displacements import (
    LATTICE,
    Components,
    Correction,
    Differences,
    Reader,
    contact_threshold,
    displacements,
    find_reader,
    known_targets,
    read_answers,
    restored_reader,
    rms_displacement,
)

Array = npt.NDArray[np.float64]

_SMALLEST = 0.02
"""Residuals below this share of a target's deviation have equal weights."""


@dataclass(frozen=True)
class Setting:
    """Choices of a kernel regression.

    Attributes:
        components: Number of components of the displacements.
        whitening: Power of the components' spreads, see ``Components.weights``.
        length: Length of the kernel, in rms distances of a frame from the mean frame.
        ridge: Ridge on the kernel's diagonal.
        rounds: Rounds of reweighting; 0: least squares.
    """

    components: int = 40
    whitening: float = 0.5
    length: float = 1.0
    ridge: float = 1e-3
    rounds: int = 2


CHOICES: Mapping[str, tuple[Any, ...]] = {
    "ridge": (1e-3, 1e-2, 3e-2, 1e-1),
    "components": (20, 40, 60),
    "length": (0.7, 1.0, 1.5),
    "whitening": (0.25, 0.5),
}
"""Values to try, in this order, each with the best values so far."""
MOST = max(CHOICES["components"])
MOST_PRESSES = 6000
"""Most presses that are learned from, evenly spread over all: time grows with the cube of their
number, and 17,000 take 6 GB and hours."""


@dataclass(frozen=True, eq=False)
class Features:
    """The training frames of a kernel regression.

    Attributes:
        components: Components of the displacements.
        moved: (N, 2 P) displacements.
        targets: (N, T) normalised targets.
    """

    components: Components
    moved: Array
    targets: Array

    def places(self, setting: Setting, moved: Array | None = None) -> tuple[Array, float]:
        """Return the components (M, K) of displacements, and the length of the kernel.

        Args:
            setting: Choices of the regression.
            moved: (M, 2 P) displacements; None: those of the training frames.
        """
        first = self.components.first(setting.components)
        trained = first.of(self.moved, setting.whitening)
        length = setting.length * float(np.sqrt(np.square(trained).sum(axis=1).mean()))
        return (trained if moved is None else first.of(moved, setting.whitening)), max(length, 1e-9)


def choose_setting(learned: Features, held_out: Array, targets: Array) -> Setting:
    """Return the setting with the least mean absolute error of frames that were held out.

    Args:
        learned: The frames that are learned from.
        held_out: (M, 2 P) displacements of the frames that were held out.
        targets: (M, T) normalised targets of these.
    """
    best = Setting()
    least = _error(learned, held_out, targets, best)
    for name, values in CHOICES.items():
        for value in values:
            candidate = replace(best, **{name: value})
            if value == getattr(best, name):
                continue
            error = _error(learned, held_out, targets, candidate)
            if error < least:
                least, best = error, candidate
    return best


def _error(learned: Features, held_out: Array, targets: Array, setting: Setting) -> float:
    trained, length = learned.places(setting)
    alpha = kernel_weights(kernel(trained, trained, length), learned.targets, setting)
    places, _ = learned.places(setting, held_out)
    return float(np.abs(kernel(places, trained, length) @ alpha - targets).mean())


def kernel(a: Array, b: Array, length: float) -> Array:
    """Return exp(-|a - b|^2 / (2 length^2)), (N, M), of features a (N, K) and b (M, K)."""
    squares = cdist(a, b, "sqeuclidean")
    squares *= -0.5 / length**2
    return np.asarray(np.exp(squares, out=squares))


def kernel_weights(gram: Array, targets: Array, setting: Setting) -> Array:
    """Return the weights alpha (N, T) of f(x) = sum_i k(x, x_i) alpha_i.

    Least squares: (K + ridge I) alpha = y. A round of reweighting replaces ridge by
    ridge |r_i| / mean |r|, with the residuals r so far, which leads towards the least absolute
    residuals (iteratively reweighted least squares; Holland and Welsch 1977).

    Args:
        gram: (N, N) k(x_i, x_j).
        targets: (N, T) y.
        setting: Choices of the regression, of which ridge and rounds are used.
    """
    count = len(gram)
    plain = cho_solve(cho_factor(_loaded(gram, np.full(count, setting.ridge))), targets)
    columns = []
    for alpha, target in zip(plain.T, targets.T, strict=True):
        for _ in range(setting.rounds if target.any() else 0):  # all 0: not known
            residual = np.maximum(np.abs(target - gram @ alpha), _SMALLEST)
            load = setting.ridge * residual / residual.mean()
            alpha = cho_solve(cho_factor(_loaded(gram, load)), target)
        columns.append(alpha)
    return np.stack(columns, axis=1)


def _loaded(gram: Array, load: Array) -> Array:
    loaded = gram.copy()
    loaded[np.diag_indices(len(gram))] += load
    return loaded


_BATCH = 32
"""Frames that are tracked at once in ``predict``."""
TRANSFER = Setting(components=60, length=2.5, ridge=1e-2)
"""The setting for transfer: validation frames are the trained sensor's and cannot choose for
another one. It was chosen on the presses to which the simulated sensors were calibrated."""


class Kernel(Model):
    """Kernel ridge regression towards the median; no contact where the pins hardly moved.

    Its setting is chosen on the validation frames; without such frames it is the default one. For
    transfer it is fixed, and the training fields are made to differ as those of other sensors do.
    """

    name = "kernel"

    def __init__(self, context: ModelContext) -> None:
        self.context = context
        count = ANSWER_WIDTH[context.answer]
        self._reader: Reader | None = None
        self._correction: Correction | None = None
        self._setting = Setting()
        self._scale = Normalisation(np.zeros(count), np.ones(count))
        self._components = Components(np.zeros(1), np.zeros((1, 1)), np.ones(1))
        self._places, self._alpha = np.zeros((0, 1)), np.zeros((0, count))
        self._length = 1.0
        self._threshold = 0.0

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,  # noqa: ARG002 - there are no epochs
    ) -> FitReport:
        """Choose the setting, then fit.

        Raises:
            UserError: Fewer than two frames can be learned from, or frames of channels are to be
                learned for transfer.
        """
        began = time.perf_counter()
        count = len(frames)
        frames, targets = self._usable(frames, truth)
        if len(frames) < 2:
            raise UserError(
                f"model {self.name!r} was given {len(frames)} training frames that it can learn "
                "from, but needs two; raise the training count."
            )
        if len(frames) > MOST_PRESSES:
            some = np.linspace(0, len(frames) - 1, MOST_PRESSES).round().astype(np.intp)
            frames, targets = [frames[row] for row in some], targets[some]
        self._reader = find_reader(frames, targets, self.context.transfers)
        self._scale = Normalisation.of(targets)
        moved = displacements(self._reader, frames, self.name)
        self._threshold = contact_threshold(moved, self.context.answer)
        if self.context.transfers:
            moved = Differences.on(LATTICE).add(moved, rng)
        most = min(MOST, len(frames) - 1)
        components = Components.fit(moved, most, as_polar=self._reader.polar)
        learned = Features(components, moved, self._scale.apply(targets))
        self._setting = self._choose_setting(learned, validation)
        self._components = components.first(self._setting.components)
        self._places, self._length = learned.places(self._setting)
        self._alpha = kernel_weights(
            kernel(self._places, self._places, self._length), learned.targets, self._setting
        )
        notes = {"left_out": count - len(frames), **asdict(self._setting)}
        return FitReport(seconds=time.perf_counter() - began, notes=notes)

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any]:
        """Fit a correction of the answers to labelled frames of another sensor (``Correction``).

        Frames that cannot be learned from are left out; where none is left, the answers are those
        of the trained model.

        Returns:
            Number of frames and ridge of every target, for the record.
        """
        self._correction = None
        frames, targets = self._usable(frames, truth)
        if not frames:
            return {"frames": 0}
        moved = displacements(self._reader, frames, self.name)
        lacking = self._scale.apply(targets) - self._scale.apply(self._regress(moved))
        self._correction = Correction.fit(self._similarities(moved), lacking)
        return {"frames": len(frames), "ridge": list(self._correction.ridges)}

    def predict(self, frames: Sequence[Frame]) -> list[Answer | None]:
        """Return one answer a frame, computed in float64."""
        answers: list[Answer | None] = []
        for start in range(0, len(frames), _BATCH):
            value: Any = frames[start : start + _BATCH]
            for _, stage in self.stages():
                value = stage(value)
            answers += value
        return answers

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """Return the phases of ``predict``: pins, regression, answers."""
        return [
            ("preprocess", lambda frames: displacements(self._reader, frames, self.name)),
            (
                "forward",
                lambda moved: np.column_stack([self._regress(moved), rms_displacement(moved)]),
            ),
            ("decode", lambda values: read_answers(values, self.context.answer, self._threshold)),
        ]

    def save(self, directory: Path) -> None:
        """Write all that ``predict`` needs into the folder.

        Raises:
            UserError: The model has learned nothing yet.
        """
        if self._reader is None:
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
            arrays,
            model=self.name,
            architecture=self._architecture,
            extra={
                **self._reader.saved(),
                "setting": asdict(self._setting),
                "scale": self._scale.to_json(),
                "length": self._length,
                "least": self._threshold,
                "polar": self._components.polar,
            },
        )

    def load(self, directory: Path) -> None:
        """Read weights from the folder.

        Raises:
            UserError: The weights are missing or damaged, or of another model or answer.
        """
        tensors, extra = load_weights(directory, model=self.name, architecture=self._architecture)
        arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
        self._reader = restored_reader(extra)
        self._setting = Setting(**extra["setting"])
        self._scale = Normalisation.from_json(extra["scale"])
        self._components = Components(
            arrays["mean"], arrays["basis"], arrays["spread"], extra["polar"]
        )
        self._places, self._alpha = arrays["places"], arrays["alpha"]
        self._length = extra["length"]
        self._threshold = extra["least"]

    @property
    def _architecture(self) -> dict[str, Any]:
        """Facts that weights must share, such as whether they are on the common lattice."""
        return {"answer": self.context.answer, "transfers": self.context.transfers}

    def parameter_count(self) -> int:
        """Return the count of learned numbers: places, their weights, the components."""
        arrays = (self._places, self._alpha, self._components.mean, self._components.basis)
        return sum(array.size for array in arrays)

    def flops(self, frame: Frame) -> int | None:  # noqa: ARG002 - the same for every frame
        """Count the two products and the distances, not the exponentials and the tracking."""
        return 2 * self._components.basis.size + 3 * self._places.size + 2 * self._alpha.size

    def _choose_setting(
        self, learned: Features, validation: tuple[Sequence[Frame], Sequence[Answer]]
    ) -> Setting:
        if self.context.transfers:
            return TRANSFER
        frames, targets = self._usable(*validation)
        if not frames:
            return Setting()
        moved = displacements(self._reader, frames, self.name)
        return choose_setting(learned, moved, self._scale.apply(targets))

    def _regress(self, moved: Array) -> Array:
        """Return the answers (N, T), mm and deg, to displacements (N, 2 P)."""
        similarities = self._similarities(moved)
        values = similarities @ self._alpha
        if self._correction is not None:
            values = values + self._correction(similarities)
        return self._scale.invert(values)

    def _similarities(self, moved: Array) -> Array:
        """Return the kernel (N, M) of frames with each of the M training frames."""
        places = self._components.of(moved, self._setting.whitening)
        return kernel(places, self._places, self._length)

    def _usable(
        self, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[list[Frame], Array]:
        rows = regression_rows(truth, self.context.answer, self.name)
        targets = known_targets(frames, truth, self.context.answer, self.name)[rows]
        return [frames[row] for row in rows], targets
