"""Contacts as a mixture of Gaussians: the outputs of a network per anchor, and their likelihood.

An anchor is a place that may report one contact: a cell of a coarse grid, or a node of a graph. It
gives a probability, a mean and standard deviations. The likelihood is that of localisation
microscopy (Speiser et al. 2021, Nature Methods 18:1082): contacts are drawn independently from the
mixture of the anchors' Gaussians, and their number from the anchors' probabilities.

Contacts read from the probabilities, means and deviations of anchors, without torch.

The base class of models with a mixture of Gaussians, and the calibration of their std.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench.contacts import Answer, Contacts, FloatArray, Frame
from tactibench.errors import UserError
from tactibench.markers import AlignedSensors, PinTracker, Tracks
from tactibench.plugins import FitReport, ModelContext, Progress
from tactibench.training.learned import LearnedModel
from tactibench.training.recipe import Recipe
from tactibench.training.targets import PlateScale
from tactibench.training.weights import pack_image, unpack_image

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

    def read_all(self, p: FloatArray, mean: FloatArray, std: FloatArray) -> list[Contacts]:
        """Return the contacts of N frames with M anchors each.

        Args:
            p: (N, M) probabilities.
            mean: (N, M, 3) x, y and depth, mm.
            std: (N, M, 3) their standard deviations, mm.

        Raises:
            ValueError: A value is not finite.
        """
        anchors = np.nonzero(~(p < FAINT))  # NaN passes, so that ``read`` refuses it
        return self.read(len(p), anchors[0], p[anchors], mean[anchors], std[anchors])


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


Array = npt.NDArray[Any]
Rows = npt.NDArray[np.int64]

_AS_STATED = np.ones((2, 3))
_CALIBRATION_STEP = 20
"""One frame in this many with several contacts is not learned from, to calibrate the std."""
_FEWEST = 20
"""Fewest contacts from which a 95 % quantile is read; with fewer the stated std is not changed."""
_AXIS_95 = 1.959964
_PLANE_95 = math.sqrt(-2 * math.log(0.05))
"""95 % quantiles of a normal error along one axis, and of its length in the plane (Rayleigh)."""


class MixtureModel(LearnedModel):
    """A model that is one network from (B, ...) inputs to raw outputs (B, 7, anchors) of a mixture.

    It is trained by the likelihood of the true contacts. Its stated std are then scaled so that
    95 % of the errors on frames that it has not learned from lie inside the 95 % ellipses. A plate
    is the contact in which it meets the dome. A subclass calls ``_use_anchors`` before the model is
    used.
    """

    def __init__(
        self,
        context: ModelContext,
        recipe: Recipe,
        architecture: dict[str, Any],
        mixing: float = 0.0,
    ) -> None:
        super().__init__(context, recipe, architecture, mixing)
        self._plate = PlateScale()
        self._factors = _AS_STATED
        self._sensors: AlignedSensors | None = None

    @abstractmethod
    def read(self, outputs: Array) -> list[Contacts]:
        """Return the contacts of every row of ``outputs``, with the std that the network gives."""

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train the model, then calibrate the std.

        The std are calibrated on the validation frames, on every twentieth of the given frames with
        several contacts, which is not learned from, and, if the model mixes, on as many new mixed
        frames.

        Raises:
            UserError: There is no frame that the model can learn from, mixed frames are requested
                and cannot be made, or the loss is not finite.
        """
        learned, held_out = split_calibration(truth)
        calibration = [*validation[0], *(frames[row] for row in held_out)]
        answers = [*validation[1], *(truth[row] for row in held_out)]
        report = super().fit(
            [frames[row] for row in learned],
            [truth[row] for row in learned],
            validation=(calibration, answers),
            rng=rng,
            progress=progress,
        )
        if self.mixing and calibration:  # other frames than those of the training
            from tactibench.superposition import mix

            mixed, contacts = mix(frames, truth, len(calibration), rng)
            calibration, answers = [*calibration, *mixed], [*answers, *contacts]
        if calibration:
            predicted = self.read(self.evaluate(calibration))
            true = [self._plate.contacts(answer) for answer in answers]
            self._factors = std_factors(predicted, true)
        notes = {"kept_for_std": len(held_out), "std_factors": self._factors.round(4).tolist()}
        return replace(report, notes={**report.notes, **notes})

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        """Find the scale of plate depths and the sensors; std are not scaled until calibrated.

        The first sensor is that of the first frame with a rest image. Where no frame has one, the
        frame that is pressed least is used as rest image.

        Raises:
            UserError: The image that is used shows no pins.
        """
        self._factors = _AS_STATED
        self._plate = PlateScale.of(truth, self.context.max_depth)
        depths = [self._plate.contacts(answer).depth.sum() for answer in truth]
        self._sensors = AlignedSensors.of(frames, otherwise=frames[int(np.argmin(depths))])

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        """Return (N, K, 3) x, y and depth of the contacts, mm, rows of NaN for none."""
        return pack_contacts([self._plate.contacts(answer) for answer in truth])

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the negative log likelihood of the true contacts."""
        anchors = self._anchors.to(outputs)
        return mixture_loss(outputs.flatten(2), anchors, targets, self._scale)

    def outputs(self, raw: torch.Tensor) -> Array:
        """Return (N, anchors, 7) float32: probability, mean and std of x, y and depth, mm."""
        anchors = self._anchors.to(raw.device)
        probability, mean, std = mixture_values(raw.flatten(2), anchors, self._scale)
        return super().outputs(torch.cat([probability[..., None], mean, std], dim=-1))

    def answers(self, outputs: Array) -> list[Answer | None]:
        """Return the contacts of every frame, or its plate pose (None without a contact)."""
        frames = [scale_std(contacts, self._factors) for contacts in self.read(outputs)]
        if self.context.answer == "plate":
            return [self._plate.plate(contacts) for contacts in frames]
        return list(frames)

    def extra(self) -> dict[str, Any]:
        """Return JSON values that are stored with the weights; a subclass adds its own."""
        return {
            "rest": None if self._sensors is None else pack_image(self._sensors.first.rest_image),
            "depth_offset_mm": self._plate.offset,
            "std_factors": self._factors.tolist(),
        }

    def restore(self, extra: dict[str, Any]) -> None:
        """Restore the values that were stored with the weights."""
        self._plate = PlateScale(extra["depth_offset_mm"])
        self._factors = np.array(extra["std_factors"])
        rest = extra["rest"]
        self._sensors = None if rest is None else AlignedSensors(PinTracker(unpack_image(rest)))

    def _tracks(self, frames: Sequence[Frame]) -> Tracks:
        """Return the pins of frames on the layout of the first training sensor.

        Raises:
            UserError: The model is not trained, or the pins of a sensor are not those of the
                layout.
        """
        if self._sensors is None:
            raise UserError(
                f"model {self.name!r} knows no pins yet; train it or load weights first."
            )
        return self._sensors.tracks(frames)

    def _use_anchors(self, anchors: npt.NDArray[np.float64], reach_mm: float) -> None:
        """Set the anchors.

        Args:
            anchors: (M, 2) mm.
            reach_mm: Largest distance of a mean from its anchor, in x and in y.
        """
        self._anchors = torch.from_numpy(anchors).float()
        self._scale = MixtureScale(reach_mm, self.context.max_depth)


def split_calibration(truth: Sequence[Answer]) -> tuple[Rows, Rows]:
    """Return rows to learn from, and rows with several contacts that are for ``std_factors``.

    The validation frames of a protocol hold single contacts, whose errors are of another size.
    """
    crowded = [isinstance(answer, Contacts) and len(answer) > 1 for answer in truth]
    held_out = np.flatnonzero(crowded)[_CALIBRATION_STEP - 1 :: _CALIBRATION_STEP]
    return np.setdiff1d(np.arange(len(truth)), held_out), held_out


def std_factors(predicted: Sequence[Contacts], truth: Sequence[Contacts]) -> Array:
    """Return the factors for the std of x, y and depth, (2, 3): of single and of several contacts.

    With them 95 % of the errors lie inside the 95 % ellipse in the plane and the 95 % interval of
    depth. Only frames with the right number of contacts are used. Where too few of them have
    several contacts, the factors of single contacts serve for both.

    Args:
        predicted: Predicted contacts of every frame, with the stated std.
        truth: True contacts of every frame.
    """
    pairs = [pair for pair in zip(predicted, truth, strict=True) if len(pair[0]) == len(pair[1])]
    alone = _factors([pair for pair in pairs if len(pair[0]) == 1], np.ones(3))
    return np.stack([alone, _factors([pair for pair in pairs if len(pair[0]) > 1], alone)])


def scale_std(contacts: Contacts, factors: Array) -> Contacts:
    """Return contacts with their std, if they have one, times the factors of ``std_factors``."""
    if contacts.std is None:
        return contacts
    return replace(contacts, std=contacts.std * factors[int(len(contacts) > 1)])


def _factors(pairs: Sequence[tuple[Contacts, Contacts]], default: Array) -> Array:
    z = np.concatenate([np.empty((0, 3)), *(_standardised(*pair) for pair in pairs)])
    if len(z) < _FEWEST:
        return default
    axes = np.maximum(np.quantile(np.abs(z), 0.95, axis=0) / _AXIS_95, 1e-3)
    plane = np.quantile(np.hypot(*(z[:, :2] / axes[:2]).T), 0.95) / _PLANE_95
    factors: Array = axes * [plane, plane, 1.0]
    return factors


def _standardised(predicted: Contacts, truth: Contacts) -> Array:
    """Return error / std of the prediction nearest to every true contact, (K, 3).

    There are no rows where the predictions have no std.
    """
    if predicted.std is None:
        return np.empty((0, 3))
    away = np.linalg.norm(predicted.xy[:, None] - truth.xy, axis=-1)
    nearest = away.argmin(axis=0)
    error = np.column_stack([predicted.xy, predicted.depth])[nearest] - np.column_stack(
        [truth.xy, truth.depth]
    )
    return np.asarray(error / predicted.std[nearest], dtype=np.float64)


CHANNELS = 7
"""Raw outputs of an anchor: logit of presence, dx, dy, depth, log std of x, y and depth."""

_COUNT_VARIANCE = 1 / 12
"""Variance of a uniform distribution within half a count: a density is read at whole numbers
(Sheppard)."""
_LOG_STD = (-12.0, 4.0)
"""Bounds at which raw log std are cut off, so that neither exp nor its square leave float32."""


@dataclass(frozen=True)
class MixtureScale:
    """The lengths that turn raw outputs into mm.

    Attributes:
        reach_mm: Largest distance of a mean from its anchor, in x and in y.
        max_depth_mm: Depth for a raw depth of 1; a raw depth of -1 is 0 mm.
        floor_mm: Smallest standard deviation. It is below the noise of any sensor and only keeps
            the likelihood of a training frame finite.
    """

    reach_mm: float
    max_depth_mm: float
    floor_mm: float = 2e-3


def mixture_values(
    raw: torch.Tensor, anchors: torch.Tensor, scale: MixtureScale
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return probability (B, M), mean (B, M, 3) and std (B, M, 3) of x, y and depth, mm.

    Args:
        raw: (B, 7 or more, M) raw outputs, of which the first 7 channels are used.
        anchors: (M, 2), mm.
        scale: Scale of the raw outputs.
    """
    mean, std = _gaussians(_exact(raw), anchors, scale)
    return _exact(raw)[:, 0].sigmoid(), mean, std


