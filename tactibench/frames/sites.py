"""The trials of a recording that knows which named places are touched.

With another recording to test on, its trials are tested in place of those that would be tested
otherwise: a test holds the same numbers or sets of places, and another day or board.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Sites
from tactibench.errors import UserError
from tactibench.frames.recorded import Recording, training_sets
from tactibench.frames.source import FramePlan, FrameRequest, FrameSet, FrameSource, spread
from tactibench.protocols import RECORDED, PressSplit

SESSION = "session"
"""Begins the groups of trials whose session no training saw."""


def _sites(recording: Recording) -> list[Sites]:
    return [scene.sites for scene in recording.scenes if scene.sites is not None]


class SiteFrames(FrameSource):
    """Trials by their number of touched places, or in folds that training and test do not share.

    Raises:
        UserError: A recording does not know the places.
    """

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        assert self.spec.sites is not None  # noqa: S101 - the protocol is one of named places
        self.tests = self.spec.sites
        self.trained = self.tested = Recording.open(self.spec, request.sensor, request.data)
        if request.test_data is not None:
            self.tested = Recording.open(self.spec, request.tested, request.test_data)
        for recording in (self.trained, self.tested):
            if not any(_sites(recording)):
                raise UserError(
                    f"{recording.identity['describe']['folder']} does not say which named places "
                    f"are touched, but protocol {self.spec.id!r} asks for them; import it with "
                    "--param sites=COLUMNS."
                )

    def plan(self) -> FramePlan:
        """Return one division of the trials, or all of them with their folds.

        Raises:
            UserError: The tested recording is the one that trains, or has other places. Or no trial
                trains, or none is tested.
        """
        data, test_data = self.request.data, self.request.test_data
        if test_data is not None and self.trained.identity == self.tested.identity:
            raise UserError(
                f"{test_data} is the recording that is trained on; leave --test out, or name "
                "another one."
            )
        trained, tested = (_sites(r)[0].names for r in (self.trained, self.tested))
        if trained != tested:
            raise UserError(
                f"{test_data} has the places {', '.join(tested)}, but {data} {', '.join(trained)}; "
                "import both with the same names in the same order."
            )
        plan = self._plan()
        if not all(part.count("fit") and part.count("test") for part in (plan, *plan.folds)):
            raise UserError(
                f"{data} has no trials to train or {test_data or 'it'} none to test in regime "
                f"{self.request.regime!r}; take another regime."
            )
        return plan

    def _plan(self) -> FramePlan:
        counts = [np.array([s.count for s in _sites(r)]) for r in (self.trained, self.tested)]
        most = self.tests.most.get(self.request.regime)
        if most is not None:
            return self._division(counts[0] <= most, counts[1] > most)
        folds = (*self._subset_folds(), *self._session_folds())
        # The weights that a lab would keep learned from all trials.
        every = self._division(counts[0] >= 0, counts[1] >= 0)
        test = tuple(frames for fold in folds for frames in fold.test)
        return replace(every, test=test, folds=folds)

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the test trials, or as many as the request asks for."""
        return self._plan().test

    def _subset_folds(self) -> list[FramePlan]:
        """Return a division for every fold of the sets of places."""
        trained, tested = (np.array([*map(str, _sites(r))]) for r in (self.trained, self.tested))
        names = np.unique(tested)
        order = np.random.default_rng(self.spec.data_seed).permutation(len(names))
        held = [names[order[number :: self.tests.folds]] for number in range(self.tests.folds)]
        return [
            self._division(~np.isin(trained, some), np.isin(tested, some), presses=tested)
            for some in held
        ]

    def _session_folds(self) -> list[FramePlan]:
        """Return a division for every session; [] where there are not several.

        Another recording is another session as a whole.
        """
        trained, tested = (np.array(r.sessions) for r in (self.trained, self.tested))
        if self.tested is not self.trained:
            return [self._division(trained == trained, tested == tested, test=SESSION)]  # all
        names = np.unique(tested)
        if len(names) < 2:
            return []
        return [self._division(trained != n, tested == n, test=SESSION) for n in names]

    def _division(
        self,
        fit: npt.NDArray[np.bool_],
        tested: npt.NDArray[np.bool_],
        *,
        test: str = "",
        presses: npt.NDArray[np.str_] | None = None,
    ) -> FramePlan:
        """Return the plan that trains on some trials and tests others.

        Args:
            fit: (N,) whether each trial trains.
            tested: (M,) whether each trial of the tested recording is tested.
            test: Name of the test, with which its groups begin; "": the main one.
            presses: (M,) unit of every trial in intervals; None: the trial.
        """
        train, rows = (tuple(np.flatnonzero(some).tolist()) for some in (fit, tested))
        fit_sets, _ = training_sets(self.request, self.trained, PressSplit(train, (), rows))
        rows = spread(rows, self.request.test_count)
        tested_set = self.tested.frame_set(
            "test",
            test or RECORDED,
            rows,
            lambda scene: ":".join(filter(None, (test, str(scene.sites and scene.sites.count)))),
        )
        if presses is not None:
            tested_set = replace(tested_set, presses=tuple(presses[[*rows]].tolist()))
        same = self.tested is self.trained
        return FramePlan(
            source=self,
            fit=fit_sets,
            validation=(),
            test=(tested_set,),
            sensor_identity=self.trained.identity,
            test_identity=None if same else self.tested.identity,
            signals=(self.trained.sensor.signal, self.tested.sensor.signal),
        )
