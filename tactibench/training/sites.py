"""Models that say which named places of a skin are touched.

Channels of several contacts nearly add up, where each channel is squashed first: a few channels
move a hundred times farther than the others, and most of what they say is noise. A scorer gives
every place a score, 0 where no channel differs from rest. How far a touched place raises the scores
is measured on trials that the scorer did not learn from, because a regression on thousands of
channels finds its own training trials too easy. Trials of another day have the same scores but for
one gain, so that the gain of a trial is left open.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.channels import channel_vectors
from tactibench.contacts import Answer, Frame, Sites
from tactibench.errors import UserError
from tactibench.plugins import FitReport, Model, ModelContext, Progress, Stage
from tactibench.records import read_arrays, write_arrays

Array = npt.NDArray[np.float64]
Inputs = npt.NDArray[np.float32]
Arrays = dict[str, npt.NDArray[Any]]

MOST_PLACES = 12
"""Most places: the sets of more would not fit the memory of a small machine."""
FOLDS = 3
"""Divisions of the training trials on which scores are measured."""
MIXED = 2000
"""Sets of places for which trials are mixed, where trials touch half of the places at most."""
_QUANTILE, _FLOOR = 80, 0.5
"""A channel is squashed at this percentile of its size, and at no less than this share of the
median channel's, so that a channel that hardly moves is no noise of full size."""
_GAINS = np.arange(0.25, 1.51, 0.125)
"""Gains of a trial, all equally likely: presses of another day are half to one and a half times as
strong. Narrower and wider ranges answer alike within a session."""
_FILE = "sites.npz"


@dataclass(frozen=True, eq=False)
class TouchTrials:
    """Trials to learn from.

    Attributes:
        channels: (N, C) channels.
        touched: (N, K) whether each place is touched.
        session: (N,) number of the session.
    """

    channels: Inputs
    touched: npt.NDArray[np.bool_]
    session: npt.NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.channels)

    def __getitem__(self, rows: npt.NDArray[Any]) -> TouchTrials:
        return TouchTrials(self.channels[rows], self.touched[rows], self.session[rows])

    def folds(self, rng: np.random.Generator) -> npt.NDArray[np.intp]:
        """Return the (N,) folds; trials of one set of places are dealt evenly."""
        order = rng.permutation(len(self))
        order = order[np.lexsort(self.touched[order].T)]
        fold = np.empty(len(self), dtype=np.intp)
        fold[order] = np.arange(len(self)) % FOLDS
        return fold

    def with_mixed(self, most: int, rng: np.random.Generator) -> TouchTrials:
        """Return these trials and sums of trials of one session that touch different places.

        Sums are made for sets with more places than any trial has, each place being in such a set
        or not with equal odds. A place of the set that no trial could add is left out. There are no
        sums where trials touch more than half of the places.

        Args:
            most: Number of sets that are drawn.
            rng: Generator that draws sets and trials.
        """
        known = int(self.touched.sum(axis=1).max())
        if 2 * known > self.touched.shape[1]:
            return self
        sums, sets, sessions = [self.channels], [self.touched], [self.session]
        for wanted in rng.random((most, self.touched.shape[1])) < 0.5:
            if wanted.sum() <= known:
                continue
            session = rng.choice(self.session)
            mixed = np.zeros(self.channels.shape[1], dtype=np.float32)
            left = wanted.copy()
            inside = self.touched.any(axis=1) & (self.session == session)
            while len(rows := np.flatnonzero(inside & ~(self.touched & ~left).any(axis=1))):
                row = rng.choice(rows)
                mixed += self.channels[row]
                left &= ~self.touched[row]
            sums.append(mixed[None])
            sets.append((wanted & ~left)[None])
            sessions.append(np.array([session]))
        return TouchTrials(np.concatenate(sums), np.concatenate(sets), np.concatenate(sessions))


