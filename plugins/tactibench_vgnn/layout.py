"""The layout of a sensor's pins, learned from training frames: where in mm each of them stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, UserError
from tactibench.markers import Tracks, pin_graph

Array = npt.NDArray[np.float64]

_SHARPNESS = 3
"""Power of a pin's displacement with which it weighs in the centre of a press: at 3 the centre
tells the contact best (0.21 mm on the default sensor; 0.29 at 1, 0.25 at 4)."""
_REACH = 2.5
"""A pin may report contacts this many times farther away than any is from its nearest pin."""
_SMALLEST_AREA = 1e-3
"""Smallest area of a Voronoi cell, as a share of the median: pins on one spot have none."""


@dataclass(frozen=True, eq=False)
class PinLayout:
    """Pins of a sensor at rest, and the scales of their motion.

    rest: (P, 2) px. radius: (P,) px, of the pins' pictures, 0 where unknown. affine: (3, 2),
    [x, y, 1] px -> mm.
    moved_px, grown, swollen: rms displacement, px, and rms logarithms of the change of a Voronoi
    cell's area and of a picture's radius over the training frames. reach_mm: how far from a pin the
    contacts may lie that it reports.
    """

    rest: Array
    radius: Array
    affine: Array
    moved_px: float = 1.0
    grown: float = 1.0
    swollen: float = 1.0
    reach_mm: float = 1.0

    @classmethod
    def learn(cls, tracks: Tracks, rest: Tracks, truth: Sequence[Contacts]) -> Self:
        """Fit the scales to tracked frames and their contacts (to single ones alone: affine).

        rest: the one frame of the sensor at rest.
        """
        pins = rest.xy[0]
        radius = np.nan_to_num(rest.radius[0])
        layout = cls(pins, radius, _affine(tracks.xy, pins, truth))
        contacts = np.concatenate([contacts.xy for contacts in truth])
        away = np.linalg.norm(contacts[:, None] - layout.anchors, axis=-1).min(axis=1)
        areas = np.stack([pin_graph(xy).area for xy in tracks.xy])
        return replace(
            layout,
            moved_px=_rms(tracks.xy - pins),
            grown=_rms(layout.growth(areas)),
            swollen=_rms(layout.swelling(np.where(tracks.seen, tracks.radius, np.nan))),
            reach_mm=max(1.0, _REACH * float(away.max())),
        )

    @property
    def anchors(self) -> Array:
        """(P, 2) places of the pins at rest, mm: where a press on each is centred."""
        places: Array = np.c_[self.rest, np.ones(len(self.rest))] @ self.affine
        return places

    def growth(self, areas: Array) -> Array:
        """Return (N, P) the logarithm of Voronoi areas (N, P) px^2 over those at rest."""
        usual = pin_graph(self.rest).area
        least = _SMALLEST_AREA * float(np.median(usual))
        ratio: Array = np.log(np.maximum(areas, least) / np.maximum(usual, least))
        return ratio

    def swelling(self, radius: Array) -> Array:
        """Return (N, P) the logarithm of radii (N, P) px over those at rest; 0 where unknown."""
        both = (radius > 0) & (self.radius > 0)  # false for NaN
        ratio: Array = np.where(both, radius, 1.0) / np.where(both, self.radius, 1.0)
        return np.asarray(np.log(ratio), dtype=np.float64)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values from which ``from_json`` makes the same layout."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Return the layout of ``to_json``."""
        arrays = {name: np.array(values[name]) for name in ("rest", "radius", "affine")}
        return cls(**(values | arrays))


def _affine(xy: Array, rest: Array, truth: Sequence[Contacts]) -> Array:
    """(3, 2) least-squares map from the centre of a single press, px, to its contact, mm."""
    single = np.array([len(contacts) == 1 for contacts in truth])
    centre, moved = press_centres(xy[single], rest)
    if np.count_nonzero(moved) < 3:
        raise UserError(
            f"model 'vgnn' needs at least 3 training frames in which one contact moves pins, but "
            f"has {np.count_nonzero(moved)}; raise the training count."
        )
    contact = np.concatenate([contacts.xy for contacts in truth if len(contacts) == 1])
    places = np.c_[centre[moved], np.ones(int(moved.sum()))]
    return np.asarray(np.linalg.lstsq(places, contact[moved], rcond=None)[0], dtype=np.float64)


def press_centres(xy: Array, rest: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return (N, 2) mean places of the pins at rest, weighted by their displacement cubed, px.

    Also (N,) whether any pin moved; the centre is the middle of the layout where none did.
    """
    weight = np.linalg.norm(xy - rest, axis=-1) ** _SHARPNESS
    total = weight.sum(axis=1, keepdims=True)
    moved = total[:, 0] > 0
    weight = np.where(moved[:, None], weight / np.where(total > 0, total, 1.0), 1 / len(rest))
    return np.asarray(weight @ rest, dtype=np.float64), moved


def _rms(values: Array) -> float:
    """Root mean square; 1 where nothing ever changes."""
    rms = float(np.sqrt(np.square(values).mean())) if values.size else 0.0
    return rms if rms > 1e-6 else 1.0
