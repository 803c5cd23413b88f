"""Frames as displacements of pins or as channels, and their principal components.

Transfer to another sensor: fields that differ smoothly, and a correction of answers.

A simulated and a real sensor, or two of one make, differ even on the common lattice: the camera
sits askew, the skin yields unevenly, the plate drags it otherwise. No list of causes is complete,
so a model is shown every training field v with a smooth random difference e in proportion to it
(``Differences``):

    v + rms(v) e(x),    cov(e(x), e(x')) = sum over l of share^2 exp(-|x - x'|^2 / (2 l^2))

It then relies on what many pins say together. Without it, fields that no training press has look
far from all of them, and answers fall back to the middle of the range.

A few labelled frames of the other sensor correct a trained model's answers (``Correction``). The
model sees the frames as features h (its last hidden layer, or its kernel). The correction is a
ridge regression of the answers' errors,

    y - f(x) = c + w h(x),    |w|^2 ridge + sum of squares least,

which vanishes where the ridge is large. The ridge is chosen for every target alone: the largest one
whose mean absolute error of leaving one frame out is within one standard error of the least
(Breiman et al. 1984), so that ten frames correct little that they do not show clearly. A ridge
regression has these errors in closed form: with G = (K + ridge I)^-1 and alpha = G r the mean
absolute error is mean |alpha_i / G_ii| (Rasmussen and Williams 2006, eq. 5.12).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, Frame, UserError, channel_vectors, holds_channels
from tactibench.markers import BySensor, PinTracker, common_lattice, common_view, rest_images
from tactibench.training import answer_vectors, answers_from_vectors, pack_image, unpack_image

Array = npt.NDArray[np.float64]

RIDGES = tuple(float(ridge) for ridge in 10.0 ** np.arange(-4, 3.1, 0.5))
"""Ridges to try, as shares of the mean diagonal of the features' kernel, which is 1."""


LENGTHS = (0.15, 0.3, 0.6, 1.2)
"""Lengths of the differences, in units of the layout: from the pitch of the pins to the whole
sensor."""
SHARE = 0.06
"""Share of a field that differs at each length, 0.12 together. Simulated plates of a calibrated
sensor differ from the real ones by 0.13 to 0.18. It was chosen on the presses of the
calibrations."""
_JITTER = 1e-6
"""Addition to the covariance's diagonal, because long lengths make the covariance singular."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Smooth random differences of fields on L points.

    Attributes:
        factor: (L, L) lower triangle whose product with its transpose is the covariance, of x and
            of y alike, for fields of unit root mean square.
    """

    factor: Array

    @classmethod
    def on(cls, points: Array, share: float = SHARE) -> Self:
        """Return the differences on points.

        Args:
            points: (L, 2) points, units of the layout.
            share: Share of a field that differs at each length.
        """
        square = np.square(points[:, None] - points).sum(axis=-1)
        covariance = sum(np.exp(-0.5 * square / length**2) for length in LENGTHS)
        return cls(share * np.linalg.cholesky(covariance + _JITTER * np.eye(len(points))))

    def add(self, moved: Array, rng: np.random.Generator) -> Array:
        """Return fields with a random difference in each.

        Args:
            moved: (N, 2 L) fields, x of all points before y.
            rng: Generator that draws the differences.
        """
        white = rng.standard_normal((2, len(moved), len(self.factor)))
        rms = np.sqrt(np.square(moved).mean(axis=1, keepdims=True))
        return np.asarray(moved + rms * np.concatenate([*(white @ self.factor.T)], axis=1))

    def of_components(self, basis: Array) -> Array:
        """Return the factor (K, K) of the differences in the components of a basis (2 L, K)."""
        half = len(self.factor)
        parts = np.concatenate([self.factor.T @ basis[:half], self.factor.T @ basis[half:]])
        # R of Q R has the covariance of the parts: R' R = parts' parts.
        triangle: Array = np.linalg.qr(parts)[1]
        return np.asarray(triangle.T)


