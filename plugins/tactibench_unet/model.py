"""The model ``unet``: frames -> heatmaps -> contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.nn import functional as F  # noqa: N812

from tactibench import (
    Answer,
    Contacts,
    Encoder,
    FitReport,
    Frame,
    Grid,
    ModelContext,
    Pose,
    Prior,
    Progress,
    UserError,
)
from tactibench.markers import AlignedImages
from tactibench.training import (
    RECIPES,
    Examples,
    LearnedModel,
    PlateScale,
    find_symmetry,
    heatmaps,
    image_tensor,
    pack_image,
    resting_frames,
    unpack_image,
)
from tactibench_unet.architecture import LEVELS, UNetNetwork

Image = npt.NDArray[np.uint8]
Labelled = tuple[Sequence[Frame], Sequence[Answer]]

_RECIPES = RECIPES | {
    "default": replace(
        RECIPES["default"], epochs=15, batch=32, optimiser="muon", learning_rate=1.2e-2
    )
}
_MIXED_EPOCHS = 8
"""Epochs with mixed frames. Each then has half as many steps again: the training stays as short."""
_HEADROOM = {"default": 0.7, "paper": 1.0}
"""Share of the sigmoid's range in which heat 0..1 is learned. At 1 the deepest contacts ask for
infinite logits, and a short training leaves them too shallow; the published value is 1."""
_PRIORS: dict[str, Prior] = {"dome": "nominal mechanics", "none": "plain addition"}
"""Parameter ``neighbours`` -> prior knowledge of the model, as a row states it."""
_EMPTY = 0.05
"""Empty frames that are added to a training under faults, as a share of its frames."""
_HELD_OUT = 400
"""Most mixed frames that are kept back from the training: as many as protocols validate on."""
_SHARES = np.linspace(0, 0.3, 13)
"""Least scores of a further contact to try, as shares of the highest score."""


class UNet(LearnedModel):
    """U-Net of TactiVerse: from a frame, and the sensor at rest beside it, to heatmaps.

    With the rest image the first convolutions see what moved.

    Raises:
        UserError: There is no encoder, or four poolings do not divide the grid.
    """

    name = "unet"

    def __init__(
        self,
        context: ModelContext,
        recipe: str = "default",
        width: int = 8,
        size: int = 128,
        stem: int = 4,
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = -1.0,
        mirror: str = "recipe",
        rest: str = "recipe",
        neighbours: str = "dome",
        faults: float = 0.0,
    ) -> None:
        if context.encoder is None:
            raise UserError("model 'unet' learns heatmaps and needs an encoder; name one.")
        if any(cells % 2**LEVELS for cells in context.grid.shape):
            raise UserError(
                f"model 'unet' needs a grid whose sides are multiples of {2**LEVELS} cells, "
                f"not {context.grid.shape}; change the protocol's grid."
            )
        architecture: dict[str, Any] = {
            "width": width,
            "size": size,
            "stem": stem,
            "cells": list(context.grid.shape),
            "channels": context.encoder.channels,
            "answer": context.answer,
        }
        if mixing < 0 and context.answer == "plate":  # a plate has no neighbour
            mixing = 0.0
        if mixing and recipe == "default":
            epochs = epochs or _MIXED_EPOCHS
        super().__init__(
            context, _RECIPES[recipe].with_choices(epochs, precision), architecture, mixing
        )
        self._neighbours = neighbours
        self._faults = faults
        self.prior = _PRIORS[neighbours]
        self._held_out: Labelled = ([], [])
        self._least = 0.0
        self._encoder = context.encoder
        self._scale = PlateScale()
        self._headroom = _HEADROOM[recipe]
        self._try_mirror = mirror == "auto" or (mirror == "recipe" and recipe == "default")
        self._mirror = (False, False)
        self._try_rest = rest == "auto" or (rest == "recipe" and recipe == "default")
        self._aligned: AlignedImages | None = None

    def build(self) -> UNetNetwork:
        shape = self.architecture
        rows, columns = shape["cells"]
        return UNetNetwork(
            shape["width"],
            shape["stem"],
            (rows, columns),
            shape["channels"],
            images=1 if self._aligned is None else 2,
            mirror=self._mirror,
            faults=self._faults,
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        """Return (N, 1 or 2, S, S) uint8: the frames and, where it is shown, the sensor at rest.

        Frames of another sensor are then seen on the layout of the first training frame's sensor.
        """
        if self._aligned is None:
            return image_tensor(frames, self.architecture["size"])
        return torch.from_numpy(self._aligned(frames))

    def targets(self, truth: Sequence[Answer]) -> torch.Tensor:
        contacts = [self._scale.contacts(answer) for answer in truth]
        return torch.from_numpy(heatmaps(self._encoder, contacts, self.context.grid))

    def loss(self, outputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the binary cross-entropy, as published, of heat within its headroom."""
        return F.binary_cross_entropy_with_logits(outputs, targets * self._headroom)

    def outputs(self, raw: torch.Tensor) -> np.ndarray:
        """Return (N, C, H, W) float32 heat in 0..1."""
        return super().outputs((raw.float().sigmoid() / self._headroom).clamp_max(1.0))

    def answers(self, outputs: np.ndarray) -> list[Answer | None]:
        """Return the contacts of every map, or its plate pose (None without a contact)."""
        decoded = self._encoder.decode_batch(outputs, self.context.grid)
        contacts = [_without_bumps(each, self._least) for each in decoded]
        if self.context.answer == "plate":
            return [self._scale.plate(each) for each in contacts]
        return list(contacts)

    def maps(self, frames: Sequence[Frame]) -> np.ndarray:
        """Return (N, C, H, W) float32 heatmaps in 0..1, computed in float32."""
        return self.evaluate(frames)

    def read_maps(self, maps: np.ndarray) -> list[Answer | None]:
        """Return the answers that (N, C, H, W) maps stand for."""
        return self.answers(maps)

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return rest images, which show under faults, too, that nothing touches; else none."""
        return resting_frames(frames, _EMPTY) if self._faults else []

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        self._scale = PlateScale.of(truth, self.context.max_depth)
        size = self.architecture["size"]
        self._aligned = AlignedImages.of(frames, size) if self._try_rest else None
        rest = _rest_image(frames, size)
        self._mirror = (False, False)
        if (
            self._try_mirror
            and rest is not None
            and _is_symmetric(self._encoder, self.context.grid)
        ):
            self._mirror = find_symmetry(rest)

    def initialise(self, network: UNetNetwork, training: Examples) -> None:
        network.initialise(training.images, training.targets * self._headroom)

    def mix(
        self, frames: Sequence[Frame], truth: Sequence[Answer], count: int, rng: np.random.Generator
    ) -> tuple[list[Frame], list[Contacts]]:
        """Return ``count`` mixed frames that are as unlike real ones as the law of neighbours is.

        As many more, at most ``_HELD_OUT``, are kept back to choose what counts as a contact.

        Args:
            frames: Training frames.
            truth: Contacts of the frames.
            count: Number of mixed frames.
            rng: Generator of everything random.

        Returns:
            The mixed frames, and their contacts.

        Raises:
            UserError: The frames do not allow mixing, or the encoder shows single contacts only.
        """
        from tactibench.superposition import MISFIT, NeighbourLaw, mix

        pair = Contacts.truth([[-3.0, 0.0], [3.0, 0.0]], [1.0, 1.0])
        self._encoder.encode(pair, self.context.grid)  # raises where it shows one contact only
        law = NeighbourLaw.none() if self._neighbours == "none" else None
        total = count + min(_HELD_OUT, count)
        mixed, contacts = mix(frames, truth, total, rng, law, misfit=MISFIT)
        self._held_out = mixed[count:], contacts[count:]
        return mixed[:count], contacts[:count]

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: Labelled,
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Train, then choose how high the score of a further contact must be.

        It is chosen on the validation frames and on mixed frames that were not learned from.
        """
        self._least, self._held_out = 0.0, ([], [])
        report = super().fit(frames, truth, validation=validation, rng=rng, progress=progress)
        mixed, contacts = self._held_out
        if not mixed:
            return report
        predicted = self.predict([*validation[0], *mixed])
        self._least = least_share(predicted, [*validation[1], *contacts])
        return replace(report, notes={**report.notes, "least_share": self._least})

    def extra(self) -> dict[str, Any]:
        return {
            "least_share": self._least,
            "depth_offset_mm": self._scale.offset,
            "headroom": self._headroom,
            "mirror": list(self._mirror),
            "rest": None if self._aligned is None else pack_image(self._aligned.rest),
        }

    def restore(self, extra: dict[str, Any]) -> None:
        self._least = extra["least_share"]
        self._scale = PlateScale(extra["depth_offset_mm"])
        self._headroom = extra["headroom"]
        in_x, in_y = extra["mirror"]
        self._mirror = in_x, in_y
        rest = extra["rest"]
        self._aligned = None if rest is None else AlignedImages(unpack_image(rest))


