"""Refinement: the contacts that a model found, fitted to the pins by fields of single presses.

A network says how many contacts there are and about where; the fit says exactly where, and drops
what no field explains. A contact is never added, and none moves by more than ``REACH_MM``.

    contact of the model -> equivalent -> least squares of superposed fields -> contact

The law of neighbours (``nominal_law``) leads to the equivalents, its inverse back. Friction is a
number of each press that is fitted with them, and so is the motion of the image, where it explains
much (``ContactFit.find``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, Frame
from tactibench.errors import UserError
from tactibench.markers import AlignedSensors
from tactibench.superposition.contact_fit import ContactFit, Found
from tactibench.superposition.field import Field, FieldFamily, drag_clue
from tactibench.superposition.neighbours import nominal_inverse_law, nominal_law
from tactibench.superposition.single_presses import (
    SinglePresses,
    TrackedFrame,
    noise_weight,
    track,
)
from tactibench.superposition.spread import ErrorCauses, Spread, nominal_spread

Array = npt.NDArray[np.float64]

REACH_MM = 1.5
"""Farthest that a contact moves. Of 1,944 contacts that a U-Net of single presses found in training
pairs and triples of ``exp2``, the fit moved 26 by more than 1 mm, most of them to the right place,
and 3 by more than this."""
SHARE = 0.2
"""Least share of the misfit that a contact explains. 2 of those 1,944 explained less. In 300 empty
frames under faults the U-Net found 1,083 contacts; two were kept."""
DEPTHS = (0.4, 2.5)
"""Least and greatest factor on the depth of a contact."""
_GAIN = 1.2
"""Factor by which one contact more must lower the misfit, where a motion of the image is tried."""
_MOST = 6
"""Most contacts of a frame: of more, those with the highest scores. No fit resolves as many."""
_KEPT = 2
"""Number of sensors whose fields stay in memory, 100 MB each where they vary."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalFit(ContactFit):
    """The fit of given contacts.

    Attributes:
        start: (1, K, 3) x, y and depth of equivalents at which it starts, mm.
    """

    start: Array

    def search(
        self, image: npt.NDArray[np.uint8], moved: Array, sure: npt.NDArray[np.bool_]
    ) -> Found:
        """Return the contacts near the start; pins in doubt are looked for where they put them."""
        weight = self.trusted(sure)
        best = self.solve(moved, self.start, weight)
        if not sure.all():
            moved, sure, best = self.retrack(image, moved, sure, best)
            weight = self.weight * np.tile(sure, 2)
        return self.finish(moved, best.contacts, weight)


