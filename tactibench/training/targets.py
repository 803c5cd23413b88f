"""Targets to learn: contacts and heatmaps of the truth, plate poses from them, and errors in mm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactibench.contacts import Answer, Contacts, Grid, PlatePose
from tactibench.errors import UserError
from tactibench.geometry import DOME_RADIUS_MM, plate_from_contacts
from tactibench.plugins import Encoder

_SHALLOWEST_MM = 0.5
"""Smallest depth of a plate on the map: its depth label may start anywhere (a robot's z)."""


@dataclass(frozen=True)
class PlateScale:
    """The shift from a plate's depth label to the depth shown on the map.

    Attributes:
        offset: The shift, mm.
    """

    offset: float = 0.0

    @classmethod
    def of(cls, truth: Sequence[Answer], max_depth: float) -> PlateScale:
        """Return the scale of training frames, which shifts labels that start below 0.5 mm.

        Args:
            truth: True answers to the training frames.
            max_depth: Largest depth on the map, mm.

        Raises:
            UserError: The shifted labels exceed ``max_depth``.
        """
        depths = [pose.depth for pose in truth if isinstance(pose, PlatePose)]
        if not depths:
            return cls()
        offset = max(0.0, _SHALLOWEST_MM - min(depths))
        if max(depths) + offset > max_depth:
            raise UserError(
                f"the plate depths of the training frames span {min(depths):.2f} to "
                f"{max(depths):.2f} mm, but a heatmap shows at most {max_depth - _SHALLOWEST_MM:g} "
                "mm of range; leave the deepest out or use a model without heatmaps (cnn)."
            )
        return cls(offset)

    def contacts(self, answer: Answer) -> Contacts:
        """Return the contact of a plate, at x = 20 mm * sin(tilt); contacts are not changed."""
        if isinstance(answer, Contacts):
            return answer
        x = DOME_RADIUS_MM * math.sin(math.radians(answer.tilt))
        return Contacts.truth([[x, 0.0]], [answer.depth + self.offset])

    def plate(self, contacts: Contacts) -> PlatePose | None:
        """Return the plate pose of the best contact; None without a contact."""
        pose = plate_from_contacts(contacts)
        return None if pose is None else PlatePose(pose.depth - self.offset, pose.tilt)


def heatmaps(encoder: Encoder, truth: Sequence[Contacts], grid: Grid) -> np.ndarray:
    """Return (N, C, H, W) float16 maps of N frames, encoded in one call where the encoder can."""
    if not truth:
        return np.empty((0, encoder.channels, *grid.shape), dtype=np.float16)
    return np.asarray(encoder.encode_batch(truth, grid)).astype(np.float16)


def position_error_mm(predicted: Sequence[Answer | None], truth: Sequence[Answer]) -> float | None:
    """Return the mean distance of true contacts (or plates) to the nearest predicted one, mm.

    Frames without a prediction are left out; it is None when no frame is left.
    """
    distances = [
        float(np.linalg.norm(xy - true, axis=1).min())
        for xy, contacts in zip(map(_positions, predicted), map(_positions, truth), strict=True)
        if len(xy)
        for true in contacts
    ]
    return float(np.mean(distances)) if distances else None


def _positions(answer: Answer | None) -> np.ndarray:
    """Return the places of contacts, or where a plate touches the dome, (K, 2) mm.

    There are no rows for None.
    """
    if answer is None:
        return np.empty((0, 2))
    if isinstance(answer, PlatePose):
        return np.array([[DOME_RADIUS_MM * math.sin(math.radians(answer.tilt)), 0.0]])
    return answer.xy
