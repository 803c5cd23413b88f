"""Targets to learn: contacts and heatmaps of the truth, plate poses from them, and errors in mm.

Regression of one contact or plate pose per frame: answers as vectors, and their scales.

Labelled frames as tensors, prepared once before the first epoch and mirrored in training.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
import torch

from tactibench.contacts import Answer, Contacts, Frame, Grid, PlatePose, Pose, Sites
from tactibench.errors import UserError
from tactibench.geometry import DOME_RADIUS_MM, plate_from_contacts
from tactibench.images import gray_frames
from tactibench.plugins import Encoder
from tactibench.training.weights import tensor_bytes

Array = npt.NDArray[np.float64]
ANSWER_WIDTH = {"contacts": 3, "plate": 2}
"""Number of values of an answer: x, y, depth mm of a contact; depth mm, tilt deg of a plate."""


def answer_vectors(
    truth: Sequence[Answer], answer: str, model: str, *, force: bool = False
) -> Array:
    """Return (N, 3) x, y, depth mm of single contacts, or (N, 2) depth mm, tilt deg of plates.

    A frame without contact becomes a row of NaN, and a column that is not known is NaN.

    Args:
        truth: True answers to N frames.
        answer: Kind of the answers, "contacts" or "plate".
        model: Name of the model, for the error.
        force: Whether contacts have a fourth column, the size of the force, N.

    Raises:
        UserError: A frame has several contacts.
    """
    rows = np.full((len(truth), ANSWER_WIDTH[answer] + force), np.nan)
    for row, true in zip(rows, truth, strict=True):
        if isinstance(true, PlatePose):
            row[:] = true.depth, true.tilt
            continue
        assert isinstance(true, Contacts)  # noqa: S101 - named places have models of their own
        if len(true) > 1:
            raise UserError(
                f"model {model!r} answers one contact, but a training frame holds {len(true)}; "
                "train it with --regime single or choose a heatmap model such as unet."
            )
        if len(true):
            row[:3] = *true.xy[0], true.depth[0]
            if force and true.force is not None:
                row[3] = np.linalg.norm(true.force[0])
    return rows


def answers_from_vectors(values: npt.NDArray[np.floating], answer: str) -> list[Answer | None]:
    """Return one contact with score 1, or one plate pose, for every row of values.

    Args:
        values: (N, 3) x, y, depth mm, or (N, 4) with the size of the force, N, or (N, 2) depth mm,
            tilt deg; a column that is not known is NaN.
        answer: Kind of the answers, "contacts" or "plate".
    """
    if answer == "plate":
        return [PlatePose(float(depth), float(tilt)) for depth, tilt in values]
    known = values.shape[1] == 4 and not np.isnan(values[:, 3]).any()
    return [
        Contacts(
            row[np.newaxis, :2],
            row[2:3],
            np.ones(1),
            force=np.array([[0.0, 0.0, -row[3]]]) if known else None,
        )
        for row in values
    ]


def regression_rows(truth: Sequence[Answer], answer: str, model: str) -> npt.NDArray[np.int64]:
    """Return the rows that hold a contact or a plate pose.

    Args:
        truth: True answers to the frames.
        answer: Kind of the answers, "contacts" or "plate".
        model: Name of the model, for the error.

    Raises:
        UserError: A frame has several contacts.
    """
    return np.flatnonzero(np.isfinite(answer_vectors(truth, answer, model)[:, :2]).all(axis=1))


@dataclass(frozen=True, eq=False)
class Normalisation:
    """Mean and standard deviation of targets or features over the training frames.

    A column that is not known is 0 when it is normalised, and NaN again in its original unit.

    Attributes:
        mean: (T,); NaN where the column is not known.
        deviation: (T,) standard deviations.
    """

    mean: Array
    deviation: Array

    @classmethod
    def of(cls, values: Array) -> Self:
        """Return the normalisation of (N, T) values; a column that never varies keeps its unit."""
        deviation = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(deviation > 1e-6, deviation, 1.0))

    def apply(self, values: Array) -> Array:
        """Return values as multiples of the standard deviation from the mean."""
        known = ~np.isnan(self.mean)
        return np.where(known, (values - self.mean) / self.deviation, 0.0)

    def invert(self, normal: npt.NDArray[np.floating]) -> Array:
        """Return normalised values in their original unit."""
        return np.asarray(normal * self.deviation + self.mean, dtype=np.float64)

    def to_json(self) -> dict[str, list[float | None]]:
        """Return JSON values from which ``from_json`` makes the same normalisation."""
        mean = [None if np.isnan(value) else value for value in self.mean.tolist()]
        return {"mean": mean, "deviation": self.deviation.tolist()}

    @classmethod
    def from_json(cls, values: dict[str, list[float | None]]) -> Self:
        """Return the normalisation of ``to_json``."""
        return cls(*(np.array(values[name], dtype=np.float64) for name in ("mean", "deviation")))


_SAME_RMS = 3.0
"""Rms difference of a rest frame and its mirror image, grey levels, below which they are equal."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Frames and targets of a training.

    Attributes:
        images: (N, ...) uint8 images or float features, as the network takes them.
        targets: (N, ...) float16 or float32, used as float32.
    """

    images: torch.Tensor
    targets: torch.Tensor

    def __len__(self) -> int:
        return len(self.images)

    def take(self, rows: torch.Tensor, device: str) -> tuple[torch.Tensor, torch.Tensor]:
        """Return images (B, ...) and targets (B, ...) float32 of one batch on the device."""
        rows = rows.to(self.images.device)
        return self.images[rows].to(device), self.targets[rows].to(device).float()

    def spread_rows(self, count: int) -> torch.Tensor:
        """Return at most ``count`` rows whose means are about those of all rows.

        They are spread evenly over the frames in the order of their mean target.
        """
        order = self.targets.float().flatten(1).mean(dim=1).argsort(stable=True).cpu()
        ranks = np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(np.int64)
        return order[torch.from_numpy(ranks)]

    def to(self, device: str) -> Examples:
        """Return the same examples in the memory of a device, to save a copy in every step."""
        return Examples(self.images.to(device), self.targets.to(device))

    def bits(self) -> bytes:
        """Return all data that the weights can depend on, for an identity."""
        shapes = f"{tuple(self.images.shape)} {tuple(self.targets.shape)} {self.targets.dtype}"
        return shapes.encode() + tensor_bytes(self.images) + tensor_bytes(self.targets)


def resting_frames(frames: Sequence[Frame], share: float) -> list[Frame]:
    """Return rest images of frames, as frames without contact.

    Args:
        frames: Frames of a training.
        share: Number of rest images as a share of the frames that have one.
    """
    rests = [(frame.rest, frame.timestamp) for frame in frames if frame.rest is not None]
    return [Frame(rest, when, Pose(), rest) for rest, when in rests[:: round(1 / share)]]


def image_tensor(frames: Sequence[Frame], size: int) -> torch.Tensor:
    """Return (N, 1, size, size) uint8 gray images of frames of any size and colour."""
    return torch.from_numpy(gray_frames(frames, size)[:, np.newaxis])


def relight(images: torch.Tensor) -> torch.Tensor:
    """Return images, scaled to the mean light of their rest frames, (B, 2, S, S).

    Contacts move bright pins and change the mean of a frame by less than 1 %.

    Args:
        images: (B, 2, S, S) float, each frame with its rest frame.
    """
    frame, rest = images[:, :1], images[:, 1:]
    light = rest.mean(dim=(2, 3), keepdim=True) / frame.mean(dim=(2, 3), keepdim=True).clamp_min(1)
    return torch.cat([frame * light, rest], dim=1)


def find_symmetry(image: npt.NDArray[np.uint8]) -> tuple[bool, bool]:
    """Return whether a gray frame (H, W) stays the same with x reversed, and with y reversed."""
    grey = image.astype(np.float64)
    in_x, in_y = (
        bool(np.sqrt(np.square(grey - flipped).mean()) < _SAME_RMS)
        for flipped in (grey[:, ::-1], grey[::-1])
    )
    return in_x, in_y


def draw_flips(count: int, symmetry: tuple[bool, bool], device: torch.device) -> torch.Tensor:
    """Return whether to reverse x and y of each frame, at random where allowed, (count, 2) bool.

    Args:
        count: Number of frames.
        symmetry: Whether x, and whether y, may be reversed.
        device: Device of the result.
    """
    return (torch.rand(count, 2, device=device) < 0.5) & torch.tensor(symmetry, device=device)


def flip_maps(maps: torch.Tensor, flips: torch.Tensor) -> torch.Tensor:
    """Return maps (B, C, H, W) with x and y reversed where ``flips`` (B, 2) is True."""
    maps = torch.where(flips[:, 0, None, None, None], maps.flip(-1), maps)
    return torch.where(flips[:, 1, None, None, None], maps.flip(-2), maps)


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
        assert isinstance(answer, PlatePose)  # noqa: S101 - named places have no heatmap
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
    if answer is None or isinstance(answer, Sites):
        return np.empty((0, 2))
    if isinstance(answer, PlatePose):
        return np.array([[DOME_RADIUS_MM * math.sin(math.radians(answer.tilt)), 0.0]])
    return answer.xy
