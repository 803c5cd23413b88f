"""The layout of a sensor's pins, learned from training frames: the place of each pin in mm."""

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
"""Power of a pin's displacement that is its weight in the centre of a press: at 3 the centre tells
the contact best (0.21 mm on the default sensor; 0.29 mm at 1, 0.25 mm at 4)."""
_REACH = 2.5
"""A pin may report contacts this many times farther away than any contact is from its nearest
pin."""
_SMALLEST_AREA = 1e-3
"""Smallest area of a Voronoi cell, as a share of the median: pins on one spot have none."""


@dataclass(frozen=True, eq=False)
class PinLayout:
    """Pins of a sensor at rest, and the scales of their motion over the training frames.

    Attributes:
        rest: (P, 2) places of the pins at rest, px.
        radius: (P,) radii of the pins' pictures at rest, px; 0 where unknown.
        affine: (3, 2) map from [x, y, 1], px, to mm.
        moved_px: Rms displacement of a pin.
        grown: Rms logarithm of the change of a Voronoi cell's area.
        swollen: Rms logarithm of the change of a picture's radius.
        reach_mm: Greatest distance from a pin of the contacts that it reports.
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
        """Return the layout that is fitted to tracked frames; ``affine`` to single contacts alone.

        Args:
            tracks: Tracked pins of the frames.
            rest: Tracked pins of the one frame of the sensor at rest.
            truth: Contacts of the frames.

        Raises:
            UserError: Fewer than three frames have a single contact that moves pins.
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
        """Places (P, 2) of the pins at rest, mm: where a press on each is centred."""
        places: Array = np.c_[self.rest, np.ones(len(self.rest))] @ self.affine
        return places

    def growth(self, areas: Array) -> Array:
        """Return the logarithm (N, P) of Voronoi areas (N, P), px^2, over those at rest."""
        usual = pin_graph(self.rest).area
        least = _SMALLEST_AREA * float(np.median(usual))
        ratio: Array = np.log(np.maximum(areas, least) / np.maximum(usual, least))
        return ratio

    def swelling(self, radius: Array) -> Array:
        """Return the logarithm (N, P) of radii (N, P), px, over those at rest; 0 where unknown."""
        measured = (radius > 0) & (self.radius > 0)  # false for NaN
        ratio: Array = np.where(measured, radius, 1.0) / np.where(measured, self.radius, 1.0)
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
    """Return the least-squares map (3, 2) from the centre of a press, px, to its contact, mm.

    Only frames with a single contact are used.

    Raises:
        UserError: Fewer than three frames have a single contact that moves pins.
    """
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
    """Return the centres (N, 2) of presses, px, and whether any pin moved (N,).

    A centre is the mean place of the pins at rest, weighted by their displacement cubed; it is the
    middle of the layout where no pin moved.

    Args:
        xy: (N, P, 2) places of the pins, px.
        rest: (P, 2) places of the pins at rest, px.
    """
    weight = np.linalg.norm(xy - rest, axis=-1) ** _SHARPNESS
    total = weight.sum(axis=1, keepdims=True)
    moved = total[:, 0] > 0
    weight = np.where(moved[:, None], weight / np.where(total > 0, total, 1.0), 1 / len(rest))
    return np.asarray(weight @ rest, dtype=np.float64), moved


def _rms(values: Array) -> float:
    """Return the root mean square of values; 1 where nothing ever changes."""
    rms = float(np.sqrt(np.square(values).mean())) if values.size else 0.0
    return rms if rms > 1e-6 else 1.0
