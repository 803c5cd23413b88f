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
from tactibench.markers import PinTracker
from tactibench.superposition import (
    Field,
    NeighbourLaw,
    Residual,
    Solution,
    contact_array,
    single_press_rows,
)
from tactibench.training import load_weights, save_weights
from tactibench_superpose.detect import FIRM, Detector
from tactibench_superpose.model_error import ModelError
from tactibench_superpose.multi_contact import MultiContactPresses, learn_laws, rows_by_count
from tactibench_superpose.spread import GROUPS, Clues, Spread, nominal_spread

Array = npt.NDArray[np.float64]
_Pins = tuple[npt.NDArray[np.uint8], Array, npt.NDArray[np.bool_]]
"""Images (N, H, W), displacements (N, Q) px, and (N, P) whether a pin is surely itself."""

_QUIETEST_PX = 0.003
"""No displacement is believed to be known better than this."""
_HELD_OUT = 8
"""One of so many training presses with several contacts is left out of the law, to measure the
errors of answers. With every fourth left out the law is a quarter worse than the one from all."""


@dataclass(frozen=True, eq=False)
class _Learned:
    detector: Detector
    law: NeighbourLaw
    residual: Residual
    spread: Spread

    def shift(self, equivalents: Array) -> Array:
        """Return (1, K, 3) mm from equivalents (1, K, 3) to their contacts."""
        return self.law.shift(equivalents) + self.residual.shift(equivalents)


