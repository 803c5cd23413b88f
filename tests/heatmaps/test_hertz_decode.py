"""What is particular to reading heats of unequal height; the rest is in the conformance list."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Contacts, Grid
from tactibench_heatmaps import HertzGaussian

GRID = Grid.centred(64, 0.4)
DECODERS = {
    "least-squares": {"decoder": "least-squares"},
    "free-width": {"decoder": "least-squares", "width": "free"},
    "wide": {},
    "wide-free": {"width": "free"},
    "maximum": {"decoder": "maximum"},
}
ENCODERS = {name: HertzGaussian(**words) for name, words in DECODERS.items()}
each_encoder = pytest.mark.parametrize("encoder", ENCODERS.values(), ids=ENCODERS)
each_fit = pytest.mark.parametrize("name", ["least-squares", "free-width", "wide", "wide-free"])


def pair(rng, distance, depth):
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth([centre - half, centre + half], depth)


@each_encoder
@pytest.mark.parametrize("value", [0.0, 0.04, 0.5, 1.0])
@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_a_flat_map_has_no_contact(encoder, value, kind):
    assert len(encoder.decode(np.full((1, 64, 64), value, kind), GRID)) == 0
    mixed = np.full((2, 1, 64, 64), value, kind)
    mixed[1] = encoder.encode(Contacts.truth([[0.1, 0.1]], [3.0]), GRID)
    assert [len(c) for c in encoder.decode_batch(mixed, GRID)] == [0, 1]


@each_encoder
def test_a_plateau_is_one_contact_at_its_middle(encoder):
    maps = np.minimum(encoder.encode(Contacts.truth([[0.2, -1.0]], [6.0]), GRID), np.float32(0.6))
    found = encoder.decode(maps, GRID)
    assert len(found) == 1
    assert np.abs(found.xy - [0.2, -1.0]).max() <= 0.4


@each_encoder
def test_four_equal_cells_are_one_contact(encoder):
    maps = encoder.encode(Contacts.truth([[0.0, 0.0]], [3.0]), GRID)
    assert np.count_nonzero(maps == maps.max()) == 4
    found = encoder.decode(maps, GRID)
    assert len(found) == 1
    assert np.abs(found.xy).max() <= encoder.tolerance


@each_encoder
@pytest.mark.parametrize("depth", [0.5, 2.0, 6.0])
def test_equally_deep_pairs_are_told_apart_much_closer(encoder, depth):
    rng = np.random.default_rng(5)
    lists = [pair(rng, 3.6, [depth, depth]) for _ in range(60)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    assert [len(f) for f in found] == [2] * len(lists)


@each_encoder
def test_peaks_nearer_than_the_minimum_distance_are_one(encoder):
    rng = np.random.default_rng(6)
    lists = [pair(rng, 2.2, [3.0, 2.9]) for _ in range(30)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    assert [len(f) for f in found] == [1] * len(lists)


def test_a_bump_on_a_flank_is_no_contact_for_the_fit():
    """A dent in the flank of a deep contact leaves a local maximum behind it, 3.6 mm away."""
    maps = HertzGaussian().encode(Contacts.truth([[0.2, 0.2]], [6.0]), GRID)
    maps[0, 30:35, 38:41] *= 0.7
    assert len(HertzGaussian(decoder="maximum").decode(maps, GRID)) == 2
    fitted = HertzGaussian(decoder="least-squares").decode(maps, GRID)
    assert len(fitted) == 1
    assert fitted.depth[0] == pytest.approx(6.0, abs=0.002)
    assert HertzGaussian().decode(maps, GRID).depth[0] == pytest.approx(6.0, abs=0.1)
    maps[0, 32, 41] *= 1.4  # well above the flank it is a contact again
    assert len(HertzGaussian().decode(maps, GRID)) == 2


@each_fit
@pytest.mark.parametrize("distance", [6.5, 7.0, 8.0])
def test_neighbours_and_borders_do_not_pull_at_a_fit(name, distance):
    """The declared tolerance, stated for a contact alone, holds for pairs and at the edge."""
    rng, encoder = np.random.default_rng(4), ENCODERS[name]
    lists = [pair(rng, distance, [0.5, 6.0]) for _ in range(100)]
    lists += [pair(rng, distance, rng.uniform(0.5, 6.0, 2)) for _ in range(100)]
    lists += [Contacts.truth([[x, 3.3 * x / 12.6]], [2.5]) for x in (12.6, -12.75, 12.4, -11.5)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    for one, truth in zip(found, lists, strict=True):
        assert len(one) == len(truth)
        nearest = np.linalg.norm(one.xy[:, None] - truth.xy, axis=-1).argmin(axis=0)
        np.testing.assert_allclose(one.xy[nearest], truth.xy, atol=encoder.tolerance)
        np.testing.assert_allclose(one.depth[nearest], truth.depth, atol=encoder.tolerance)


def test_wide_is_least_squares_over_seventeen_cells():
    rng = np.random.default_rng(5)
    maps = HertzGaussian().encode(pair(rng, 7.0, [2.0, 4.0]), GRID)
    maps += 0.01 * rng.random(maps.shape, dtype=np.float32)
    narrow = DECODERS["least-squares"]
    wide, same, other = (
        HertzGaussian(**words).decode(maps, GRID) for words in ({}, narrow | {"window": 17}, narrow)
    )
    np.testing.assert_array_equal(wide.xy, same.xy)
    assert np.abs(wide.xy - other.xy).max() > 1e-4


@pytest.mark.parametrize("name", ENCODERS)
def test_threshold_and_max_count(name):
    encoder = ENCODERS[name]
    rows = [[x, y] for x in (-9, 0, 9) for y in (-9, 0, 9)]
    truth = Contacts.truth(rows, np.linspace(1, 5, 9))
    maps = encoder.encode(truth, GRID)
    few = encoder.decode(maps, GRID)
    assert few.depth == pytest.approx(np.linspace(1, 5, 9)[:2:-1], abs=encoder.tolerance)
    low = HertzGaussian(**DECODERS[name], threshold=0.45, max_count=20)
    assert len(low.decode(maps, GRID)) == 5  # 3.0 mm and deeper; the map is 0.45 at 2.7 mm
