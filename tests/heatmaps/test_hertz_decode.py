"""What a decoder of heatmaps must hold, for both decoders."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.hertz import HertzGaussian

GRID = Grid.centred(64, 0.4)
ENCODERS = {
    "least-squares": HertzGaussian(),
    "kernel-width": HertzGaussian(width="kernel"),
    "window-17": HertzGaussian(window=17),
    "maximum": HertzGaussian(decoder="maximum"),
}
place = st.floats(-6.4, 6.4)
depths = st.floats(0.5, 6.0)
each_encoder = pytest.mark.parametrize("encoder", ENCODERS.values(), ids=ENCODERS)


def by_truth(found: Contacts, truth: Contacts) -> tuple[np.ndarray, np.ndarray]:
    """Position and depth errors of the nearest prediction of every true contact."""
    away = np.linalg.norm(found.xy[:, None] - truth.xy[None], axis=-1)
    nearest = away.argmin(axis=0)
    return found.xy[nearest] - truth.xy, found.depth[nearest] - truth.depth


def pair(rng, distance, depth):
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth([centre - half, centre + half], depth)


@each_encoder
@given(place, place, depths)
@settings(max_examples=60, deadline=None)
def test_round_trip(encoder, x, y, depth):
    found = encoder.decode(encoder.encode(Contacts.truth([[x, y]], [depth]), GRID), GRID)
    assert len(found) == 1
    assert np.abs(found.xy - [x, y]).max() <= encoder.tolerance
    assert abs(found.depth[0] - depth) <= encoder.tolerance


@each_encoder
@pytest.mark.parametrize("depth", [0.5, 6.0])
def test_shallowest_and_deepest(encoder, depth):
    truth = Contacts.truth([[1.23, -4.56]], [depth])
    found = encoder.decode(encoder.encode(truth, GRID), GRID)
    assert len(found) == 1
    assert abs(found.depth[0] - depth) <= encoder.tolerance


@each_encoder
def test_empty(encoder):
    assert len(encoder.decode(np.zeros((1, 64, 64), np.float32), GRID)) == 0
    assert encoder.decode_batch(np.zeros((0, 1, 64, 64), np.float32), GRID) == []
    batch = encoder.decode_batch(np.zeros((70, 1, 64, 64), np.float32), GRID)
    assert [len(c) for c in batch] == [0] * 70


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
@pytest.mark.parametrize("beyond", [0.0, 0.15, -0.33, -1.1])
@pytest.mark.parametrize("corner", [False, True])
def test_border(encoder, beyond, corner):
    """A contact at the grid's edge, and up to half a cell outside it."""
    edge = 12.6 + beyond
    truth = Contacts.truth([[-edge, edge if corner else 3.3]], [2.5])
    found = encoder.decode(encoder.encode(truth, GRID), GRID)
    assert len(found) == 1
    assert np.abs(found.xy - truth.xy).max() <= encoder.tolerance
    # a contact outside the grid shows a maximum below its height
    slack = 0.02 if encoder.decoder == "maximum" else 0.0
    assert abs(found.depth[0] - 2.5) <= encoder.tolerance + slack


@each_encoder
def test_permutation(encoder):
    rng = np.random.default_rng(2)
    xy, depth = np.array([[-5.0, 4], [4.3, 4.9], [0.2, -5.1]]), np.array([1.0, 3.0, 5.5])
    order = rng.permutation(3)
    one = encoder.decode(encoder.encode(Contacts.truth(xy, depth), GRID), GRID)
    two = encoder.decode(encoder.encode(Contacts.truth(xy[order], depth[order]), GRID), GRID)
    np.testing.assert_array_equal(one.xy, two.xy)
    assert one.depth == pytest.approx([5.5, 3.0, 1.0], abs=encoder.tolerance)


@each_encoder
@given(st.floats(-5, 5), st.floats(-5, 5), depths, st.integers(-6, 6), st.integers(-6, 6))
@settings(max_examples=30, deadline=None)
def test_shift(encoder, x, y, depth, right, down):
    """Moving the map by whole cells moves the contact by whole pitches."""
    maps = encoder.encode(Contacts.truth([[x, y]], [depth]), GRID)
    wide = np.pad(maps[0], 6)
    moved = wide[6 - down : 70 - down, 6 - right : 70 - right][None]
    here, there = encoder.decode(maps, GRID), encoder.decode(moved, GRID)
    step = 0.4 * np.array([right, down])
    np.testing.assert_allclose(there.xy, here.xy + step, atol=1e-9)
    np.testing.assert_allclose(there.depth, here.depth, atol=1e-9)


@pytest.mark.parametrize("name", ["least-squares", "kernel-width", "window-17"])
def test_refine(name):
    """A fit between the cells beats the cell of the maximum a hundredfold on clean maps."""
    rng = np.random.default_rng(3)
    lists = [
        Contacts.truth(rng.uniform(-6.4, 6.4, (1, 2)), rng.uniform(0.5, 6, 1)) for _ in range(200)
    ]
    fine, coarse = ENCODERS[name], ENCODERS["maximum"]
    maps = fine.encode_batch(lists, GRID)

    def rms(encoder):
        found = encoder.decode_batch(maps, GRID)
        errors = [by_truth(f, t)[0] for f, t in zip(found, lists, strict=True)]
        return np.sqrt(np.mean(np.square(errors)))

    assert rms(coarse) == pytest.approx(0.4 / np.sqrt(12), rel=0.1)  # uniform within a cell
    assert rms(fine) < 0.01 * rms(coarse)


