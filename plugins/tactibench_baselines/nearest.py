"""The trivial models: the nearest training frame (memory alone), and the training mean.

The mean is the best answer without looking at the frame. Both store labels as a run stores answers.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tactibench import (
    Answer,
    Contacts,
    FitReport,
    Frame,
    Model,
    ModelContext,
    PlatePose,
    Progress,
    Sites,
    UserError,
    channel_vectors,
    gray_frames,
    holds_channels,
)
from tactibench.records import pack, read_arrays, unpack, write_arrays

Arrays = dict[str, npt.NDArray[Any]]


def _unpack(arrays: Arrays, answer: str) -> list[Answer]:
    """Return the labels that ``tactibench.records.pack`` was given."""
    return [label for label in unpack(arrays, answer) if label is not None]


def _pack(frames: Sequence[Frame], truth: Sequence[Answer], answer: str) -> Arrays:
    """Return packed labels; only channels are asked for the force."""
    labels = pack(truth, answer)
    if not holds_channels(frames):
        labels.pop("force", None)
    return labels


def _force(labels: Arrays) -> npt.NDArray[np.float64]:
    return np.asarray(np.linalg.norm(labels["force"], axis=1))


def _read(path: Path, answer: str, *names: str) -> Arrays:
    """Read labels and other arrays from a file. Nothing is unpickled.

    Args:
        path: The file.
        answer: "contacts", "plate" or "sites".
        names: Further arrays that the file must hold.

    Raises:
        UserError: The file is missing or damaged, or holds other arrays, such as labels of another
            kind.
    """
    expected, arrays = {*names, *pack((), answer)}, read_arrays(path)
    if set(arrays) - {"force"} != expected:
        raise UserError(
            f"{path} holds {', '.join(sorted(arrays))}, but a model that answers {answer!r} needs "
            f"{', '.join(sorted(expected))}; train again."
        )
    return arrays


class MeanModel(Model):
    """A model that answers every frame alike.

    "contacts": one contact at the mean x, y and depth of all contacts of the training frames (no
    contact when they have none). "plate": the mean depth and tilt. "sites": the share of the frames
    that touch each place, and the places that most of them touch.
    """

    expected_failed_checks: ClassVar[Mapping[str, str]] = {
        "nan_frame": "answers the training mean and looks at no frame"
    }

    def __init__(self, context: ModelContext) -> None:
        self._answer_kind = context.answer
        self._mean: Answer | None = None

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Average the labels.

        Raises:
            UserError: There is no label.
        """
        del validation, rng, progress
        start = time.perf_counter()
        if not len(truth):
            raise UserError("model 'mean' needs a training label; raise the training count.")
        labels = _pack(frames, truth, self._answer_kind)
        if self._answer_kind == "plate":
            depth, tilt = labels["plate_depth"].mean(), labels["plate_tilt"].mean()
            self._mean = PlatePose(float(depth), float(tilt))
        elif self._answer_kind == "sites":
            share = labels["touched"].mean(axis=0)
            names = tuple(labels["names"].tolist())
            self._mean = Sites(names, tuple(share.tolist()), tuple((share > 0.5).tolist()))
        elif not len(labels["depth"]):
            self._mean = Contacts.none()
        else:
            force = [[0.0, 0.0, -_force(labels).mean()]] if "force" in labels else None
            place, depth = [labels["xy"].mean(axis=0)], [labels["depth"].mean()]
            self._mean = Contacts.truth(place, depth, force)
        return FitReport(seconds=time.perf_counter() - start, notes={"frames": len(frames)})

    def predict(self, frames: Sequence[Frame]) -> list[Answer]:
        """Return the mean, once for each frame."""
        if self._mean is None:
            raise UserError("model 'mean' has learned nothing yet; train it or load weights first.")
        return [self._mean] * len(frames)

    def save(self, directory: Path) -> None:
        """Write mean.npz."""
        if self._mean is None:
            raise UserError("model 'mean' has learned nothing yet; train it first.")
        write_arrays(directory / "mean.npz", pack([self._mean], self._answer_kind))

    def load(self, directory: Path) -> None:
        """Read mean.npz.

        Raises:
            UserError: The file is missing or damaged, or holds labels of another kind.
        """
        (self._mean,) = _unpack(_read(directory / "mean.npz", self._answer_kind), self._answer_kind)


Features = npt.NDArray[np.float32]

_NO_SCALE = np.empty(0, dtype=np.float32)
"""The scale of channels where frames are images."""
_BLOCK = 256
"""Frames compared at once: 256 x 4,000 distances are 4 MB."""
_CANDIDATES = 8
"""Frames compared once more in float64, so that the batch size cannot change an answer."""


