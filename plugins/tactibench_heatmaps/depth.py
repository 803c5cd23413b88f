"""The encoder ``depth``: where a contact is, and beside it how deep."""

from __future__ import annotations

from tactibench_heatmaps.discs import DiscEncoder
from tactibench_heatmaps.peaks import TOLERANCE, PeakReader


class HeatAndDepth(DiscEncoder):
    """Contacts <-> (2, H, W): a heat of height 1 at every contact, and discs of its depth.

    Parameters as declared in ``hooks``; the heat is read by the decoders of ``peaks``. The score
    of a contact is the heat of its peak, cut to 0..1.

    separation and tolerance, mm, hold for the default parameters on a 64 x 64 grid of 0.4 mm pitch
    and any depths.
    """

    channels = 2

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
        self.separation = 3.0 if decoder == "dark" else 2.0
        self.tolerance = TOLERANCE[decoder]
