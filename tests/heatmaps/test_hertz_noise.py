"""The least-squares decoder on maps such as networks draw."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tactibench import Contacts, Grid
from tactibench_heatmaps import HertzGaussian

GRID = Grid.centred(64, 0.4)


def position_errors(encoder, maps, truth):
    found = encoder.decode_batch(maps, GRID)
    assert [len(f) for f in found] == [1] * len(truth)
    return np.concatenate([f.xy - t.xy for f, t in zip(found, truth, strict=True)])


def cramer_rao(truth, sigma, window):
    """Bound on the standard deviation of x in white noise, from the cells of the window alone."""
    x, y = GRID.axes()
    information = []
    for contact in truth:
        (cx, cy), d = contact.xy[0], contact.depth[0]
        variance = 3.0 * d / 9.0 + 4.0
        near_x = x[np.argsort(np.abs(x - cx))[:window]]
        near_y = y[np.argsort(np.abs(y - cy))[:window]]
        dx, dy = near_x[None] - cx, near_y[:, None] - cy
        slope = d / 6.0 * dx / variance * np.exp(-(dx**2 + dy**2) / (2 * variance))
        information.append((slope**2).sum() / sigma**2)
    return 1.0 / np.sqrt(information)


@pytest.mark.parametrize("window", [7, 11, 15])
@pytest.mark.parametrize("width", ["free", "kernel"])
def test_white_noise_error_reaches_the_cramer_rao_bound(window, width):
    rng = np.random.default_rng(10)
    truth = [Contacts.truth(rng.uniform(-6, 6, (1, 2)), rng.uniform(2, 6, 1)) for _ in range(400)]
    encoder = HertzGaussian(decoder="least-squares", window=window, width=width)
    maps = encoder.encode_batch(truth, GRID)
    noisy = maps + 0.003 * rng.standard_normal(maps.shape)
    z = position_errors(encoder, noisy, truth)[:, 0] / cramer_rao(truth, 0.003, window)
    assert 0.9 < z.std() < 1.2  # 400 samples: the sample deviation itself is good to 3.5 %
    assert abs(z.mean()) < 0.2


def network_like(rng, maps):
    """Smooth noise, correlated over two cells and stronger where there is heat, and some white."""
    smooth = gaussian_filter(rng.standard_normal(maps.shape), (0, 0, 2, 2))
    smooth /= smooth.std()
    rough = rng.standard_normal(maps.shape)
    return np.clip(maps + (0.2 + maps) * (0.015 * smooth + 0.003 * rough), 0, 1)


def test_wide_windows_average_network_noise():
    """The order found on real network outputs: cell, narrow fit, wide fit; no false contacts."""
    rng = np.random.default_rng(11)
    truth = [Contacts.truth(rng.uniform(-6, 6, (1, 2)), rng.uniform(0.5, 6, 1)) for _ in range(300)]
    noisy = network_like(rng, HertzGaussian().encode_batch(truth, GRID))
    cell, narrow, wide = (
        np.abs(position_errors(encoder, noisy, truth)).mean()
        for encoder in (
            HertzGaussian(decoder="maximum"),
            HertzGaussian(decoder="least-squares", window=7),
            HertzGaussian(decoder="least-squares", window=11),
        )
    )
    assert wide < 0.8 * narrow < 0.8 * 0.5 * cell


def test_neighbours_do_not_bias_each_other():
    """Errors towards the neighbour, 6.5 to 8 mm away, average to nothing."""
    rng = np.random.default_rng(12)
    truth, towards = [], []
    for _ in range(300):
        turn, distance = rng.uniform(0, 2 * np.pi), rng.uniform(6.5, 8.0)
        along = np.array([np.cos(turn), np.sin(turn)])
        centre = rng.uniform(-2, 2, 2)
        ends = [centre - along * distance / 2, centre + along * distance / 2]
        truth.append(Contacts.truth(ends, [rng.uniform(0.7, 2), rng.uniform(3, 5)]))
        towards.append(along)
    encoder = HertzGaussian()
    found = encoder.decode_batch(network_like(rng, encoder.encode_batch(truth, GRID)), GRID)
    assert np.mean([len(f) == 2 for f in found]) > 0.99
    shallow = [
        (f.xy[1] - t.xy[0]) @ u
        for f, t, u in zip(found, truth, towards, strict=True)
        if len(f) == 2
    ]
    standard_error = np.std(shallow) / np.sqrt(len(shallow))
    assert abs(np.mean(shallow)) < 4 * standard_error + 0.005


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_a_blurred_kernel_does_not_bias_the_free_fit(scale):
    """A network may draw wider or narrower kernels; position and height are still read."""
    x, y = GRID.axes()
    cx, cy, d = 1.13, -2.71, 3.0
    variance = (4 + d / 3) * scale**2
    maps = d / 6 * np.exp(-((x - cx) ** 2 + (y[:, None] - cy) ** 2) / (2 * variance))[None]
    free = HertzGaussian(width="free").decode(maps, GRID)
    assert np.abs(free.xy - [cx, cy]).max() < 0.002
    assert abs(free.depth[0] - d) < 0.002
    held = HertzGaussian().decode(maps, GRID)
    assert abs(held.depth[0] - d) > 0.05
