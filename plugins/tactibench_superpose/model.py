"""The model ``superpose``: pins -> contacts, by least squares on fields of single presses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import linear_sum_assignment

from tactibench import Answer, Contacts, FitReport, Frame, Model, ModelContext, Progress, UserError
from tactibench.superposition import (
    Eye,
    Field,
    Neighbours,
    Remainder,
    Solution,
    as_rows,
    single_presses,
)
from tactibench.training import load_weights, save_weights
from tactibench_superpose.detect import FIRM, Detector
from tactibench_superpose.several import Several, by_count, laws
from tactibench_superpose.spread import GROUPS, Clues, Spread, shipped
from tactibench_superpose.unexplained import Unexplained

Array = npt.NDArray[np.float64]
_Pins = tuple[npt.NDArray[np.uint8], Array, npt.NDArray[np.bool_]]
"""Images (N, H, W), displacements (N, Q) px, and (N, P) whether a pin is surely itself."""

_QUIETEST_PX = 0.003
"""No displacement is believed to be known better than this."""
_EVERY = 8
"""Every so many training presses with several contacts are left out of the law and answered, to see
the errors. With every fourth left out the law is a quarter farther off than the one from all."""


@dataclass(frozen=True, eq=False)
class _Learned:
    detector: Detector
    law: Neighbours
    remainder: Remainder
    spread: Spread

    def shift(self, equivalents: Array) -> Array:
        """(1, K, 3) mm from equivalents (1, K, 3) to the contacts behind them."""
        return self.law.shift(equivalents) + self.remainder.shift(equivalents)


class Superpose(Model):
    """Several contacts from fields that were learned from single presses.

    The displacement of all pins is a smooth function of one contact's x, y and depth (``Field``).
    A frame is explained by as many contacts as it takes, found greedily and refined together by
    Gauss-Newton; each one found is the *equivalent* of a contact, from which its neighbours'
    influence is then taken back (``Neighbours``).
    """

    def __init__(
        self,
        context: ModelContext,
        neighbours: str = "dome",
        gain: float = 1.2,
        max_count: int = 6,
    ) -> None:
        self._settings: dict[str, Any] = {
            "neighbours": neighbours,
            "gain": gain,
            "max_count": max_count,
        }
        self._context = context
        self._learned: _Learned | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Learn the field from the single presses, and the law from the others where it may.

        Nothing is drawn at random. Raises UserError for too few single presses or no rest image.
        """
        del rng
        began = time.perf_counter()
        progress.start(1, 1)
        rows = single_presses(truth)
        eye = Eye.of(frames)
        single = _of(truth, rows)[:, 0] if len(rows) else np.empty((0, 3))
        field = Field.learn(single, eye.moved(eye.images([frames[int(row)] for row in rows])))
        held = single_presses(validation[1])
        seen = eye.moved(eye.images([validation[0][int(row)] for row in held]))
        wanted = _of(validation[1], held) if len(held) else np.empty((0, 1, 3))
        off = seen - field(wanted[:, 0])
        weight = np.full(field.coefficients.shape[-1], 1 / _QUIETEST_PX**2)
        if len(off):
            # Robust: a pin that was mistaken for another in one frame is no noise.
            weight = 1 / np.maximum(1.4826 * np.median(np.abs(off), axis=0), _QUIETEST_PX) ** 2
        detector = Detector.of(
            field, eye, weight, self._settings["gain"], self._settings["max_count"]
        )
        groups = self._several(detector, frames, truth)
        if groups:
            left = np.concatenate([group.left for group in groups])
            detector = replace(detector, unexplained=Unexplained.learn(left, weight))
        spread = shipped()
        # Presses that a law was learned from are answered better than others: how far off answers
        # are is seen on presses that it was not learned from, and then it is learned from all.
        self._learned = _Learned(detector, *self._laws(groups, _EVERY), spread)
        held_frames = [validation[0][int(row)] for row in held]
        spread = spread.with_group(1, *self.errors(held_frames, wanted))
        for rows in by_count(truth):
            some = rows[::_EVERY]
            known = _of(truth, some)
            found = self.errors([frames[int(row)] for row in some], known)
            spread = spread.with_group(min(known.shape[1], GROUPS), *found)
        self._learned = _Learned(detector, *self._laws(groups), spread)
        progress.step(float(np.mean(off**2)) if len(off) else 0.0)
        progress.epoch(1, float(np.mean(off**2)) if len(off) else 0.0, None)
        notes = {"single_presses": len(single), "others": len(frames) - len(single)}
        return FitReport(1, time.perf_counter() - began, notes=notes)

    def _several(
        self, detector: Detector, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> list[Several]:
        """Presses with several contacts; none of them is looked at where no law is wanted."""
        if self._settings["neighbours"] == "none":
            return []
        return [Several.of(detector, frames, truth, rows) for rows in by_count(truth)]

    def _laws(
        self, groups: Sequence[Several], without: int | None = None
    ) -> tuple[Neighbours, Remainder]:
        if self._settings["neighbours"] == "none":
            return Neighbours.none(), Remainder.none()
        return laws(groups, without)

    def errors(self, frames: Sequence[Frame], wanted: Array) -> tuple[list[Clues], list[Array]]:
        """What the stated errors hang on, and the errors (K, 3) mm, of frames with contacts wanted.

        wanted: (N, K, 3) x, y, depth mm. Frames in which as many were found.
        """
        clues, errors = [], []
        for (solution, taken), true in zip(self._found(self._pins(frames)), wanted, strict=True):
            if len(taken) != len(true):
                continue
            contacts, clue = self._corrected(solution, taken)
            apart = np.hypot(*(contacts[:, None, :2] - true[None, :, :2]).transpose(2, 0, 1))
            clues.append(clue)
            errors.append(contacts - true[linear_sum_assignment(apart)[1]])
        return clues, errors

    def predict(self, frames: Sequence[Frame]) -> list[Contacts]:
        """Contacts of every frame, with their standard deviations."""
        return self._contacts(self._found(self._pins(frames)))

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """The phases of ``predict``: pins, fit, neighbours."""
        return [
            ("preprocess", self._pins),
            ("forward", self._found),
            ("decode", self._contacts),
        ]

    timed_as = "float64, as it predicts"

    def parameter_count(self) -> int:
        """Numbers that were learned."""
        learned = self._ready()
        law = learned.law.pair.size + learned.law.crowd.size
        law += learned.remainder.along.size + learned.remainder.across.size
        return int(learned.detector.field.coefficients.size + law)

    def _pins(self, frames: Sequence[Frame]) -> _Pins:
        eye = self._ready().detector.eye
        images = eye.images(frames)
        return images, *eye.watch(images)

    def _found(self, pins: _Pins) -> list[tuple[Solution, Array]]:
        return [self._ready().detector.find(*one) for one in zip(*pins, strict=True)]

    def _contacts(self, found: list[tuple[Solution, Array]]) -> list[Contacts]:
        spread, deepest = self._ready().spread, self._context.max_depth * 1.2
        out = []
        for solution, taken in found:
            if not len(taken):
                out.append(Contacts.none())
                continue
            contacts, clues = self._corrected(solution, taken)
            depth = contacts[:, 2].clip(0.0, deepest)
            out.append(Contacts(contacts[:, :2], depth, taken.clip(0, 1), spread.std(clues)))
        return out

    def _corrected(self, solution: Solution, taken: Array) -> tuple[Array, Clues]:
        """(K, 3) contacts behind the equivalents that were found, and what their errors hang on.

        Faint contacts do not shift the firm ones.
        """
        learned, equivalents = self._ready(), solution.contacts
        count, firm = equivalents.shape[1], taken >= FIRM
        shift = learned.shift(equivalents)[0]
        if 0 < np.count_nonzero(firm) < count:
            shift[firm] = learned.shift(equivalents[:, firm])[0]
        chi2 = float((learned.detector.weight * solution.left[0] ** 2).sum())
        misfit = chi2 / max(solution.left.shape[1] - 3 * count, 1)
        return solution.contacts[0] + shift, Clues.of(solution.normal[0], misfit, shift)

    def save(self, directory: Path) -> None:
        """Write the weights into the folder."""
        learned = self._ready()
        field = learned.detector.field
        tensors = {
            "coefficients": field.coefficients,
            "low": field.low,
            "step": field.step,
            "weight": learned.detector.weight,
            "still": learned.detector.eye.still,
            "pair": learned.law.pair,
            "crowd": learned.law.crowd,
            "pairs": learned.remainder.known,
            "pairs_along": learned.remainder.along,
            "pairs_across": learned.remainder.across,
            "pairs_length": np.array(learned.remainder.length),
            "spread": learned.spread.terms,
            "unexplained": learned.detector.unexplained.covariance,
        }
        save_weights(
            directory,
            {name: torch.from_numpy(np.array(value)) for name, value in tensors.items()},
            model="superpose",
            architecture=self._settings,
        )

    def load(self, directory: Path) -> None:
        """Read weights. Raises UserError for those of another model or other settings."""
        tensors, _ = load_weights(directory, model="superpose", architecture=self._settings)
        read = {name: value.numpy() for name, value in tensors.items()}
        field = Field(read["coefficients"], read["low"], read["step"])
        eye = Eye.at(read["still"])
        detector = Detector.of(
            field,
            eye,
            read["weight"],
            self._settings["gain"],
            self._settings["max_count"],
        )
        usual = Unexplained(read["unexplained"], np.sqrt(read["weight"]))
        detector = replace(detector, unexplained=usual)
        self._learned = _Learned(
            detector,
            Neighbours(read["pair"], read["crowd"]),
            Remainder(
                read["pairs"],
                read["pairs_along"],
                read["pairs_across"],
                float(read["pairs_length"]),
            ),
            Spread(read["spread"]),
        )

    def _ready(self) -> _Learned:
        if self._learned is None:
            raise UserError("model 'superpose' has no weights yet; fit it or load them.")
        return self._learned


def _of(truth: Sequence[Answer], rows: npt.NDArray[np.intp]) -> Array:
    return as_rows([truth[int(row)] for row in rows])
