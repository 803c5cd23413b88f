"""The encoder ``mixture``: in each cell the probability, place and depth of a contact, and std."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, Grid, UserError
from tactibench.training import FAINT, MixtureReader
from tactibench_heatmaps.encoder import MapEncoder, MapStack

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class Mixture(MapEncoder):
    """Contacts <-> 7 maps: presence, dx, dy, depth, and the std of x, y and depth.

    The cell nearest to a contact reports it: the probability that there is one, its distance from
    the cell's centre along x and y, its depth, and their standard deviations. All but the
    probability are mm. Maps like these are learned by the likelihood of
    ``tactibench.training.mixture_loss``, not cell by cell; coarse grids are enough. A contact
    without std has the std 0 on the map, and is read back without std.

    Neighbouring cells whose contacts lie within ``merge`` of each other report the same contact
    (``tactibench.training.MixtureReader``), so closer contacts are not told apart. The score of a
    contact is the sum of their probabilities; a contact whose score is below ``threshold`` is left
    out.

    Attributes:
        tolerance: Rounding to float32 up to 100 mm, mm.
    """

    channels = 7
    tolerance = 1e-5

    def __init__(self, *, threshold: float = 0.3, merge: float = 2.0, max_count: int = 6) -> None:
        self._reader = MixtureReader(threshold, merge, max_count)
        self.separation = merge + self.tolerance

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, 7, H, W) float32 maps; a contact off the grid belongs to the nearest cell.

        Raises:
            UserError: A frame has more contacts than the grid has cells.
        """
        maps = np.zeros((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        frame = np.repeat(np.arange(len(contacts)), [len(each) for each in contacts])
        if not len(frame):
            return maps
        xy = np.concatenate([each.xy for each in contacts])
        row, column = _cells(frame, xy, grid)
        columns = [
            np.concatenate([each.score for each in contacts]),
            *(xy - grid.xy(row, column)).T,
            np.concatenate([each.depth for each in contacts]),
            *np.concatenate([_stated_std(each) for each in contacts]).T,
        ]
        maps[frame, :, row, column] = np.stack(columns, axis=1)
        return maps

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        frame, row, column = np.nonzero(stack[:, 0] >= FAINT)
        cells = stack[frame, :, row, column].astype(np.float64)
        mean = cells[:, 1:4]
        mean[:, :2] += grid.xy(row, column)
        frames = self._reader.read(len(stack), frame, cells[:, 0], mean, cells[:, 4:])
        return [_without_empty_std(contacts) for contacts in frames]


def _cells(frame: IntArray, xy: FloatArray, grid: Grid) -> tuple[IntArray, IntArray]:
    """Return row and column of the cell of every contact: the nearest that no other contact has.

    Raises:
        UserError: A frame has more contacts than the grid has cells.
    """
    rows, columns = grid.shape
    place = [np.rint(index).astype(np.intp) for index in grid.cells(xy)]
    cell = place[0].clip(0, rows - 1) * columns + place[1].clip(0, columns - 1)
    key = frame * rows * columns + cell
    for late in np.setdiff1d(np.arange(len(key)), np.unique(key, return_index=True)[1]):
        free = np.setdiff1d(np.arange(rows * columns), cell[frame == frame[late]])
        if not len(free):
            raise UserError(
                f"a frame has more contacts than the grid's {rows} x {columns} cells; take a grid "
                "with more cells."
            )
        away = np.square(grid.xy(*np.divmod(free, columns)) - xy[late]).sum(axis=1)
        cell[late] = free[away.argmin()]
    row, column = np.divmod(cell, columns)
    return row, column


def _stated_std(contacts: Contacts) -> FloatArray:
    return np.zeros((len(contacts), 3)) if contacts.std is None else contacts.std


def _without_empty_std(contacts: Contacts) -> Contacts:
    if contacts.std is not None and (contacts.std > 0).all():
        return contacts
    return Contacts(contacts.xy, contacts.depth, contacts.score)
