"""The base of the encoders: maps of whole batches, checked before they are read."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Encoder, Grid, UserError

MapStack = npt.NDArray[np.float32]
LARGEST = 1e6
"""Largest heat that is read. Heat is about 1 at most; a million times that can overflow."""


class MapEncoder(Encoder):
    """Contacts <-> C = ``channels`` maps on the H x W cells of a grid.

    Attributes:
        separation: Contacts farther apart than this are told apart, mm.
        tolerance: Largest error of a round trip, mm.
    """

    def encode(self, contacts: Contacts, grid: Grid) -> MapStack:
        """Return (C, H, W) float32 maps.

        Raises:
            UserError: The maps cannot show the contacts.
        """
        maps: MapStack = self.encode_batch([contacts], grid)[0]
        return maps

    @abstractmethod
    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, C, H, W) float32 maps, the same as ``encode`` one by one."""

    def decode(self, maps: npt.ArrayLike, grid: Grid) -> Contacts:
        """Read contacts from (C, H, W) maps, best first.

        Raises:
            ValueError: The maps have another shape.
            UserError: A value is not finite or beyond ``LARGEST``.
        """
        return self._decode(_checked(maps, (self.channels, *grid.shape)), grid)[0]

    def decode_batch(self, maps: npt.ArrayLike, grid: Grid) -> list[Contacts]:
        """Read contacts from (N, C, H, W) maps, the same as ``decode`` one by one.

        Raises:
            ValueError: The maps have another shape.
            UserError: A value is not finite or beyond ``LARGEST``.
        """
        return self._decode(_checked(maps, (None, self.channels, *grid.shape)), grid)

    @abstractmethod
    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        """Return the contacts of each of (N, C, H, W) maps, best first.

        The maps are finite, contiguous and writeable.
        """


def _checked(maps: npt.ArrayLike, shape: tuple[int | None, ...]) -> MapStack:
    """Return contiguous (N, C, H, W) float32 maps; the input is left as it is.

    Args:
        maps: One map or several.
        shape: The shape that they must have; None: any size.

    Raises:
        ValueError: The maps have another shape.
        UserError: A value is not finite or beyond ``LARGEST``.
    """
    given = np.asarray(maps)
    fits = given.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(given.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("N" if size is None else str(size) for size in shape)
        raise ValueError(f"maps have shape {given.shape}, expected ({wanted})")
    stack = np.ascontiguousarray(given, dtype=np.float32).reshape(-1, *given.shape[-3:])
    # the extremes of a map with NaN are NaN
    if stack.size and not (stack.max() <= LARGEST and stack.min() >= -LARGEST):
        bad = int((~(np.abs(stack) <= LARGEST)).sum())
        raise UserError(
            f"the heatmaps hold {bad} of {stack.size} values that are not finite or beyond "
            f"{LARGEST:g}; the model that drew them has diverged: train it again, with a lower "
            "learning rate."
        )
    # for read-only arrays a compiled loop would be compiled once more
    return stack if stack.flags.writeable else stack.copy()


def relative_depth(depth: npt.NDArray[np.float64], max_depth: float) -> npt.NDArray[np.float64]:
    """Return depths, mm, in units of ``max_depth``, mm.

    Raises:
        UserError: A depth is not between 0 and ``max_depth``.
    """
    bad = (depth < 0) | (depth > max_depth + 1e-9)
    if bad.any():
        raise UserError(
            f"a contact is {depth[bad][0]:.4g} mm deep, but heatmaps hold 0 to "
            f"{max_depth:g} mm; raise the encoder's parameter 'max_depth'."
        )
    return np.minimum(depth / max_depth, 1.0)
