"""The trials of a recording that knows which named places are touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tactibench.errors import UserError
from tactibench.frames.recorded import Recording
from tactibench.frames.source import (
    QUICK_FIT,
    FramePlan,
    FrameRequest,
    FrameSet,
    FrameSource,
    spread,
)
from tactibench.protocols import RECORDED

SESSION = "session"
"""Begins the groups of trials whose session no training saw."""


class SiteFrames(FrameSource):
    """Trials by their number of touched places, or in folds that training and test do not share.

    Raises:
        UserError: The recording does not know the places, or lacks trials to train or to test.
    """

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        assert self.spec.sites is not None  # noqa: S101 - the protocol is one of named places
        self.tests = self.spec.sites
        self.recording = Recording.open(self.spec, request.sensor, request.data)
        known = [scene.sites for scene in self.recording.scenes if scene.sites is not None]
        if not known:
            raise UserError(
                f"{request.data} does not say which named places are touched, but protocol "
                f"{self.spec.id!r} asks for them; import it with --param sites=COLUMNS."
            )
        self.counts = np.array([sites.count for sites in known])
        self.subsets = [str(sites) for sites in known]

    def plan(self) -> FramePlan:
        """Return one division of the trials, or all of them with their folds."""
        most = self.tests.most.get(self.request.regime)
        if most is not None:
            return self._division(self.counts <= most, self.counts > most)
        folds = (*self._subset_folds(), *self._session_folds())
        every = self._division(self.counts >= 0, self.counts >= 0)  # whose weights a lab would keep
        test = tuple(frames for fold in folds for frames in fold.test)
        return replace(every, test=test, folds=folds)

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the test trials, or as many as the request asks for."""
        return self.plan().test

    def _subset_folds(self) -> list[FramePlan]:
        """Return a division for every fold of the sets of places."""
        names = sorted(set(self.subsets))
        rng = np.random.default_rng(self.spec.data_seed)
        order = rng.permutation(len(names))
        fold_of = {names[row]: number % self.tests.folds for number, row in enumerate(order)}
        fold = np.array([fold_of[subset] for subset in self.subsets])
        return [
            self._division(fold != number, fold == number, presses=self.subsets)
            for number in range(self.tests.folds)
        ]

    def _session_folds(self) -> list[FramePlan]:
        """Return a division for every session; [] where there are not several."""
        session = np.array(self.recording.sessions)
        names = np.unique(session)
        if len(names) < 2:
            return []
        return [self._division(session != n, session == n, test=SESSION) for n in names]

    def _division(
        self,
        fit: npt.NDArray[np.bool_],
        tested: npt.NDArray[np.bool_],
        *,
        test: str = "",
        presses: Sequence[str] | None = None,
    ) -> FramePlan:
        """Return the plan that trains on some trials and tests others.

        Args:
            fit: (N,) whether each trial trains.
            tested: (N,) whether each trial is tested.
            test: Name of the test, with which its groups begin; "": the main one.
            presses: Unit of every trial in intervals; None: the trial.

        Raises:
            UserError: No trial trains or none is tested.
        """
        request, recording = self.request, self.recording
        train: Sequence[int] = np.flatnonzero(fit).tolist()
        rows = np.flatnonzero(tested).tolist()
        if not (train and rows):
            raise UserError(
                f"{request.data} has {len(train):,} trials to train and {len(rows):,} to test in "
                f"regime {request.regime!r}; take another regime."
            )
        if request.presses is not None:
            train = spread(train, request.training_count(len(train)))
        if request.quick:
            train = spread(train, QUICK_FIT)
        tested_set = recording.frame_set(
            "test",
            test or RECORDED,
            spread(rows, request.test_count),
            lambda scene: ":".join(filter(None, (test, str(scene.sites and scene.sites.count)))),
        )
        if presses is not None:
            unit_of = dict(zip(recording.names, presses, strict=True))
            units = tuple(unit_of[name] for name in tested_set.names)
            tested_set = replace(tested_set, presses=units)
        return FramePlan(
            source=self,
            fit=(recording.frame_set("fit", RECORDED, train),),
            validation=(),
            test=(tested_set,),
            sensor_identity=recording.identity,
            signals=(recording.sensor.signal,),
        )