class Refinement:
    """The fit of a model's contacts, with what it needs: fields, weights of the pins, and laws.

    Attributes:
        seen: The sensors, whose pins lie on one layout.
        family: Fields of single presses.
        weight: (Q,) 1 / variance of the displacements, 1 / px^2.
        spread: Standard deviations of refined contacts.
    """

    def __init__(
        self, seen: AlignedSensors, family: FieldFamily, weight: Array, spread: Spread
    ) -> None:
        self.seen, self.family, self.weight, self.spread = seen, family, weight, spread
        clue = drag_clue(family.field, len(seen.first.rest))
        self._law, self._inverse = nominal_law(clue), nominal_inverse_law(clue)
        self.show([], [])

    @classmethod
    def learn(
        cls,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        validation: tuple[Sequence[Frame], Sequence[Answer]],
    ) -> Refinement:
        """Learn the fields from the single presses, and the noise of the pins on others.

        Raises:
            UserError: There are no fields: frames without pins or without a frame at rest, plates,
                or fewer than twenty single presses; or the depth of a contact is not known.
        """
        if not all(isinstance(answer, Contacts) and answer.knows_depth for answer in truth):
            raise UserError(
                "refinement needs contacts whose depth is known, and these frames are labelled "
                "otherwise."
            )
        seen = AlignedSensors.of(frames)
        family = SinglePresses.of(seen, frames, truth).learn_family()
        tested = SinglePresses.of(seen, *validation)
        weight = noise_weight(tested.unexplained(family))
        refinement = cls(seen, family, weight, nominal_spread())
        refinement._learn_spread(tested)
        return refinement

    def _learn_spread(self, presses: SinglePresses) -> None:
        """Learn the deviations of one contact from presses whose contact is known."""
        causes, errors = [], []
        for frame, contact in zip(
            track(self.seen, presses.frames), presses.contacts[:, None], strict=True
        ):
            _, refined, cause = self._fit(frame, contact)
            causes.append(cause)
            errors.append(refined - contact)
        floor = not len(self.family.covariance)
        self.spread = self.spread.with_group(1, causes, errors, floor=floor)

    def show(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        """Learn the numbers of each sensor from its labelled single presses."""
        presses = SinglePresses.of(self.seen, frames, truth)
        self._shown = {number: labelled for number, *labelled in presses.by_sensor()}
        self._fields = lru_cache(_KEPT)(self._field_of)

    def __call__(self, frames: Sequence[Frame], answers: Sequence[Answer | None]) -> list[Answer]:
        """Return the refined contacts of frames."""
        refined = [Contacts.none() for _ in frames]
        rows = [k for k, each in enumerate(answers) if isinstance(each, Contacts) and len(each)]
        tracked = track(self.seen, [frames[row] for row in rows])
        # Sensor by sensor, because only the fields of a few sensors stay in memory.
        for row, frame in sorted(zip(rows, tracked, strict=True), key=lambda pair: pair[1].sensor):
            answer = answers[row]
            assert isinstance(answer, Contacts)  # noqa: S101 - rows are those of contacts
            refined[row] = self._refine(frame, answer)
        return list(refined)

    def _field_of(self, sensor: int) -> Field:
        shown = self._shown.get(sensor, (None, None))
        return self.family.of_sensor(self.seen[sensor].layout_clues, *shown)

    def _refine(self, frame: TrackedFrame, answer: Contacts) -> Contacts:
        """Return the contacts that fields explain; the one that explains least is dropped first."""
        given = np.column_stack([answer.xy, answer.depth])
        kept = np.sort(np.argsort(-answer.score, kind="stable")[:_MOST])
        while len(kept):
            start = given[kept]
            found, contacts, causes = self._fit(frame, start)
            strange = _strangeness(start, contacts, found.share)
            if not strange.any():
                std = self.spread.std(causes)
                return Contacts(contacts[:, :2], contacts[:, 2], answer.score[kept], std)
            kept = np.delete(kept, np.argmax(strange))
        return Contacts.none()

    def _fit(self, frame: TrackedFrame, start: Array) -> tuple[Found, Array, ErrorCauses]:
        """Return the fit from (K, 3) contacts, mm, where these end, and the causes of errors."""
        fit = LocalFit(
            field=self._fields(frame.sensor),
            pins=self.seen[frame.sensor],
            weight=self.weight,
            gain=_GAIN,
            motions=np.empty((0, len(self.weight))),
            start=self._law.equivalents(start[None]),
        )
        found = fit.find(frame.image, frame.moved, frame.sure)
        equivalents = found.solution.contacts
        shift = self._inverse.shift(equivalents)[0]
        varies = len(self.family.covariance) > 0
        causes = ErrorCauses.of_fit(found, self.weight, shift, varies)
        return found, equivalents[0] + shift, causes


def _strangeness(start: Array, end: Array, share: Array) -> Array:
    """Return (K,) how far contacts are beyond a limit; 0: within all of them.

    Args:
        start: (K, 3) x, y and depth that the model answered, mm.
        end: (K, 3) after the fit, mm.
        share: (K,) shares of the misfit that they explain.
    """
    moved = np.hypot(*(end - start)[:, :2].T)
    deeper = end[:, 2] / np.maximum(start[:, 2], 1e-6)
    within = (moved <= REACH_MM) & (deeper >= DEPTHS[0]) & (deeper <= DEPTHS[1]) & (share >= SHARE)
    strangeness: Array = np.where(within, 0.0, 2.0 - share.clip(0, 1))
    return strangeness