@each_encoder
@pytest.mark.parametrize("distance", [HertzGaussian.separation, 7.0, 8.0])
def test_close_pair(encoder, distance):
    """Pairs at the stated separation are told apart, whatever their depths."""
    rng = np.random.default_rng(4)
    lists = [pair(rng, distance, [0.5, 6.0]) for _ in range(100)]
    lists += [pair(rng, distance, rng.uniform(0.5, 6.0, 2)) for _ in range(200)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    assert [len(f) for f in found] == [2] * len(lists)
    for one, truth in zip(found, lists, strict=True):
        position, depth = by_truth(one, truth)
        assert np.abs(position).max() <= encoder.tolerance
        assert np.abs(depth).max() <= encoder.tolerance


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
    fitted = HertzGaussian().decode(maps, GRID)
    assert len(fitted) == 1
    assert fitted.depth[0] == pytest.approx(6.0, abs=0.002)
    maps[0, 32, 41] *= 1.4  # well above the flank it is a contact again
    assert len(HertzGaussian().decode(maps, GRID)) == 2


@each_encoder
def test_pure(encoder):
    rng = np.random.default_rng(7)
    maps = encoder.encode_batch([pair(rng, 7.0, [2.0, 4.0]) for _ in range(80)], GRID)
    maps += 0.01 * rng.random(maps.shape, dtype=np.float32)
    before = maps.copy()
    batch = encoder.decode_batch(maps, GRID)
    np.testing.assert_array_equal(maps, before)
    maps.setflags(write=False)
    for one, expected in zip(maps, batch, strict=True):
        found = encoder.decode(one, GRID)
        np.testing.assert_allclose(found.xy, expected.xy, atol=1e-9)
        np.testing.assert_allclose(found.depth, expected.depth, atol=1e-9)


@each_encoder
@pytest.mark.parametrize(("kind", "slack"), [(np.float64, 1e-6), (np.float16, 0.02)])
def test_dtype_and_layout(encoder, kind, slack):
    maps = encoder.encode(Contacts.truth([[1.11, -2.22], [-5, 5]], [4.0, 1.5]), GRID)
    expected = encoder.decode(maps, GRID)
    wide = np.empty((1, 64, 128), kind)
    wide[:, :, ::2] = maps
    for given_maps in (maps.astype(kind), wide[:, :, ::2], np.asfortranarray(maps.astype(kind))):
        found = encoder.decode(given_maps, GRID)
        np.testing.assert_allclose(found.xy, expected.xy, atol=slack)
        np.testing.assert_allclose(found.depth, expected.depth, atol=slack)


@each_encoder
def test_scores(encoder):
    truth = Contacts.truth([[-5, -5], [5, -5], [5, 5], [-5, 5]], [0.6, 6.0, 2.0, 4.0])
    found = encoder.decode(1.05 * encoder.encode(truth, GRID), GRID)
    assert (np.diff(found.score) <= 0).all()
    assert (found.score >= 0).all()
    assert found.score[0] == 1.0  # an overshooting map does not overshoot the score
    np.testing.assert_allclose(found.score[1:], found.depth[1:] / 6.0)


@each_encoder
def test_threshold_and_max_count(encoder):
    rows = [[x, y] for x in (-9, 0, 9) for y in (-9, 0, 9)]
    truth = Contacts.truth(rows, np.linspace(1, 5, 9))
    maps = encoder.encode(truth, GRID)
    few = encoder.decode(maps, GRID)
    assert few.depth == pytest.approx(np.linspace(1, 5, 9)[:2:-1], abs=encoder.tolerance)
    low = HertzGaussian(decoder=encoder.decoder, threshold=0.45, max_count=20)
    assert len(low.decode(maps, GRID)) == 5  # 3.0 mm and deeper; the map is 0.45 at 2.7 mm


@each_encoder
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(encoder, bad):
    maps = np.zeros((1, 64, 64))
    maps[0, 5, 6] = bad
    with pytest.raises(UserError, match="not finite"):
        encoder.decode(maps, GRID)
    with pytest.raises(UserError, match="not finite"):
        encoder.decode_batch(maps[None], GRID)


@each_encoder
@pytest.mark.parametrize("shape", [(64, 64), (2, 64, 64), (1, 32, 64), (1, 1, 64, 64)])
def test_other_shapes_are_refused(encoder, shape):
    with pytest.raises(ValueError, match="shape"):
        encoder.decode(np.zeros(shape), GRID)


@each_encoder
def test_pure_noise_gives_valid_contacts(encoder):
    maps = np.random.default_rng(8).random((20, 1, 64, 64))
    for found in encoder.decode_batch(maps, GRID):
        assert 1 <= len(found) <= 6
        assert np.abs(found.xy).max() < 12.6 + 1.3


def test_another_grid():
    """Rows and columns, origin and pitch are the grid's."""
    grid = Grid((40, 70), (-10.0, -3.0), 0.3)
    encoder = HertzGaussian()
    truth = Contacts.truth([[2.34, 5.43], [-6.1, 0.17]], [4.0, 2.0])
    found = encoder.decode(encoder.encode(truth, grid), grid)
    np.testing.assert_allclose(found.xy, truth.xy, atol=encoder.tolerance)
    np.testing.assert_allclose(found.depth, truth.depth, atol=encoder.tolerance)
