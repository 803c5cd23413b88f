"""The model ``superpose``: pins -> contacts, by least squares on fields of single presses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tactibench import Answer, Contacts, FitReport, Frame, ModelContext, Progress, UserError
from tactibench.superposition import (
    Eye,
    Field,
    Neighbours,
    Solution,
    as_rows,
    shipped_inverse,
    single_presses,
    solve,
)
from tactibench.training import load_weights, save_weights
from tactibench_superpose.detect import Detector
from tactibench_superpose.spread import Spread, law_errors, noise_factors

Array = npt.NDArray[np.float64]

_QUIETEST_PX = 0.003
"""No displacement is believed to be known better than this."""
_LAW_ERRORS = ((0.45, 0.45, 0.37), (0.9, 0.9, 0.4))
"""Of the shipped neighbour law, as benchmarks/neighbours.py prints them (``Spread.law``)."""


@dataclass(frozen=True, eq=False)
class _Learned:
    detector: Detector
    law: Neighbours
    spread: Spread


class Superpose:
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
        wanted = _of(validation[1], held)[:, 0] if len(held) else single[:0]
        off = seen - field(wanted)
        weight = np.full(field.coefficients.shape[-1], 1 / _QUIETEST_PX**2)
        if len(off):
            # Robust: a pin that was mistaken for another in one frame is no noise.
            weight = 1 / np.maximum(1.4826 * np.median(np.abs(off), axis=0), _QUIETEST_PX) ** 2
        detector = Detector.of(
            field, eye, weight, self._settings["gain"], self._settings["max_count"]
        )
        law, errors = self._law(eye, detector, frames, truth)
        self._learned = _Learned(detector, law, Spread(np.ones(3), errors))
        factors = self._noise_factors(seen, wanted)
        self._learned = _Learned(detector, law, Spread(factors, errors))
        progress.step(float(np.mean(off**2)) if len(off) else 0.0)
        progress.epoch(1, float(np.mean(off**2)) if len(off) else 0.0, None)
        notes = {"single_presses": len(rows), "others": len(frames) - len(rows)}
        return FitReport(1, time.perf_counter() - began, notes=notes)

    def _law(
        self, eye: Eye, detector: Detector, frames: Sequence[Frame], truth: Sequence[Answer]
    ) -> tuple[Neighbours, Array]:
        """What contacts do to each other, and how well that is known."""
        if self._settings["neighbours"] == "none":
            return Neighbours.none(), np.array(_LAW_ERRORS)
        law, errors = shipped_inverse(), np.array(_LAW_ERRORS)
        counts = np.array([len(answer) if isinstance(answer, Contacts) else 0 for answer in truth])
        known: list[tuple[Array, Array]] = []
        for count in sorted(set(counts[counts > 1].tolist())):
            rows = np.flatnonzero(counts == count)
            moved, sure = eye.watch(eye.images([frames[int(row)] for row in rows]))
            contacts = _of(truth, rows)
            weight = detector.weight * np.tile(sure, (1, 2))
            found = solve(detector.field, moved, contacts, weight).contacts
            known.append((found, contacts - found))
        if not known:
            return law, errors
        law = Neighbours.learn([e for e, _ in known], [shift for _, shift in known], law)
        for group in (0, 1):
            mine = [one for one in known if min(one[0].shape[1], 3) - 2 == group]
            if mine:
                errors[group] = np.mean(
                    [law_errors(shift, shift - law.shift(e)) for e, shift in mine], axis=0
                )
        return law, errors

    def _noise_factors(self, moved: Array, wanted: Array) -> Array:
        sure = np.ones((len(moved), moved.shape[1] // 2), dtype=np.bool_)
        found = self._contacts(self._found((moved, sure)))
        error, std = [], []
        for contacts, true in zip(found, wanted, strict=True):
            if len(contacts) == 1 and contacts.std is not None:
                error.append(np.append(contacts.xy[0], contacts.depth[0]) - true)
                std.append(contacts.std[0])
        return noise_factors(np.array(error).reshape(-1, 3), np.array(std).reshape(-1, 3))

    def predict(self, frames: Sequence[Frame]) -> list[Contacts]:
        """Contacts of every frame, with their standard deviations."""
        return self._contacts(self._found(self._moved(frames)))

    def stages(self) -> list[tuple[str, Callable[[Any], Any]]]:
        """The phases of ``predict``: pins, fit, neighbours."""
        return [
            ("preprocess", self._moved),
            ("forward", self._found),
            ("decode", self._contacts),
        ]

    timed_as = "float64, as it predicts"

    @property
    def parameters(self) -> int:
        """Numbers that were learned."""
        learned = self._ready()
        law = learned.law.pair.size + learned.law.crowd.size
        return int(learned.detector.field.coefficients.size + law)

    def _moved(self, frames: Sequence[Frame]) -> tuple[Array, npt.NDArray[np.bool_]]:
        eye = self._ready().detector.eye
        return eye.watch(eye.images(frames))

    def _found(self, pins: tuple[Array, npt.NDArray[np.bool_]]) -> list[tuple[Solution, Array]]:
        return [self._ready().detector.find(*one) for one in zip(*pins, strict=True)]

    def _contacts(self, found: list[tuple[Solution, Array]]) -> list[Contacts]:
        learned = self._ready()
        out = []
        for solution, taken in found:
            count = len(taken)
            if not count:
                out.append(Contacts.none())
                continue
            equivalents = solution.contacts
            shift = learned.law.shift(equivalents)[0] if count > 1 else np.zeros((1, 3))
            chi2 = float((learned.detector.weight * solution.left[0] ** 2).sum())
            freedom = solution.left.shape[1] - 3 * count
            std = learned.spread.std(solution.normal[0], chi2, freedom, shift)
            x, y, depth = (equivalents[0] + shift).T
            deepest = self._context.max_depth * 1.2
            out.append(
                Contacts(np.stack([x, y], axis=1), depth.clip(0.0, deepest), taken.clip(0, 1), std)
            )
        return out

    def save(self, directory: Path) -> None:
        """Write the weights into the folder."""
        learned = self._ready()
        field = learned.detector.field
        tensors = {
            "coefficients": field.coefficients, "low": field.low, "step": field.step,
            "weight": learned.detector.weight, "still": learned.detector.eye.still,
            "pair": learned.law.pair, "crowd": learned.law.crowd,
            "noise": learned.spread.noise, "law": learned.spread.law,
        }  # fmt: skip
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
        self._learned = _Learned(
            detector,
            Neighbours(read["pair"], read["crowd"]),
            Spread(read["noise"], read["law"]),
        )

    def _ready(self) -> _Learned:
        if self._learned is None:
            raise UserError("model 'superpose' has no weights yet; fit it or load them.")
        return self._learned


def _of(truth: Sequence[Answer], rows: npt.NDArray[np.intp]) -> Array:
    return as_rows([truth[int(row)] for row in rows])
