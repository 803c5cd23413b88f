"""The maximum filter against scipy's, and the bookkeeping of peaks of several maps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter

from tactibench_heatmaps.peaks import Peaks, find_peaks, pairs, rank, suppress
from tactibench_heatmaps.subcell import _three_point


def smooth_maps(seed, count, shape=(40, 50)):
    rng = np.random.default_rng(seed)
    noise = gaussian_filter(rng.standard_normal((count, *shape)), (0, 3, 3))
    return (noise / noise.max()).astype(np.float32)


@pytest.mark.parametrize("count", [1, 7])
def test_peaks_are_scipys_maxima(count):
    maps = smooth_maps(1, count)
    peaks = find_peaks(maps, 0.1)
    expected = set()
    for frame, one in enumerate(maps):
        high = (one == maximum_filter(one, size=3, mode="constant", cval=-np.inf)) & (one >= 0.1)
        expected |= {(frame, *cell) for cell in np.argwhere(high).tolist()}
    found = zip(peaks.frame.tolist(), peaks.row.tolist(), peaks.column.tolist(), strict=True)
    assert len(expected) > 3 * count
    assert set(found) == expected
    np.testing.assert_array_equal(peaks.heat, maps[peaks.frame, peaks.row, peaks.column])


def test_peaks_come_by_map_and_falling_heat():
    peaks = find_peaks(smooth_maps(2, 5), 0.05)
    assert (np.diff(peaks.frame) >= 0).all()
    same = np.diff(peaks.frame) == 0
    assert (np.diff(peaks.heat)[same] <= 0).all()


def test_maps_do_not_see_each_other():
    """The last row of one map is no neighbour of the first row of the next."""
    maps = np.zeros((2, 6, 6), np.float32)
    maps[0, 5, 2], maps[1, 0, 2] = 0.5, 0.9
    peaks = find_peaks(maps, 0.1)
    assert peaks.frame.tolist() == [0, 1]
    assert peaks.row.tolist() == [5, 0]


def test_plateaus_at_the_border_and_within():
    maps = np.zeros((1, 12, 12), np.float32)
    maps[0, 0:3, 0:3] = 0.7
    maps[0, 7:10, 5:10] = 0.4
    peaks = find_peaks(maps, 0.1)
    assert peaks.row.tolist() == [1, 8]
    assert peaks.column.tolist() == [1, 7]


def test_pairs_are_all_within_their_map():
    for frame in ([0, 0, 0], [0, 1, 1, 3, 3, 3], [2], [], [0, 1, 2]):
        frame = np.array(frame, dtype=np.intp)
        first, second = pairs(frame)
        expected = [
            (i, j)
            for i in range(len(frame))
            for j in range(i + 1, len(frame))
            if frame[i] == frame[j]
        ]
        assert list(zip(first.tolist(), second.tolist(), strict=True)) == expected
    assert rank(np.array([0, 1, 1, 3, 3, 3])).tolist() == [0, 0, 1, 0, 1, 2]


def test_a_suppressed_peak_suppresses_none():
    """Of a chain a > b > c in which neighbours conflict, a and c stay."""
    index = np.zeros(3, dtype=np.intp)
    peaks = Peaks(index, np.arange(3), index, np.array([0.9, 0.8, 0.7]))
    left = suppress(peaks, np.array([0, 1]), np.array([1, 2]))
    assert left.row.tolist() == [0, 2]


def test_work_on_noise_is_bounded():
    maps = np.random.default_rng(3).random((2, 64, 64)).astype(np.float32)
    peaks = find_peaks(maps, 0.01)
    assert np.bincount(peaks.frame).tolist() == [64, 64]


def test_three_points_of_a_gaussian_are_exact():
    x, y = np.arange(20)[None], np.arange(20)[:, None]
    variance = 9.0
    maps = 0.8 * np.exp(-((x - 8.3) ** 2 + (y - 11.8) ** 2) / (2 * variance))[None]
    peaks = find_peaks(maps.astype(np.float32), 0.1)
    offset, log_heat = _three_point(maps.astype(np.float32), peaks, 0.5)
    np.testing.assert_allclose(offset, [[0.15, -0.1]], atol=1e-4)
    np.testing.assert_allclose(np.exp(log_heat), 0.8, atol=1e-5)


def test_three_points_on_the_border_keep_the_cell():
    maps = np.zeros((1, 5, 5), np.float32)
    maps[0, 0, 2], maps[0, 0, 1], maps[0, 0, 3] = 0.9, 0.5, 0.6
    offset, _ = _three_point(maps, find_peaks(maps, 0.1), 1.0)
    assert offset[0, 1] == 0.0
    assert 0 < offset[0, 0] < 0.5