def least_share(predicted: Sequence[Answer | None], truth: Sequence[Answer]) -> float:
    """Return the share of the highest score below which a contact is best left out.

    With this share the number of contacts is most often right; of several such shares it is the
    least.
    """
    right = [
        sum(
            len(_without_bumps(contacts, share)) == len(true)
            for contacts, true in zip(predicted, truth, strict=True)
            if isinstance(contacts, Contacts) and isinstance(true, Contacts)
        )
        for share in _SHARES
    ]
    return float(_SHARES[int(np.argmax(right))])


def _without_bumps(contacts: Contacts, share: float) -> Contacts:
    """Return the contacts whose score is at least this share of the highest."""
    if len(contacts) < 2 or not share:
        return contacts
    high = contacts.score >= share * contacts.score.max()
    return (
        contacts
        if high.all()
        else Contacts(contacts.xy[high], contacts.depth[high], contacts.score[high])
    )


def _is_symmetric(encoder: Encoder, grid: Grid) -> bool:
    """Return whether a mirrored contact gives mirrored maps, unlike maps that hold steps."""
    x, y = grid.xy(0.6 * grid.shape[0], 0.7 * grid.shape[1])
    middle_x = grid.xy((grid.shape[0] - 1) / 2, (grid.shape[1] - 1) / 2)[0]
    reflected = encoder.encode(Contacts.truth([[2 * middle_x - x, y]], [2.0]), grid)
    maps = encoder.encode(Contacts.truth([[x, y]], [2.0]), grid)
    return bool(np.allclose(reflected[..., ::-1], maps, atol=1e-4))


def _rest_image(frames: Sequence[Frame], size: int) -> Image | None:
    """Return the (size, size) rest image of the first frame that has one."""
    rest = next((rest for frame in frames if (rest := frame.rest_image) is not None), None)
    return None if rest is None else _sized(rest, size)[0].numpy()


def _sized(rest: Image, size: int) -> torch.Tensor:
    """Return a rest image as (1, size, size) uint8, gray."""
    return image_tensor([Frame(rest, 0.0, Pose())], size)[0]