class Superpose(Model):
    """Several contacts from fields that were learned from single presses.

    The displacement of all pins is a smooth function of one contact's x, y and depth (``Field``).
    A frame is explained by as many contacts as it takes, found greedily and refined together by
    Gauss-Newton; each one found is the *equivalent* of a contact, from which its neighbours'
    influence is then taken back (``NeighbourLaw``).
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

        Nothing is drawn at random.

        Raises:
            UserError: for too few single presses or no rest image.
        """
        del rng
        began = time.perf_counter()
        progress.start(1, 1)
        rows = single_press_rows(truth)
        pins = PinTracker.of(frames)
        single = _contacts_of(truth, rows)[:, 0] if len(rows) else np.empty((0, 3))
        field = Field.learn(
            single, pins.displacements(pins.images([frames[int(row)] for row in rows]))
        )
        held = single_press_rows(validation[1])
        moved = pins.displacements(pins.images([validation[0][int(row)] for row in held]))
        wanted = _contacts_of(validation[1], held) if len(held) else np.empty((0, 1, 3))
        residual = moved - field(wanted[:, 0])
        weight = np.full(field.coefficients.shape[-1], 1 / _QUIETEST_PX**2)
        if len(residual):
            # Robust: a pin that was mistaken for another in one frame is no noise.
            weight = 1 / np.maximum(1.4826 * np.median(np.abs(residual), axis=0), _QUIETEST_PX) ** 2
        detector = Detector.of(
            field, pins, weight, self._settings["gain"], self._settings["max_count"]
        )
        groups = self._explain_groups(detector, frames, truth)
        if groups:
            left = np.concatenate([group.left for group in groups])
            detector = replace(detector, model_error=ModelError.learn(left, weight))
        spread = nominal_spread()
        # A law answers the presses that it was learned from better than others: errors are measured
        # on presses that were left out, and then the law is learned from all.
        self._learned = _Learned(detector, *self._learn_laws(groups, _HELD_OUT), spread)
        held_frames = [validation[0][int(row)] for row in held]
        spread = spread.with_group(1, *self.errors(held_frames, wanted))
        for rows in rows_by_count(truth):
            tested = rows[::_HELD_OUT]
            true = _contacts_of(truth, tested)
            errors = self.errors([frames[int(row)] for row in tested], true)
            spread = spread.with_group(min(true.shape[1], GROUPS), *errors)
        self._learned = _Learned(detector, *self._learn_laws(groups), spread)
        progress.step(float(np.mean(residual**2)) if len(residual) else 0.0)
        progress.epoch(1, float(np.mean(residual**2)) if len(residual) else 0.0, None)
        notes = {"single_presses": len(single), "others": len(frames) - len(single)}
        return FitReport(1, time.perf_counter() - began, notes=notes)

    def _explain_groups(
        self, detector: Detector, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> list[MultiContactPresses]:
        """Explain the presses with several contacts; none where no law is wanted."""
        if self._settings["neighbours"] == "none":
            return []
        return [
            MultiContactPresses.of(detector, frames, truth, rows) for rows in rows_by_count(truth)
        ]

    def _learn_laws(
        self, groups: Sequence[MultiContactPresses], held_out: int | None = None
    ) -> tuple[NeighbourLaw, Residual]:
        if self._settings["neighbours"] == "none":
            return NeighbourLaw.none(), Residual.none()
        return learn_laws(groups, held_out)

    def errors(self, frames: Sequence[Frame], wanted: Array) -> tuple[list[Clues], list[Array]]:
        """Return the causes of errors, and the errors (K, 3) mm, of frames with known contacts.

        Frames in which another number of contacts is found are left out. wanted: (N, K, 3) x, y,
        depth mm.
        """
        clues, errors = [], []
        for (solution, share), true in zip(self._fit(self._pins(frames)), wanted, strict=True):
            if len(share) != len(true):
                continue
            contacts, clue = self._correct(solution, share)
            apart = np.hypot(*(contacts[:, None, :2] - true[None, :, :2]).transpose(2, 0, 1))
            clues.append(clue)
            errors.append(contacts - true[linear_sum_assignment(apart)[1]])
        return clues, errors

    def predict(self, frames: Sequence[Frame]) -> list[Contacts]:
        """Return the contacts of every frame, with their standard deviations."""
        return self._contacts(self._fit(self._pins(frames)))

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """Return the phases of ``predict``: pins, fit, neighbours."""
        return [
            ("preprocess", self._pins),
            ("forward", self._fit),
            ("decode", self._contacts),
        ]

    timed_as = "float64, as it predicts"

    def parameter_count(self) -> int:
        """Numbers that were learned."""
        learned = self._ready()
        law = learned.law.pair.size + learned.law.crowd.size
        law += learned.residual.along.size + learned.residual.across.size
        return int(learned.detector.field.coefficients.size + law)

    def _pins(self, frames: Sequence[Frame]) -> _Pins:
        pins = self._ready().detector.pins
        images = pins.images(frames)
        return images, *pins.track(images)

    def _fit(self, pins: _Pins) -> list[tuple[Solution, Array]]:
        return [self._ready().detector.find(*frame) for frame in zip(*pins, strict=True)]

    def _contacts(self, solutions: list[tuple[Solution, Array]]) -> list[Contacts]:
        spread, deepest = self._ready().spread, self._context.max_depth * 1.2
        out = []
        for solution, share in solutions:
            if not len(share):
                out.append(Contacts.none())
                continue
            contacts, clues = self._correct(solution, share)
            depth = contacts[:, 2].clip(0.0, deepest)
            out.append(Contacts(contacts[:, :2], depth, share.clip(0, 1), spread.std(clues)))
        return out

    def _correct(self, solution: Solution, share: Array) -> tuple[Array, Clues]:
        """(K, 3) contacts behind the equivalents that were found, and the causes of their errors.

        Faint contacts do not shift the firm ones.
        """
        learned, equivalents = self._ready(), solution.contacts
        count, firm = equivalents.shape[1], share >= FIRM
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
            "still": learned.detector.pins.rest_image,
            "pair": learned.law.pair,
            "crowd": learned.law.crowd,
            "pairs": learned.residual.features,
            "pairs_along": learned.residual.along,
            "pairs_across": learned.residual.across,
            "pairs_length": np.array(learned.residual.length),
            "spread": learned.spread.terms,
            "unexplained": learned.detector.model_error.covariance,
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
        pins = PinTracker(read["still"])
        detector = Detector.of(
            field,
            pins,
            read["weight"],
            self._settings["gain"],
            self._settings["max_count"],
        )
        model_error = ModelError(read["unexplained"], np.sqrt(read["weight"]))
        detector = replace(detector, model_error=model_error)
        self._learned = _Learned(
            detector,
            NeighbourLaw(read["pair"], read["crowd"]),
            Residual(
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


def _contacts_of(truth: Sequence[Answer], rows: npt.NDArray[np.intp]) -> Array:
    return contact_array([truth[int(row)] for row in rows])