@dataclass(frozen=True, eq=False)
class Correction:
    """A correction of T targets by n labelled frames.

    Attributes:
        features: (n, F) features of the frames, centred and scaled.
        alpha: (n, T) weights of the frames.
        middle: (F,) mean of the features.
        scale: Root mean square of the centred features.
        ridges: Ridge of every target.
    """

    features: Array
    alpha: Array
    middle: Array
    scale: float
    ridges: tuple[float, ...]

    @classmethod
    def fit(cls, features: Array, lacking: Array) -> Self:
        """Return the correction for labelled frames.

        Args:
            features: (n, F) features of the frames, n > 0.
            lacking: (n, T) targets less answers.
        """
        middle = features.mean(axis=0)
        centred = features - middle
        scale = max(float(np.sqrt(np.square(centred).sum(axis=1).mean())), 1e-12)
        places = centred / scale
        values, vectors = np.linalg.eigh(1.0 + places @ places.T)
        chosen = [_choose_ridge(values, vectors, column) for column in lacking.T]
        alpha = np.stack([alpha for _, _, alpha in chosen], axis=1)
        return cls(places, alpha, middle, scale, tuple(ridge for _, ridge, _ in chosen))

    def __call__(self, features: Array) -> Array:
        """Return (N, T) numbers to add to the answers of features (N, F)."""
        places = (features - self.middle) / self.scale
        return np.asarray((1.0 + places @ self.features.T) @ self.alpha, dtype=np.float64)


def _choose_ridge(values: Array, vectors: Array, lacking: Array) -> tuple[float, float, Array]:
    """Return error, ridge and alpha of the largest ridge that is about as good as the best.

    Args:
        values: (n,) eigenvalues of the frames' kernel.
        vectors: (n, n) eigenvectors of the kernel, one a column.
        lacking: (n,) one target less its answers.
    """
    candidates, scatters = [], []
    for ridge in RIDGES:
        inverse = (vectors / (np.maximum(values, 0.0) + ridge)) @ vectors.T
        alpha = inverse @ lacking
        errors = np.abs(alpha / np.diag(inverse))
        candidates.append((float(errors.mean()), ridge, alpha))
        scatters.append(float(errors.std() / np.sqrt(len(errors))))
    best = min(range(len(RIDGES)), key=lambda number: candidates[number][0])
    most = candidates[best][0] + scatters[best]
    return max((c for c in candidates if c[0] <= most), key=lambda candidate: candidate[1])


Image = npt.NDArray[np.uint8]

LATTICE = common_lattice()
_FAINTEST = 0.01
"""Quantile of the training presses that stands for the faintest press, which may be mislabelled."""
_SHARE = 0.5
"""Share of the way from a sensor at rest to the faintest training press at which a contact
begins."""
FAINT = 0.01
"""Least size of a vector of channels that has a direction, in deviations of the training frames."""
_LEAST = 1e-6
"""Spreads below this share of the largest spread are rounding."""


class Reader(ABC):
    """A reader of frames as vectors: displacements of pins, or channels where there is no camera.

    Attributes:
        size: Count of numbers in a vector.
        noise: Deviation of the noise that training adds to each number, in the vector's own unit.
        polar: Whether a vector's direction and size say more than its numbers.
    """

    size: int
    noise: float
    polar: bool = False

    @abstractmethod
    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return the vectors (N, size) of frames."""

    @abstractmethod
    def saved(self) -> dict[str, Any]:
        """Return what ``restored_reader`` needs, as JSON values."""


class OwnPins(Reader):
    """Displacements of one sensor's P pins, px: x of all pins before y of all."""

    noise = 0.25  # px: twice the uncertainty of the centroid of a black and white pin

    def __init__(self, pins: PinTracker) -> None:
        self.pins = pins
        self.size = 2 * len(pins.rest)

    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return the displacements (N, 2 P), px."""
        return self.pins.displacements(self.pins.images(frames))

    def saved(self) -> dict[str, Any]:
        """Return the gray rest image of the sensor that the model was trained on."""
        return {"rest": pack_image(self.pins.rest_image)}


class LatticePins(OwnPins):
    """Displacements of any sensor's pins on the P points of the common lattice.

    They are in units of the layout. The rest images of the frames tell which sensor it is.
    """

    noise = 0.003
    """Noise of single places, in units of the layout, where sensors are seen on the lattice."""

    def __init__(self, pins: PinTracker) -> None:
        super().__init__(pins)
        self.size = 2 * len(LATTICE)
        self._sensors = BySensor(lambda pins: (pins, common_view(pins.rest, LATTICE)))

    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return the displacements (N, 2 P), units of the layout.

        Raises:
            UserError: A frame has no rest image, or one that shows no layout.
        """
        out = np.empty((len(frames), self.size))
        for number, rows in self._sensors.rows(frames).items():
            pins, view = self._sensors[number]
            out[rows] = view(pins.displacements(pins.images([frames[row] for row in rows])))
        return out

    def saved(self) -> dict[str, Any]:
        """Return the rest image, and the fact that vectors are on the lattice."""
        return {**super().saved(), "lattice": True}


