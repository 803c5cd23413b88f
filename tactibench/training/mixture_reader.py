"""Contacts read from the probabilities, means and deviations of anchors, without torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, FloatArray

FAINT = 0.01
"""Probability below which an anchor is ignored; dozens of such anchors do not make a contact."""


@dataclass(frozen=True)
class MixtureReader:
    """A reader of contacts, best first and each with its std, from anchors.

    Anchors whose means lie within ``merge_mm`` of that of the most probable anchor report the same
    contact: their probabilities add up (to the contact's score, at most 1), and the contact has the
    mean and the standard deviation of their mixture. The remaining anchors are read in the same
    way.

    Attributes:
        threshold: Score below which contacts are dropped.
        merge_mm: Distance within which anchors report the same contact, mm.
        max_count: Most contacts of a frame; the best are kept.
    """

    threshold: float = 0.5
    merge_mm: float = 2.0
    max_count: int = 6

    def read(
        self,
        count: int,
        frame: npt.NDArray[np.intp],
        p: FloatArray,
        mean: FloatArray,
        std: FloatArray,
    ) -> list[Contacts]:
        """Return the contacts of ``count`` frames.

        Args:
            count: Number of frames.
            frame: (K,) the frame of every anchor, sorted.
            p: (K,) probabilities.
            mean: (K, 3) x, y and depth, mm.
            std: (K, 3) their standard deviations, mm.

        Raises:
            ValueError: A value is not finite.
        """
        if not (np.isfinite(p).all() and np.isfinite(mean).all() and np.isfinite(std).all()):
            raise ValueError("the mixture holds values that are not finite")
        left, mean, std = _padded(count, frame, p, mean, std)
        contacts: list[list[FloatArray]] = [[] for _ in range(count)]
        frames = np.arange(count)
        while (possible := left.sum(axis=1) >= self.threshold).any():
            first = mean[frames, left.argmax(axis=1), None, :2]
            near = np.square(mean[:, :, :2] - first).sum(axis=-1) <= self.merge_mm**2
            rows = _moments(np.where(near, left, 0.0), mean, std)
            for row in np.flatnonzero(possible & (rows[:, 0] >= self.threshold)).tolist():
                contacts[row].append(rows[row])
            left[near] = 0.0
        return [_contacts(rows).top(self.max_count) for rows in contacts]


def read_mixture(
    probability: npt.ArrayLike,
    mean: npt.ArrayLike,
    std: npt.ArrayLike,
    *,
    threshold: float = 0.5,
    merge_mm: float = 2.0,
    max_count: int = 6,
) -> list[Contacts]:
    """Return the contacts of every frame as ``MixtureReader`` reads them.

    Args:
        probability: (N, M).
        mean: (N, M, 3) x, y and depth, mm.
        std: (N, M, 3) their standard deviations, mm.
        threshold: Score below which contacts are dropped.
        merge_mm: Distance within which anchors report the same contact, mm.
        max_count: Most contacts of a frame.

    Raises:
        ValueError: Shapes do not fit, or a value is not finite.
    """
    p, mu, sigma = (np.asarray(values, dtype=np.float64) for values in (probability, mean, std))
    if p.ndim != 2 or mu.shape != (*p.shape, 3) or sigma.shape != mu.shape:
        raise ValueError(
            f"a mixture has probability (N, M), mean and std (N, M, 3), but they have shapes "
            f"{p.shape}, {mu.shape} and {sigma.shape}"
        )
    anchors = np.nonzero(~(p < FAINT))  # NaN passes, so that ``read`` refuses it
    reader = MixtureReader(threshold, merge_mm, max_count)
    return reader.read(len(p), anchors[0], p[anchors], mu[anchors], sigma[anchors])


def _padded(
    count: int, frame: npt.NDArray[np.intp], *columns: FloatArray
) -> tuple[FloatArray, ...]:
    """Return the columns frame by frame, (N, most, ...), with zeros behind a frame's anchors."""
    rank = np.arange(len(frame)) - np.searchsorted(frame, frame)
    most = int(rank.max(initial=-1)) + 1
    padded = []
    for column in columns:
        rows = np.zeros((count, most, *column.shape[1:]))
        rows[frame, rank] = column
        padded.append(rows)
    return tuple(padded)


def _moments(p: FloatArray, mean: FloatArray, std: FloatArray) -> FloatArray:
    """Return total probability, mean and standard deviation of each frame's mixture, (N, 7)."""
    total = p.sum(axis=1)
    share = (p / np.maximum(total, FAINT)[:, None])[:, :, None]
    centre = (share * mean).sum(axis=1)
    spread = (share * (np.square(std) + np.square(mean - centre[:, None]))).sum(axis=1)
    return np.column_stack([total, centre, np.sqrt(spread)])


def _contacts(rows: list[FloatArray]) -> Contacts:
    if not rows:
        return Contacts.none()
    score, x, y, depth, *std = np.stack(rows, axis=1)
    xy = np.stack([x, y], axis=1)
    return Contacts(xy, depth, score.clip(0.0, 1.0), np.stack(std, axis=1))