def mixture_loss(
    raw: torch.Tensor, anchors: torch.Tensor, contacts: torch.Tensor, scale: MixtureScale
) -> torch.Tensor:
    """Return the negative log likelihood of a frame's contacts, lengths in mm, mean over frames.

    With p_m, N_m of the anchors and n contacts c_k in a frame it is

        - sum_k log sum_m (p_m / sum p) N_m(c_k)  -  log N(n; sum p, sum p (1 - p) + 1 / 12)

    It is computed in float32 (float64 for a float64 raw), whatever the network computes in.

    Args:
        raw: (B, 7 or more, M) raw outputs, of which the first 7 channels are used.
        anchors: (M, 2), mm.
        contacts: (B, K, 3) x, y, depth, mm; rows of NaN stand for no contact.
        scale: Scale of the raw outputs.
    """
    raw = _exact(raw)
    contacts = contacts.to(raw.dtype)
    present = ~contacts.isnan().any(dim=-1)
    mean, std = _gaussians(raw, anchors, scale)
    z = (contacts.nan_to_num()[:, :, None] - mean[:, None]) / std[:, None]
    log_gaussian = (
        -0.5 * z.square().sum(-1) - std.log().sum(-1)[:, None] - 1.5 * math.log(2 * math.pi)
    )
    log_p = F.logsigmoid(raw[:, 0])
    log_weight = log_p - log_p.logsumexp(dim=-1, keepdim=True)
    log_place = (log_weight[:, None] + log_gaussian).logsumexp(dim=-1)
    places = torch.where(present, log_place, 0.0).sum(-1)
    return (count_nll(raw[:, 0], present.sum(-1)) - places).mean()