class Channels(Reader):
    """Channels in units of their rms deviation over the training frames, less those at rest.

    Attributes:
        size: Number of channels C.
        scale: Rms deviation, one for all channels: channels of one kind differ in size because some
            say more. It is 1 where no channel ever changes.
        minus_rest: Whether all training frames had a rest frame, which was taken off.
    """

    polar = True

    def __init__(self, size: int, scale: float, minus_rest: bool) -> None:
        self.size = size
        self.scale = scale
        self.minus_rest = minus_rest

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> Self:
        """Return the reader for training frames."""
        minus_rest = all(frame.rest is not None for frame in frames)
        vectors = channel_vectors(frames, minus_rest=minus_rest)
        scale = float(np.sqrt(vectors.var(axis=0, dtype=np.float64).mean()))
        return cls(vectors.shape[1], scale if scale > 0 else 1.0, minus_rest)

    def displacements(self, frames: Sequence[Frame]) -> Array:
        """Return the channels (N, C), in units of ``scale``.

        Raises:
            UserError: The frames have other channels than the training frames, or lack a rest
                frame, or hold a value that is not finite.
        """
        vectors = channel_vectors(frames, minus_rest=self.minus_rest, count=self.size)
        return vectors.astype(np.float64) / self.scale

    def saved(self) -> dict[str, Any]:
        """Return count and units of the channels."""
        facts = {"size": self.size, "scale": self.scale, "minus_rest": self.minus_rest}
        return {"channels": facts}


def find_reader(frames: Sequence[Frame], targets: Array, transfers: bool) -> Reader:
    """Return the reader of training frames.

    Pins are those of the first rest image, or else of the frame that is pressed least. Frames of
    several sensor instances are seen on the common lattice, each from its own rest image.

    Args:
        frames: Frames of one sensor, or of several instances of it.
        targets: (N, T) targets: the depth of a plate is the first, that of a contact the last.
        transfers: Whether other sensors' frames will be shown, too.

    Raises:
        UserError: Frames of channels are to be read for transfer to other sensors.
    """
    if holds_channels(frames):
        if transfers:
            raise UserError(
                "channels of one sensor say nothing of another's; train and test on one sensor."
            )
        return Channels.of(frames)
    depth = targets[:, 0] if targets.shape[1] == 2 else targets[:, 2]
    if len(rest_images(frames)) > 1:
        first = next(frame for frame in frames if frame.rest is not None)
        return LatticePins(PinTracker.of([first]))
    pins = PinTracker.of(frames, otherwise=frames[int(np.argmin(depth))])
    return LatticePins(pins) if transfers else OwnPins(pins)


def known_targets(
    frames: Sequence[Frame], truth: Sequence[Answer], answer: str, model: str
) -> Array:
    """Return the targets (N, T) of frames, see ``answer_vectors``; channels may tell the force."""
    force = answer == "contacts" and holds_channels(frames)
    return answer_vectors(truth, answer, model, force=force)


def restored_reader(extra: Mapping[str, Any]) -> Reader | None:
    """Return the reader that was saved; None where there was none."""
    if channels := extra.get("channels"):
        return Channels(**channels)
    if extra["rest"] is None:
        return None
    pins = PinTracker(unpack_image(extra["rest"]))
    return LatticePins(pins) if "lattice" in extra else OwnPins(pins)