class SiteModel(Model):
    """Squashed channels -> a score of every place -> the most probable set of places.

    Args:
        context: Circumstances of the run.
        mixing: Whether sums of trials are learned from, too, where training trials touch few
            places. Without them no set of more places is ever seen.

    Attributes:
        name: Name of the model, for errors.
        adds: Whether the scorer itself knows that fields add up, and learns from no sums.
    """

    name = ""
    adds = False

    def __init__(self, context: ModelContext, mixing: bool = True) -> None:
        self.context, self.mixing = context, mixing
        self._learned: Arrays = {}

    @abstractmethod
    def learn(
        self, inputs: Inputs, touched: npt.NDArray[np.bool_], rng: np.random.Generator
    ) -> Arrays:
        """Return what the scorer learns from squashed channels (N, C) and places (N, K)."""

    @abstractmethod
    def scores(self, learned: Mapping[str, npt.NDArray[Any]], inputs: Inputs) -> Array:
        """Return the (N, K) scores of squashed channels; those of channels at rest (0) are 0."""

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Learn the scorer, and what scores the sets of places have on trials that were left out.

        Raises:
            UserError: There are fewer trials than folds, or more places than can be enumerated.
        """
        del validation, progress
        began = time.perf_counter()
        known = [sites for sites in truth if isinstance(sites, Sites)]
        if len(known) < FOLDS or len(known[0].names) > MOST_PLACES:
            raise UserError(
                f"model {self.name!r} needs {FOLDS} trials or more of at most {MOST_PLACES} "
                f"places, but was given {len(known)}; name fewer places or record more."
            )
        minus_rest = all(frame.rest is not None for frame in frames)
        channels = channel_vectors(frames, minus_rest=minus_rest)
        size = np.percentile(np.abs(channels), _QUANTILE, axis=0)
        moving = size[size > 0]
        floor = _FLOOR * float(np.median(moving)) if len(moving) else 1.0
        self._learned = {
            "scale": (size + floor).astype(np.float32),
            "names": np.array(known[0].names),
            "minus_rest": np.array(minus_rest),
            "untouched": np.array(any(sites.count == 0 for sites in known)),
        }
        _, session = np.unique([frame.session for frame in frames], return_inverse=True)
        trials = TouchTrials(channels, np.array([s.touched for s in known]), session)
        fold = trials.folds(rng)
        held_out = [self._held_out(trials, fold == k, rng) for k in range(FOLDS)]
        scores, touched = map(np.concatenate, zip(*held_out, strict=True))
        mixed = self._to_learn(trials, rng)
        self._learned |= self.learn(self._squash(mixed.channels), mixed.touched, rng)
        self._learned |= _responses(scores, touched, mixed=len(scores) > len(trials))
        notes = {"trials": len(trials), "mixing": round(len(mixed) / len(trials) - 1, 1)}
        return FitReport(seconds=time.perf_counter() - began, notes=notes)

    def _to_learn(self, trials: TouchTrials, rng: np.random.Generator) -> TouchTrials:
        return trials.with_mixed(MIXED, rng) if self.mixing and not self.adds else trials

    def _held_out(
        self, trials: TouchTrials, out: npt.NDArray[np.bool_], rng: np.random.Generator
    ) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return the scores (N, K) and touched places (N, K) of trials that were left out."""
        to_learn, held = self._to_learn(trials[~out], rng), trials[out]
        if self.mixing:
            held = held.with_mixed(MIXED // FOLDS, rng)
        learned = self.learn(self._squash(to_learn.channels), to_learn.touched, rng)
        return self.scores(learned, self._squash(held.channels)), held.touched

    def _squash(self, channels: Inputs) -> Inputs:
        squashed: Inputs = np.tanh(channels / self._learned["scale"])
        return squashed

    def predict(self, frames: Sequence[Frame]) -> list[Answer]:
        """Return the most probable set of places of every frame."""
        return self._answers(self._score(self._inputs(frames)))

    def stages(self) -> Sequence[Stage]:
        """Return the phases of ``predict``, in order."""
        return [("preprocess", self._inputs), ("forward", self._score), ("decode", self._answers)]

    def _inputs(self, frames: Sequence[Frame]) -> Inputs:
        if not self._learned:
            raise UserError(f"model {self.name!r} has learned nothing yet; train it first.")
        count, minus_rest = len(self._learned["scale"]), bool(self._learned["minus_rest"])
        return self._squash(channel_vectors(frames, minus_rest=minus_rest, count=count))

    def _score(self, inputs: Inputs) -> Array:
        return self.scores(self._learned, inputs)

    def _answers(self, scores: Array) -> list[Answer]:
        learned, names = self._learned, tuple(self._learned["names"].tolist())
        sets = np.array(list(product((False, True), repeat=len(names))))
        sets = sets if learned["untouched"] else sets[1:]
        field, variance = learned["field"], learned["variance"]
        answers: list[Answer] = []
        for score in scores:
            expected = _GAINS[:, None, None] * (sets @ field)
            fit = -0.5 * (np.square(score - expected) / variance).sum(axis=2)
            likelihood = np.exp(fit - fit.max()).sum(axis=0)
            likelihood /= likelihood.sum()
            probability = np.clip(likelihood @ sets, 0.0, 1.0)
            best = sets[likelihood.argmax()]
            answers.append(Sites(names, tuple(probability.tolist()), tuple(best.tolist())))
        return answers

    def save(self, directory: Path) -> None:
        """Write sites.npz."""
        write_arrays(directory / _FILE, self._learned)

    def load(self, directory: Path) -> None:
        """Read sites.npz.

        Raises:
            UserError: The file is missing or damaged.
        """
        self._learned = read_arrays(directory / _FILE)


def _responses(scores: Array, touched: npt.NDArray[np.bool_], *, mixed: bool) -> Arrays:
    """Return how far each touched place raises all scores, and the variance that is left.

    Args:
        scores: (N, K) scores of trials that were not learned from.
        touched: (N, K) whether each place is touched.
        mixed: Whether trials are sums: these also add up the noise of their trials, which real
            trials do not, so that a place is taken to raise its own score alone.

    Returns:
        field (K, K) and variance (K,) of scores = touched @ field.
    """
    if mixed:
        field = np.diag((touched * scores).sum(axis=0) / np.maximum(touched.sum(axis=0), 1))
    else:
        field = np.linalg.lstsq(touched.astype(np.float64), scores, rcond=None)[0]
    variance = np.square(scores - touched @ field).mean(axis=0) + 1e-6
    return {"field": field, "variance": variance}