class NearestModel(Model):
    """A model that answers the truth of the training frame at the smallest squared distance.

    Frames are compared as gray images of ``size`` x ``size`` pixels, less the rest frame where all
    training frames have one. Averaging down is the only blur: on real TacTip frames a further one
    loses depth, and more than 32 x 32 pixels gain less than 2 % of the error. Channels of a sensor
    without a camera are compared in units of their deviations over the training frames.
    """

    def __init__(self, context: ModelContext, size: int = 32) -> None:
        self._answer_kind = context.answer
        self._size = size
        self._truth: list[Answer] = []
        self._scale: Features = _NO_SCALE
        self._remember(np.empty((0, size * size), dtype=np.float32), minus_rest=False)

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Remember every frame and its label.

        Raises:
            UserError: There is no frame, or the number of labels is another one.
        """
        del validation, rng, progress
        start = time.perf_counter()
        if not len(frames) or len(frames) != len(truth):
            raise UserError(
                f"model 'nearest' was given {len(frames)} training frames and {len(truth)} labels; "
                "raise the training count."
            )
        self._truth = _unpack(_pack(frames, truth, self._answer_kind), self._answer_kind)
        self._minus_rest = all(frame.rest is not None for frame in frames)
        self._scale = _NO_SCALE
        if holds_channels(frames):
            deviations = channel_vectors(frames, minus_rest=self._minus_rest).std(axis=0)
            self._scale = np.where(deviations > 0, deviations, 1.0).astype(np.float32)
        self._remember(self._features(frames), self._minus_rest)
        return FitReport(seconds=time.perf_counter() - start, notes={"frames": len(frames)})

    def predict(self, frames: Sequence[Frame]) -> list[Answer]:
        """Return the label of the nearest training frame; of equally near ones the first."""
        return self._labels(self._search(self._features(frames)))

    def stages(self) -> Sequence[tuple[str, Any]]:
        """Return the phases of ``predict``, in order."""
        return [
            ("preprocess", self._features),
            ("forward", self._search),
            ("decode", self._labels),
        ]

    def save(self, directory: Path) -> None:
        """Write nearest.npz."""
        if not len(self._train):
            raise UserError("model 'nearest' has learned nothing yet; train it first.")
        write_arrays(
            directory / "nearest.npz",
            {
                "features": self._train,
                "minus_rest": np.array(self._minus_rest),
                "scale": self._scale,
                **pack(self._truth, self._answer_kind),
            },
        )

    def load(self, directory: Path) -> None:
        """Read nearest.npz.

        Raises:
            UserError: The file is missing or damaged, or holds labels of another kind or features
                of another size.
        """
        path = directory / "nearest.npz"
        arrays = _read(path, self._answer_kind, "features", "minus_rest", "scale")
        features, minus_rest = arrays["features"], bool(arrays["minus_rest"])
        self._scale = arrays["scale"]
        self._truth = _unpack(arrays, self._answer_kind)
        width = len(self._scale) or self._size**2
        if features.shape != (len(self._truth), width):
            raise UserError(
                f"{path} holds features of shape {features.shape}, but {len(self._truth)} labels "
                f"at size {self._size} need ({len(self._truth)}, {width}); train again."
            )
        self._remember(features, minus_rest)

    def _remember(self, features: Features, minus_rest: bool) -> None:
        self._train = np.ascontiguousarray(features)
        self._half_square = 0.5 * np.einsum("nd,nd->n", self._train, self._train)
        self._minus_rest = minus_rest

    def _features(self, frames: Sequence[Frame]) -> Features:
        """Return features (N, size^2) float32, gray levels from 0 to 1, less those at rest.

        The rest frame is taken off where all training frames had one. Channels are returned as
        (N, C) in units of their deviations.
        """
        if count := len(self._scale):
            return channel_vectors(frames, minus_rest=self._minus_rest, count=count) / self._scale
        flat = gray_frames(frames, self._size).reshape(-1, self._size**2).astype(np.float32)
        if self._minus_rest:
            rest = [replace(f, signal=f.rest) for f in frames if f.rest is not None]
            if len(rest) != len(frames):
                raise UserError(
                    "a frame has no rest frame, but the model 'nearest' was trained with them; "
                    "use the sensor that it was trained on."
                )
            flat -= gray_frames(rest, self._size).reshape(flat.shape)
        return flat / np.float32(255)

    def _search(self, features: Features) -> npt.NDArray[np.intp]:
        """Return the (N,) rows of the nearest training frames."""
        if not len(self._train):
            raise UserError(
                "model 'nearest' has learned nothing yet; train it or load weights first."
            )
        blocks = [
            self._search_block(features[i : i + _BLOCK]) for i in range(0, len(features), _BLOCK)
        ]
        return np.concatenate([np.empty(0, dtype=np.intp), *blocks])

    def _search_block(self, features: Features) -> npt.NDArray[np.intp]:
        # |a - b|^2 = |a|^2 + 2 (|b|^2 / 2 - a.b), of which |a|^2 orders nothing
        order = self._half_square - features @ self._train.T
        count = min(_CANDIDATES, order.shape[1])
        candidates = np.sort(np.argpartition(order, count - 1, axis=1)[:, :count], axis=1)
        apart = self._train[candidates].astype(np.float64) - features[:, None]
        best = np.einsum("nkd,nkd->nk", apart, apart).argmin(axis=1)
        rows: npt.NDArray[np.intp] = candidates[np.arange(len(features)), best]
        return rows

    def _labels(self, rows: npt.NDArray[np.intp]) -> list[Answer]:
        return [self._truth[row] for row in rows]
