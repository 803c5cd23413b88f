"""The encoders ``depth`` and ``offset``: a heat of where contacts are, and discs of the rest.

The heat of every contact is a Gaussian of height 1 and one width, so that a shallow contact is as
visible as a deep one. In a disc around the contact other channels hold its depth and place: the
depth is constant in the disc, the steps to the contact are linear; outside they are neutral. A cell
between two contacts belongs to the nearer one. Every cell can be learned on its own, by
cross-entropy.

Reading takes the mean over the cells around a peak, weighted by heat, so that noise averages out.
Cells near the rim of a disc, or about as near to another peak, are left out, because networks blur
them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.disc_loops import draw_discs, read_discs
from tactibench_heatmaps.encoder import (
    TOLERANCE,
    MapEncoder,
    MapStack,
    PeakReader,
    relative_depth,
    split_contacts,
)

_RIM = 1.0  # width inside the rim of a disc that is not read, cells
_LEAST_REACH = 2.0  # least radius of a disc, cells


class DiscEncoder(MapEncoder):
    """Contacts <-> heat and discs; the depth is the last channel, d / max_depth.

    Attributes:
        max_depth: Depth whose channel is 1, mm.
        reach: Radius of the discs, mm.
        peaks: How the heat is read, in mm.
    """

    def __init__(self, max_depth: float, reach: float, peaks: PeakReader) -> None:
        self.max_depth = max_depth
        self.reach = reach
        self.peaks = peaks

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> MapStack:
        """Return (N, C, H, W) float32 maps.

        Raises:
            UserError: A depth is not between 0 and ``max_depth``, or the discs reach less than two
                cells.
        """
        out = np.empty((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        ends = np.cumsum([0, *map(len, contacts)])
        xy = np.concatenate([np.empty((0, 2)), *(c.xy for c in contacts)])
        depth = np.concatenate([np.empty(0), *(c.depth for c in contacts)])
        place = np.column_stack([*grid.cells(xy), relative_depth(depth, self.max_depth)])
        draw_discs(place, ends, self.peaks.base / grid.pitch**2, self._reach(grid), out)
        return out

    def _decode(self, stack: MapStack, grid: Grid) -> list[Contacts]:
        peaks = self.peaks.read(stack[:, 0], grid.pitch)
        value = np.empty(peaks.place.shape[:2])
        reach = self._reach(grid)
        read_discs(stack, peaks.counts, peaks.place, reach - _RIM, reach, value)
        row, column, heat = peaks.flat(peaks.place).T
        depth = self.max_depth * peaks.flat(value)
        return split_contacts(peaks.counts, grid.xy(row, column), depth, np.minimum(heat, 1.0))

    def _reach(self, grid: Grid) -> float:
        cells = self.reach / grid.pitch
        if cells < _LEAST_REACH:
            raise UserError(
                f"the encoder's discs reach {self.reach:g} mm, less than {_LEAST_REACH:g} cells of "
                f"{grid.pitch:g} mm; raise its parameter 'reach'."
            )
        return cells


class HeatAndDepth(DiscEncoder):
    """Contacts <-> (2, H, W): a heat of height 1 at every contact, and discs of its depth.

    The parameters are declared in ``hooks``; the heat is read by the decoders of ``peaks``. The
    score of a contact is the heat of its peak, cut to 0..1.

    ``separation`` and ``tolerance`` hold for the default parameters on a 64 x 64 grid of 0.4 mm
    pitch and any depths.
    """

    channels = 2
    separation = 2.0

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        sigma: float = 0.8,
        reach: float = 2.0,
        decoder: str = "least-squares",
        threshold: float = 0.3,
        min_distance: float = 1.2,
        max_count: int = 6,
        window: int = 11,
    ) -> None:
        peaks = PeakReader(
            slope=0.0,
            base=sigma**2,
            decoder=decoder,
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
            window=window,
            flanks=decoder != "maximum",
        )
        super().__init__(max_depth, reach, peaks)
        self.tolerance = TOLERANCE[decoder]


class Offsets(DiscEncoder):
    """Contacts <-> (4, H, W): heat, and discs of the steps dx, dy to the contact and of its depth.

    A step of -reach..reach is shown as 0..1. No step is 0.5, and so is every cell outside the
    discs. The contact is read from the mean of the steps of all cells around a peak of the heat, as
    in G-RMI (Papandreou et al., "Towards Accurate Multi-person Pose Estimation in the Wild", CVPR
    2017), whose offsets vote around the peaks of discs. The score is the heat of the peak, cut to
    0..1.

    The parameters are declared in ``hooks``. ``separation`` and ``tolerance`` hold for their
    defaults on a 64 x 64 grid of 0.4 mm pitch and any depths.
    """

    channels = 4
    separation = 2.0
    tolerance = 0.002

    def __init__(
        self,
        *,
        max_depth: float = 6.0,
        sigma: float = 0.8,
        reach: float = 2.0,
        threshold: float = 0.3,
        min_distance: float = 1.2,
        max_count: int = 6,
    ) -> None:
        peaks = PeakReader(
            slope=0.0,
            base=sigma**2,
            decoder="maximum",
            threshold=threshold,
            min_distance=min_distance,
            max_count=max_count,
        )
        super().__init__(max_depth, reach, peaks)
