"""The maximum filter against scipy's, and what stands between the cells against plain formulae."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter

from tactibench_heatmaps import CANDIDATES, PeakReader


def reader(threshold: float, **more: Any) -> PeakReader:
    """Every maximum as it is, unless told otherwise."""
    words = {"decoder": "maximum", "min_distance": 0.0, "max_count": 4096, "flanks": False} | more
    return PeakReader(slope=0.0, base=9.0, threshold=threshold, **words)


def peaks(maps: np.ndarray, threshold: float, **more: Any) -> list[np.ndarray]:
    """Of every map, (K, 3) row, column and heat."""
    found = reader(threshold, **more).read(maps, 1.0)
    return [place[:n] for n, place in zip(found.counts, found.place, strict=True)]


def smooth_maps(seed: int, count: int, shape: tuple[int, int] = (40, 50)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noise = gaussian_filter(rng.standard_normal((count, *shape)), (0, 3, 3))
    return (noise / noise.max()).astype(np.float32)


@pytest.mark.parametrize("count", [1, 7])
def test_peaks_are_scipys_maxima(count: int) -> None:
    maps = smooth_maps(1, count)
    for one, found in zip(maps, peaks(maps, 0.1), strict=True):
        high = (one == maximum_filter(one, size=3, mode="constant", cval=-np.inf)) & (one >= 0.1)
        assert 3 < len(found) == np.count_nonzero(high)
        assert {(r, c) for r, c, _ in found} == {tuple(cell) for cell in np.argwhere(high)}
        at = found[:, :2].astype(int)
        np.testing.assert_array_equal(found[:, 2], one[at[:, 0], at[:, 1]])
        assert (np.diff(found[:, 2]) <= 0).all()


def test_maps_do_not_see_each_other() -> None:
    """The last row of one map is no neighbour of the first row of the next."""
    maps = np.zeros((2, 6, 6), np.float32)
    maps[0, 5, 2], maps[1, 0, 2] = 0.5, 0.9
    first, second = peaks(maps, 0.1)
    assert first[:, :2].tolist() == [[5, 2]]
    assert second[:, :2].tolist() == [[0, 2]]


def test_plateaus_at_the_border_and_within() -> None:
    maps = np.zeros((1, 12, 12), np.float32)
    maps[0, 0:3, 0:3] = 0.7
    maps[0, 7:10, 5:10] = 0.4
    assert peaks(maps, 0.1)[0][:, :2].tolist() == [[1, 1], [8, 7]]


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (9, 9)])
def test_a_map_without_a_lower_cell_has_no_peak(shape: tuple[int, int]) -> None:
    assert len(peaks(np.full((1, *shape), 0.5, np.float32), 0.1)[0]) == 0


def test_a_dropped_peak_drops_none() -> None:
    """Of a chain a > b > c in which neighbours are too close, a and c stay."""
    maps = np.zeros((1, 5, 20), np.float32)
    maps[0, 2, [4, 7, 10]] = 0.9, 0.8, 0.7
    assert peaks(maps, 0.1, min_distance=4.0)[0][:, 1].tolist() == [4, 10]
    assert peaks(maps, 0.1, min_distance=4.0, max_count=1)[0][:, 1].tolist() == [4]


def test_work_on_noise_is_bounded() -> None:
    maps = np.random.default_rng(3).random((2, 64, 64)).astype(np.float32)
    assert [len(found) for found in peaks(maps, 0.01)] == [CANDIDATES] * 2
