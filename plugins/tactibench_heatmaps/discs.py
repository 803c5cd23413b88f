"""What ``depth`` and ``offset`` share: a heat that only says where, and discs that say the rest.

The heat of every contact is a Gaussian of height 1 and one width, so that a shallow contact stands
out as much as a deep one. In a disc around the contact other channels hold what is asked of it,
the same everywhere in the disc or falling linearly; outside they are neutral. A cell between two
contacts belongs to the nearer one. Every cell can be learned on its own, by cross-entropy.

Reading takes the mean over the cells around a peak, weighted by heat: noise averages out. Cells
near the rim of a disc, or as near to another peak, are left out; networks blur them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.disc_loops import draw, read
from tactibench_heatmaps.encoder import MapEncoder, MapStack
from tactibench_heatmaps.kernel import relative_depth
from tactibench_heatmaps.peaks import PeakReader, split

_RIM = 1.0  # cells inside the rim of a disc that are not read
_LEAST_REACH = 2.0  # cells


class DiscEncoder(MapEncoder):
    """Contacts <-> heat and discs; the depth is the last channel, d / max_depth.

    peaks: how the heat is read, mm. reach: radius of the discs, mm.
    """

    def __init__(self, max_depth: float, reach: float, peaks: PeakReader) -> None:
        self.max_depth = max_depth
        self.reach = reach
        self.peaks = peaks

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, C, H, W) float32 maps.

        Raises UserError for a depth outside 0..max_depth, or for discs of less than two cells.
        """
        out = np.empty((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        ends = np.cumsum([0, *map(len, contacts)])
        xy = np.concatenate([np.empty((0, 2)), *(c.xy for c in contacts)])
        depth = np.concatenate([np.empty(0), *(c.depth for c in contacts)])
        place = np.column_stack([*grid.cells(xy), relative_depth(depth, self.max_depth)])
        draw(place, ends, self.peaks.base / grid.pitch**2, self._reach(grid), out)
        return out

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        found = self.peaks.read(stack[:, 0], grid.pitch)
        value = np.empty(found.place.shape[:2])
        reach = self._reach(grid)
        read(stack, found.counts, found.place, reach - _RIM, reach, value)
        row, column, heat = found.flat(found.place).T
        depth = self.max_depth * found.flat(value)
        return split(found.counts, grid.xy(row, column), depth, np.minimum(heat, 1.0))

    def _reach(self, grid: Grid) -> float:
        cells = self.reach / grid.pitch
        if cells < _LEAST_REACH:
            raise UserError(
                f"the encoder's discs reach {self.reach:g} mm, less than {_LEAST_REACH:g} cells of "
                f"{grid.pitch:g} mm; raise its parameter 'reach'."
            )
        return cells
