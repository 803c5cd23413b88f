"""Frames of two sensors: one trains, a recording of the other is tested on.

Some labelled frames of the tested sensor come from its training part. Frames to which a simulated
sensor was fitted are neither tested on nor shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from tactibench.errors import UserError
from tactibench.frames.drawn_presses import SensorFrames
from tactibench.frames.recorded import Recording, Sets, divide, training_sets
from tactibench.frames.source import (
    FEW_SHOT,
    QUICK_FIT,
    QUICK_VALIDATION,
    FramePlan,
    FrameRequest,
    FrameSet,
    FrameSource,
    spread,
)
from tactibench.protocols import FIT, RECORDED, VALIDATION, PressSplit, draw_plates, draw_shots

PLATES = "plates"
MOST_AWAY_DEG = 45.0
"""Largest angle between the directions on the frame in which a positive tilt moves the contact, in
training and in test; it is 1 deg in the public recordings."""


class TransferFrames(FrameSource):
    """Training frames of one sensor; test frames, and a few labelled ones, of another."""

    def __init__(self, request: FrameRequest) -> None:
        super().__init__(request)
        self.simulated: SensorFrames | None = None
        if not request.sensor.spec.needs_data:
            self.simulated = SensorFrames(self.spec, request.sensor, request.cache)
        self.target = Recording.open(self.spec, request.tested, request.test_data, indentation=True)
        if self.simulated is not None:
            self._refuse_other_direction()

    def plan(self) -> FramePlan:
        """Return training frames of one sensor, test and labelled frames of the other.

        Raises:
            UserError: The recording leaves too few presses to be shown with labels.
        """
        if self.simulated is None:
            source = Recording.open(
                self.spec, self.request.sensor, self.request.data, indentation=True
            )
            fit, validation = training_sets(self.request, source, divide(self.spec, source))
            identity, signal = source.identity, source.sensor.signal
        else:
            fit, validation = self._pressed_sets(self.simulated)
            identity, signal = self.simulated.identity, self.simulated.sensor.signal
        return FramePlan(
            source=self,
            fit=fit,
            validation=validation,
            test=self.test_frames(),
            few_shot=self._labelled_frames(),
            sensor_identity=identity,
            signals=(signal, self.target.sensor.signal),
            test_identity=self.target.identity,
            calibrated=len(self._calibrated),
        )

    def _refuse_other_direction(self) -> None:
        """Raise UserError where a positive tilt moves the contact otherwise than in simulation."""
        fit = self.target.identity["describe"].get("label_fit")
        plates = self.spec.plates
        if fit is None or plates is None:
            return
        away = (fit["lean_deg"] - plates.yaw_deg + 180) % 360 - 180
        if abs(away) > MOST_AWAY_DEG:
            raise UserError(
                f"a positive tilt label of {self.request.test_data} moves the contact towards "
                f"{fit['lean_deg']:.0f} deg of the frame (0: right, 90: down), but simulated "
                f"plates towards {plates.yaw_deg:g}; turn the frames, or change the sign of the "
                "tilt label."
            )

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the test part of the recording, or as many frames as the request asks for."""
        rows = spread(self._usable(self._division.test), self.request.test_count)
        return (self.target.frame_set("test", RECORDED, rows),)

    def _labelled_frames(self) -> FrameSet:
        pool = self._usable(self._division.fit)
        rows = [pool[number] for number in draw_shots(self.spec, len(pool))]
        assert self.spec.transfer is not None  # noqa: S101 - the source of such protocols
        most = max(self.spec.transfer.shots)
        if len(rows) < most:
            raise UserError(
                f"{self.request.test_data} leaves {len(pool):,} presses besides its test part, but "
                f"protocol {self.spec.id!r} gives a model up to {most} labelled ones; record more "
                "presses."
            )
        return self.target.frame_set("few-shot", FEW_SHOT, rows)

    @cached_property
    def _division(self) -> PressSplit:
        return divide(self.spec, self.target)

    @cached_property
    def _calibrated(self) -> frozenset[str]:
        """Names of the target's frames to which the simulated sensor was fitted."""
        if self.simulated is None:
            return frozenset()
        digest = self.target.identity["describe"].get("sha256", "")
        fitted = self.simulated.sensor.calibrated_on().get(digest, ())
        return frozenset(fitted) & frozenset(self.target.names)

    def _usable(self, rows: Sequence[int]) -> list[int]:
        return [row for row in rows if self.target.names[row] not in self._calibrated]

    def _pressed_sets(self, frames: SensorFrames) -> tuple[Sets, Sets]:
        """Return the plate presses that the sensor makes, to train and to validate.

        Each is drawn on its own, so that the last ones can validate.
        """
        plates, recorded = self.spec.plates, self.spec.recorded
        assert plates is not None  # noqa: S101 - the test sensor's check asks for it
        assert recorded is not None  # noqa: S101 - with [transfer] it is there
        scenes = draw_plates(frames.pressed, plates).scenes
        end = len(scenes) - round(recorded.validation_share * len(scenes))
        fit, validation = range(self.request.training_count(end)), range(end, len(scenes))
        if self.request.quick:
            fit, validation = fit[:QUICK_FIT], validation[:QUICK_VALIDATION]
        roles = (("fit", fit, FIT), ("validation", validation, VALIDATION))
        fit_set, validation_set = (
            frames.frame_set(
                role,
                PLATES,
                [scenes[row] for row in rows],
                [f"{PLATES}-{row}" for row in rows],
                part,
                stream=plates.stream,
            )
            for role, rows, part in roles
        )
        return (fit_set,), (validation_set,)
