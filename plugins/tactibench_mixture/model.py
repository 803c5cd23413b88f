"""The model ``mixture``: frames -> displacement field -> mixture of Gaussians -> contacts.

The network of ``mixture``: from a displacement field to raw outputs of coarse cells.

Displacement fields: those of the pins, interpolated on a square of cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree
from torch import nn
from torch.nn import functional as F  # noqa: N812

from tactibench import Answer, Contacts, Frame, Grid, ModelContext, UserError
from tactibench.markers import PinTracker, Tracks
from tactibench.training import (
    Examples,
    MixtureModel,
    Recipe,
    draw_flips,
    flip_maps,
)

CHANNELS = 7
"""Raw outputs of a cell, as ``tactibench.training.mixture_values`` reads them."""
_FIRST_LOG_STD = 0.3
"""Log std of a cell before anything is learned, log mm."""
_PRESENCE_GAIN = 4.0
"""Factor on the logit of presence. This logit has the longest way to go, but an optimiser that
divides by the size of the gradients (Adam) moves all weights at the same pace."""


class MixtureNetwork(nn.Module):
    """(B, 2, 2 n, 2 n) displacement of the skin -> (B, 7, n, n) raw outputs of a mixture.

    Three levels of n, n / 2 and n / 4 cells, with residual blocks of two convolutions each and
    without normalisation: the statistics of a batch would be noise to a network that measures. Each
    block starts as the identity (as in Fixup, Zhang et al. 2019). The field enters with the
    coordinates of its cells, because a dome does not look the same from place to place.

    Args:
        width: Channels of the finest level.
        side: Cells along a side of the field, 2 n.
        mirror: Whether, in training, frames are mirrored at random with x, and with y, reversed,
            and the outputs mirrored back.
    """

    scale: torch.Tensor
    place: torch.Tensor

    def __init__(self, width: int, side: int, mirror: tuple[bool, bool]) -> None:
        super().__init__()
        self.mirror = mirror
        axis = torch.linspace(-1, 1, side)
        place = torch.stack(torch.meshgrid(axis, axis, indexing="xy"))[None]
        self.register_buffer("place", place, persistent=False)
        self.register_buffer("scale", torch.ones(()))
        deep = 2 * width
        self.stem = nn.Conv2d(4, width, 6, stride=2, padding=2)
        self.fine = Residual(width)
        self.down = nn.Conv2d(width, deep, 3, stride=2, padding=1)
        self.middle = Residual(deep)
        self.further_down = nn.Conv2d(deep, deep, 3, stride=2, padding=1)
        self.bottom = Residual(deep)
        self.lift = nn.ConvTranspose2d(deep, deep, 2, stride=2)
        self.middle_up = Residual(deep)
        self.further_lift = nn.ConvTranspose2d(deep, width, 2, stride=2)
        self.fine_up = Residual(width)
        self.widen = nn.Conv2d(width, deep, 1)
        self.head = Head(deep)

    @torch.no_grad()
    def initialise(self, fields: torch.Tensor, contacts: torch.Tensor) -> None:
        """Fix the scale to the training fields and start at their count of contacts.

        Args:
            fields: (N, 2, S, S) displacements, px.
            contacts: (N, K, 3) contacts, rows of NaN for none.
        """
        self.scale.copy_(1 / fields.square().mean().sqrt().clamp_min(1e-6))
        cells = self.place[0, 0].numel() / 4
        count = float((~contacts[..., 0].isnan()).sum()) / len(contacts)
        self.head.initialise(min(max(count, 0.1) / cells, 0.5))

    def forward(self, fields: torch.Tensor) -> torch.Tensor:
        if not self.training:
            return self._cells(fields)
        flips = draw_flips(len(fields), self.mirror, fields.device)
        signs = 1 - 2 * flips.to(fields.dtype)
        raw = flip_maps(self._cells(flip_maps(fields, flips) * signs[:, :, None, None]), flips)
        steps = raw[:, 1:3] * signs[:, :, None, None]
        return torch.cat([raw[:, :1], steps, raw[:, 3:]], dim=1)

    def _cells(self, fields: torch.Tensor) -> torch.Tensor:
        place = self.place.expand(len(fields), -1, -1, -1)
        fine = self.fine(self.stem(torch.cat([fields * self.scale, place], dim=1)))
        middle = self.middle(self.down(F.relu(fine)))
        bottom = self.bottom(self.further_down(F.relu(middle)))
        middle = self.middle_up(middle + self.lift(F.relu(bottom)))
        fine = self.fine_up(fine + self.further_lift(F.relu(middle)))
        raw: torch.Tensor = self.head(F.relu(self.widen(F.relu(fine))))
        return raw


class Residual(nn.Module):
    """x + conv(relu(conv(relu(x)))), the identity at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        nn.init.kaiming_normal_(self.first.weight, nonlinearity="relu")
        nn.init.zeros_(self.second.weight)
        for convolution in (self.first, self.second):
            assert convolution.bias is not None  # noqa: S101
            nn.init.zeros_(convolution.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        changed: torch.Tensor = x + self.second(F.relu(self.first(F.relu(x))))
        return changed


class Head(nn.Module):
    """Linear layer to the raw outputs, in float32 also within autocast.

    bf16 has 8 bits: it would round a depth of 6 mm to 0.02 mm.
    """

    gain: torch.Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        gain = torch.ones(CHANNELS, 1)
        gain[0] = _PRESENCE_GAIN
        self.register_buffer("gain", gain, persistent=False)
        self.weight = nn.Parameter(0.3 / math.sqrt(width) * torch.randn(CHANNELS, width) / gain)
        self.bias = nn.Parameter(torch.zeros(CHANNELS))

    @torch.no_grad()
    def initialise(self, presence: float) -> None:
        """Set the probability of a contact with which every cell begins."""
        self.bias.zero_()
        self.bias[0] = math.log(presence / (1 - presence)) / _PRESENCE_GAIN
        self.bias[4:] = _FIRST_LOG_STD

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with torch.autocast(x.device.type, enabled=False):
            weight = (self.gain * self.weight)[:, :, None, None]
            return F.conv2d(x.float(), weight, self.gain[:, 0] * self.bias)


Floats = npt.NDArray[np.float32]

_SYMMETRIC_PX = 0.05
"""Rms distance of mirrored pins from the pins up to which they are the same pins."""


class DisplacementField:
    """Displacement of the skin in every cell of a frame, interpolated between the pins.

    The interpolant is the smoothest sum of cones on the pins (linear radial basis functions), so
    that a field is one product of a fixed matrix with the displacements.
    """

    def __init__(self, pins: PinTracker, cells: int) -> None:
        """Compute the matrix from displacements of pins to cells.

        Args:
            pins: Tracker of the pins that are the layout.
            cells: Cells along a side.
        """
        self.pins = pins
        self.cells = cells
        axis = (np.arange(cells) + 0.5) * pins.side / cells - 0.5
        places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        spread = RBFInterpolator(pins.rest, np.eye(len(pins.rest)), kernel="linear")(places)
        self._spread: Floats = np.asarray(spread, dtype=np.float32)

    def __call__(self, tracks: Tracks) -> Floats:
        """Return displacements in x and y, (N, 2, cells, cells), px, from pins on the layout."""
        moved = (tracks.xy - self.pins.rest).astype(np.float32)
        field = np.matmul(self._spread, moved).transpose(0, 2, 1)
        shape = (len(tracks), 2, self.cells, self.cells)
        return np.ascontiguousarray(field).reshape(shape)

    @property
    def symmetry(self) -> tuple[bool, bool]:
        """(x, y): whether the pins at rest stay the same with that axis reversed."""
        pins, last = self.pins.rest, self.pins.side - 1
        return _coincide(pins, np.abs([last, 0] - pins)), _coincide(pins, np.abs([0, last] - pins))


def _coincide(pins: npt.NDArray[np.float64], mirrored: npt.NDArray[np.float64]) -> bool:
    distance, _ = cKDTree(pins).query(mirrored)
    return bool(np.sqrt(np.square(distance).mean()) < _SYMMETRIC_PX)


RECIPE = Recipe(epochs=30, batch=32, learning_rate=2e-3, warmup=0.2, weight_decay=1e-2)
_CELLS = 16
"""Cells of the mixture along a side of the frame."""
_FINER = 2
"""Cells of the displacement field along a cell of the mixture."""
_REACH = 0.75
"""Greatest distance, in cells, of a contact from the centre of the cell that reports it, in x and
in y. The nearest cell needs half a cell; the further the other cells reach, the later they agree on
which of them reports."""


class Mixture(MixtureModel):
    """A network that reports contacts cell by cell; compare DECODE (Speiser et al. 2021).

    Each of some coarse cells gives the probability that it holds a contact, where and how deep that
    contact is, and how sure the cell is. The input is the displacement field of the pins since
    their own rest image, on the layout of the first training frame's sensor (``AlignedSensors``).

    Raises:
        UserError: The encoder is not of kind mixture, or the grid is no square whose side is a
            multiple of 16 cells.
    """

    name = "mixture"

    def __init__(
        self,
        context: ModelContext,
        width: int = 32,
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = 0.0,
    ) -> None:
        if context.encoder is None or context.encoder.channels != CHANNELS:
            raise UserError("model 'mixture' needs an encoder of kind mixture; name one.")
        architecture = {"width": width, "answer": context.answer}
        super().__init__(context, RECIPE.with_choices(epochs, precision), architecture, mixing)
        self._encoder = context.encoder
        self._grid = _coarse(context.grid)
        x, y = self._grid.axes()
        centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._use_anchors(centres, _REACH * self._grid.pitch)
        self._field: DisplacementField | None = None

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        super().prepare(frames, truth)
        self._find_field()

    def build(self) -> MixtureNetwork:
        mirror = (False, False) if self._field is None else self._field.symmetry
        return MixtureNetwork(self.architecture["width"], _FINER * _CELLS, mirror)

    def initialise(self, network: MixtureNetwork, training: Examples) -> None:
        network.initialise(training.images, training.targets)

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        tracks = self._tracks(frames)
        assert self._field is not None  # noqa: S101
        return torch.from_numpy(self._field(tracks))

    def outputs(self, raw: torch.Tensor) -> npt.NDArray[Any]:
        """Return (N, 7, cells, cells) float32 maps as the encoder reads them."""
        values = super().outputs(raw)
        values[..., 1:3] -= self._anchors.numpy()
        return values.transpose(0, 2, 1).reshape(len(raw), CHANNELS, *self._grid.shape)

    def read(self, outputs: npt.NDArray[Any]) -> list[Contacts]:
        return self._encoder.decode_batch(outputs, self._grid)

    def restore(self, extra: dict[str, Any]) -> None:
        super().restore(extra)
        self._find_field()

    def _find_field(self) -> None:
        sensors = self._sensors
        self._field = None if sensors is None else DisplacementField(sensors.first, _FINER * _CELLS)


def _coarse(grid: Grid) -> Grid:
    """Return a grid of 16 x 16 cells over the same square.

    Raises:
        UserError: The grid is no square whose side is a multiple of 16 cells.
    """
    rows, columns = grid.shape
    if rows != columns or rows % _CELLS:
        raise UserError(
            f"model 'mixture' needs a square grid whose side is a multiple of {_CELLS} cells, not "
            f"{grid.shape}; change the protocol's grid."
        )
    each = rows // _CELLS
    x, y = (start + 0.5 * (each - 1) * grid.pitch for start in grid.origin)
    return Grid((_CELLS, _CELLS), (x, y), each * grid.pitch)
