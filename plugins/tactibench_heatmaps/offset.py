"""The encoder ``offset``: every cell around a contact says how far away the contact is."""

from __future__ import annotations

from tactibench_heatmaps.discs import DiscEncoder
from tactibench_heatmaps.peaks import PeakReader


class Offsets(DiscEncoder):
    """Contacts <-> (4, H, W): heat, and discs of the steps dx, dy to the contact and of its depth.

    A step of -reach..reach is shown as 0..1, none (outside the discs, too) as 0.5. The contact is
    read from the mean of the steps of all cells around a peak of the heat, as in G-RMI (Papandreou
    et al., "Towards Accurate Multi-person Pose Estimation in the Wild", CVPR 2017), whose offsets
    vote around the peaks of discs. The score is the heat of the peak, cut to 0..1.

    Parameters as declared in ``hooks``. separation and tolerance, mm, hold for their defaults on a
    64 x 64 grid of 0.4 mm pitch and any depths.
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