def count_nll(logits: torch.Tensor, count: torch.Tensor) -> torch.Tensor:
    """Return the negative log probability of a count of independent draws, (B,), as a Gaussian's.

    The count of independent draws has the mean sum p and the variance sum p (1 - p).

    Args:
        logits: (B, M) logits of the probabilities p.
        count: (B,) counts.
    """
    p = logits.sigmoid()
    variance = (p * (-logits).sigmoid()).sum(-1) + _COUNT_VARIANCE
    away = count.to(p.dtype) - p.sum(-1)
    return 0.5 * (away.square() / variance + variance.log() + math.log(2 * math.pi))


def pack_contacts(truth: Sequence[Contacts]) -> torch.Tensor:
    """Return x, y, depth of contacts, mm, (N, K, 3) float32.

    K is the largest number of contacts, at least 1; a frame with fewer contacts has rows of NaN.
    """
    most = max([1, *(len(contacts) for contacts in truth)])
    packed = np.full((len(truth), most, 3), np.nan, dtype=np.float32)
    for row, contacts in zip(packed, truth, strict=True):
        row[: len(contacts), :2] = contacts.xy
        row[: len(contacts), 2] = contacts.depth
    return torch.from_numpy(packed)


def _exact(raw: torch.Tensor) -> torch.Tensor:
    return raw if raw.dtype == torch.float64 else raw.float()


def _gaussians(
    raw: torch.Tensor, anchors: torch.Tensor, scale: MixtureScale
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return mean and std (B, M, 3), mm, of raw outputs (B, 7 or more, M)."""
    xy = anchors.to(raw.dtype) + scale.reach_mm * raw[:, 1:3].tanh().transpose(1, 2)
    depth = 0.5 * scale.max_depth_mm * (1 + raw[:, 3, :, None])
    std = raw[:, 4:7].clamp(*_LOG_STD).exp().square().add(scale.floor_mm**2).sqrt()
    return torch.cat([xy, depth], dim=-1), std.transpose(1, 2)