def displacements(reader: Reader | None, frames: Sequence[Frame], model: str) -> Array:
    """Return the vectors (N, size) of frames.

    Args:
        reader: Reader of the frames; None before a training.
        frames: The frames.
        model: Name of the model, for the message.

    Raises:
        UserError: The model has learned nothing yet.
    """
    if reader is None:
        raise UserError(f"model {model!r} has learned nothing yet; train it or load weights first.")
    return reader.displacements(frames)


@dataclass(frozen=True, eq=False)
class Components:
    """Principal components of displacements: few numbers, each a pattern of all pins.

    Attributes:
        mean: (2 P,) displacement, px.
        basis: (2 P, K) orthonormal patterns.
        spread: (K,) standard deviations over the frames of the fit, px, descending.
        polar: Whether vectors are taken as direction and size, see ``polar``.
    """

    mean: Array
    basis: Array
    spread: Array
    polar: bool = False

    @classmethod
    def fit(cls, moved: Array, count: int, *, as_polar: bool = False) -> Self:
        """Return the first components of vectors.

        Args:
            moved: (N, C) vectors.
            count: Most components; those without any spread are left out.
            as_polar: Whether vectors are taken as direction and size.
        """
        moved = polar(moved) if as_polar else moved
        mean = moved.mean(axis=0)
        centred = moved - mean
        variance, basis = np.linalg.eigh(centred.T @ centred / len(moved))
        spread = np.sqrt(np.maximum(variance[::-1], 0.0))
        usable = max(1, int(np.count_nonzero(spread[:count] > _LEAST * spread[0])))
        basis = np.ascontiguousarray(basis[:, ::-1][:, :usable])
        return cls(mean, basis, spread[:usable], as_polar)

    def __len__(self) -> int:
        return len(self.spread)

    def first(self, count: int) -> Self:
        """Return the first ``count`` components."""
        return replace(self, basis=self.basis[:, :count], spread=self.spread[:count])

    def weights(self, whitening: float) -> Array:
        """Return weights (K,) in proportion to 1 / spread^whitening.

        A whitening of 0 keeps the proportions of pixels, 1 makes all spreads alike.
        """
        least = np.maximum(self.spread, 1e-9)
        return np.asarray((least / least[0]) ** -whitening / least[0], dtype=np.float64)

    def of(self, moved: Array, whitening: float) -> Array:
        """Return the components (N, K) of vectors (N, C), times ``weights(whitening)``.

        The first component has unit spread.
        """
        moved = polar(moved) if self.polar else moved
        return np.asarray((moved - self.mean) @ self.basis * self.weights(whitening))


def polar(moved: Array) -> Array:
    """Return direction and size of vectors v (N, C) as (N, C + 1): v / rms v, and 2 log rms v.

    Where one thing presses, its place shows in the direction and its depth in the size. Single
    presses on the magnetic skin of eFlesh are then read better than from v itself: the mean
    absolute error of ``kernel`` on held-out training places is 0.238 mm instead of 0.277 mm.
    """
    size = np.maximum(rms_displacement(moved), FAINT)[:, np.newaxis]
    return np.column_stack([moved / size, 2 * np.log(size)])


def rms_displacement(moved: Array) -> Array:
    """Return the root mean square (N,) of displacements (N, 2 P)."""
    rms: Array = np.sqrt(np.mean(np.square(moved), axis=1))
    return rms


def contact_threshold(moved: Array, answer: str) -> float:
    """Return the least rms displacement of a contact, from training presses (N, 2 P).

    It is 0 for answer "plate", because a plate's pose is asked for in every frame.
    """
    if answer == "plate" or not len(moved):
        return 0.0
    return float(_SHARE * np.quantile(rms_displacement(moved), _FAINTEST))


def read_answers(values: npt.NDArray[Any], answer: str, threshold: float) -> list[Answer | None]:
    """Return the answers of values.

    Args:
        values: (N, T + 1) targets, mm and deg, and the rms displacement.
        answer: "contacts" or "plate".
        threshold: Rms displacement below which there is no contact.
    """
    answers = answers_from_vectors(values[:, :-1], answer)
    none = Contacts.none()
    return [
        none if rms < threshold else pressed
        for pressed, rms in zip(answers, values[:, -1], strict=True)
    ]
