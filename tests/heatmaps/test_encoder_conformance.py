"""What every encoder must hold: one function a property, over a table of encoders and decoders.

Where a property cannot apply to an encoder, the table says why and the test is skipped with that.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Contacts, Grid, UserError
from tactibench_heatmaps.axes import Axes
from tactibench_heatmaps.depth import HeatAndDepth
from tactibench_heatmaps.hertz import HertzGaussian
from tactibench_heatmaps.offset import Offsets

GRID = Grid.centred(64, 0.4)
CELL = GRID.pitch
ONE_ONLY = "shows one contact only"
CELLS = "reads no finer than a cell"


@dataclass(frozen=True)
class Case:
    """noise: largest rms error of position, cells, of contacts 2 to 6 mm deep at noise 0.02."""

    encoder: Any
    noise: float
    not_applicable: dict[str, str] = field(default_factory=dict)


# The Cramer-Rao bound of a peak of height A in noise s is s sqrt(2 / pi) / A cells, whatever its
# width: 0.016 for the heats of height 1, 0.028 on average over depths of 2 to 6 mm for "hertz".
CASES = {
    "hertz least-squares": Case(HertzGaussian(decoder="least-squares"), 0.08),
    "hertz free width": Case(HertzGaussian(decoder="least-squares", width="free"), 0.08),
    "hertz wide": Case(HertzGaussian(), 0.06),
    "hertz dark": Case(HertzGaussian(decoder="dark"), 0.3),
    "hertz maximum": Case(HertzGaussian(decoder="maximum"), 1.5, {"refine": CELLS}),
    "depth least-squares": Case(HeatAndDepth(), 0.03),
    "depth dark": Case(HeatAndDepth(decoder="dark"), 0.03),
    "depth maximum": Case(HeatAndDepth(decoder="maximum"), 0.4, {"refine": CELLS}),
    "offset": Case(Offsets(), 0.045),
    "axes": Case(
        Axes(), 0.03, {"permutation": ONE_ONLY, "close_pair": ONE_ONLY, "several": ONE_ONLY}
    ),
}
each = pytest.mark.parametrize("name", CASES)
place, depths = st.floats(-6.4, 6.4), st.floats(0.5, 6.0)


@pytest.fixture
def case(name: str, request: pytest.FixtureRequest) -> Case:
    found = CASES[name]
    kind = request.function.__name__.removeprefix("test_")
    if kind in found.not_applicable:
        pytest.skip(f"{name} {found.not_applicable[kind]}")
    return found


@pytest.fixture
def encoder(case: Case) -> Any:
    return case.encoder


def single(rng: np.random.Generator, shallowest: float = 0.5) -> Contacts:
    return Contacts.truth(rng.uniform(-6.4, 6.4, (1, 2)), rng.uniform(shallowest, 6.0, 1))


def pair(rng: np.random.Generator, distance: float, depth: Any) -> Contacts:
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth([centre - half, centre + half], depth)


def errors(found: Contacts, truth: Contacts) -> tuple[float, float]:
    """Largest errors of position and depth, of the nearest prediction of every true contact."""
    nearest = np.linalg.norm(found.xy[:, None] - truth.xy[None], axis=-1).argmin(axis=0)
    assert len(set(nearest.tolist())) == len(truth)
    depth = np.abs(found.depth[nearest] - truth.depth).max()
    return float(np.abs(found.xy[nearest] - truth.xy).max()), float(depth)


@each
@pytest.mark.parametrize("size", [1, 70])
def test_empty(encoder: Any, size: int) -> None:
    maps = encoder.encode_batch([Contacts.none()] * size, GRID)
    assert maps.shape == (size, encoder.channels, 64, 64)
    assert not maps[:, 0].any()
    assert [len(c) for c in encoder.decode_batch(maps, GRID)] == [0] * size
    assert len(encoder.decode(maps[0], GRID)) == 0
    assert encoder.decode_batch(maps[:0], GRID) == []
    assert encoder.encode_batch([], GRID).shape == (0, encoder.channels, 64, 64)
    for value in (0.04, 0.5, 1.0):  # flat maps have no contact either
        assert len(encoder.decode(np.full(maps.shape[1:], value, np.float32), GRID)) == 0


@each
@given(x=place, y=place, depth=depths)
@settings(max_examples=30, deadline=None)
def test_round_trip(name: str, x: float, y: float, depth: float) -> None:
    encoder, truth = CASES[name].encoder, Contacts.truth([[x, y]], [depth])
    maps = encoder.encode(truth, GRID)
    assert (maps.dtype, maps.shape) == (np.float32, (encoder.channels, 64, 64))
    assert maps.min() >= 0
    assert maps.max() <= 1
    found = encoder.decode(maps, GRID)
    assert len(found) == 1
    assert max(errors(found, truth)) <= encoder.tolerance


@each
@pytest.mark.parametrize("beyond", [0.0, 0.15, -0.33, -1.1])
@pytest.mark.parametrize("corner", [False, True])
def test_border(encoder: Any, beyond: float, corner: bool) -> None:
    """A contact at the grid's edge and up to half a cell outside it is found within half a cell."""
    edge = 12.6 + beyond
    truth = Contacts.truth([[-edge, edge if corner else 3.3]], [2.5])
    found = encoder.decode(encoder.encode(truth, GRID), GRID)
    assert len(found) == 1
    position, depth = errors(found, truth)
    assert position <= max(encoder.tolerance, 0.5 * CELL)
    assert depth <= 0.05


@each
def test_permutation(encoder: Any) -> None:
    xy, depth = np.array([[-5.0, 4], [4.3, 4.9], [0.2, -5.1]]), np.array([1.0, 3.0, 5.5])
    truth, order = Contacts.truth(xy, depth), [2, 0, 1]
    maps = encoder.encode(truth, GRID)
    other = encoder.encode(Contacts.truth(xy[order], depth[order]), GRID)
    np.testing.assert_array_equal(maps, other)
    found = encoder.decode(maps, GRID)
    assert len(found) == 3
    assert max(errors(found, truth)) <= encoder.tolerance
    middle = Contacts.truth([[-1, 0], [1, 0]], [1, 5]), Contacts.truth([[1, 0], [-1, 0]], [5, 1])
    np.testing.assert_array_equal(*(encoder.encode(c, GRID) for c in middle))


@each
@given(
    x=st.floats(-5, 5), y=st.floats(-5, 5), depth=depths,
    right=st.integers(-6, 6), down=st.integers(-6, 6),
)  # fmt: skip
@settings(max_examples=15, deadline=None)
def test_shift(name: str, x: float, y: float, depth: float, right: int, down: int) -> None:
    """Moving the maps by whole cells moves the contact by whole pitches."""
    encoder = CASES[name].encoder
    maps = encoder.encode(Contacts.truth([[x, y]], [depth]), GRID)
    here = encoder.decode(maps, GRID)
    there = encoder.decode(np.roll(maps, (down, right), axis=(1, 2)), GRID)
    np.testing.assert_allclose(there.xy, here.xy + CELL * np.array([right, down]), atol=1e-6)
    np.testing.assert_allclose(there.depth, here.depth, atol=1e-6)


@each
def test_refine(encoder: Any) -> None:
    """Fifty times nearer than cells could be on clean maps, whose rms error is a cell / sqrt 12."""
    rng = np.random.default_rng(3)
    lists = [single(rng) for _ in range(200)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    away = [f.xy[0] - t.xy[0] for f, t in zip(found, lists, strict=True)]
    assert np.sqrt(np.mean(np.square(away))) < 0.02 * CELL / np.sqrt(12)


@each
def test_noise(case: Case) -> None:
    """White noise moves the best contact little, and the depth by no more than it is itself."""
    rng = np.random.default_rng(4)
    lists = [single(rng, shallowest=2.0) for _ in range(200)]
    maps = case.encoder.encode_batch(lists, GRID)
    maps += 0.02 * rng.standard_normal(maps.shape, dtype=np.float32)
    found = [f.top(1) for f in case.encoder.decode_batch(maps, GRID)]
    worst = np.array([errors(f, t) for f, t in zip(found, lists, strict=True)])
    away = np.array([f.xy[0] - t.xy[0] for f, t in zip(found, lists, strict=True)]) / CELL
    assert np.sqrt(np.mean(np.square(away))) < case.noise
    assert np.sqrt(np.mean(np.square(worst[:, 1]))) < 0.02 * 6.0 * 3


@each
@pytest.mark.parametrize("further", [0.0, 0.5, 1.5])
def test_close_pair(encoder: Any, further: float) -> None:
    """Pairs at the declared separation are two, each within half a cell, whatever their depths."""
    rng = np.random.default_rng(5)
    distance = encoder.separation + further
    lists = [pair(rng, distance, [0.5, 6.0]) for _ in range(100)]
    lists += [pair(rng, distance, rng.uniform(0.5, 6.0, 2)) for _ in range(150)]
    found = encoder.decode_batch(encoder.encode_batch(lists, GRID), GRID)
    assert [len(f) for f in found] == [2] * len(lists)
    for one, truth in zip(found, lists, strict=True):
        position, depth = errors(one, truth)
        assert position <= max(encoder.tolerance, 0.5 * CELL)
        assert depth <= max(encoder.tolerance, 0.05)


@each
def test_pure(encoder: Any) -> None:
    """Maps are left as they are, may be read-only, and are read alike in a batch and alone."""
    rng = np.random.default_rng(7)
    maps = encoder.encode_batch([single(rng) for _ in range(70)], GRID)
    maps += 0.01 * rng.random(maps.shape, dtype=np.float32)
    before = maps.copy()
    batch = encoder.decode_batch(maps, GRID)
    np.testing.assert_array_equal(maps, before)
    maps.setflags(write=False)
    for one, expected in zip(maps, batch, strict=True):
        found = encoder.decode(one, GRID)
        np.testing.assert_allclose(found.xy, expected.xy, atol=1e-9)
        np.testing.assert_allclose(found.depth, expected.depth, atol=1e-9)


@each
@pytest.mark.parametrize(("kind", "slack"), [(np.float64, 1e-6), (np.float16, 0.02)])
def test_dtype(encoder: Any, kind: Any, slack: float) -> None:
    maps = encoder.encode(Contacts.truth([[1.11, -2.22]], [4.0]), GRID)
    expected = encoder.decode(maps, GRID)
    wide = np.empty((encoder.channels, 64, 128), kind)
    wide[:, :, ::2] = maps
    for given_maps in (maps.astype(kind), wide[:, :, ::2], np.asfortranarray(maps.astype(kind))):
        found = encoder.decode(given_maps, GRID)
        np.testing.assert_allclose(found.xy, expected.xy, atol=slack)
        np.testing.assert_allclose(found.depth, expected.depth, atol=slack)


@each
def test_scores(encoder: Any) -> None:
    """In 0..1, falling, and falling with the heat; an overshooting map does not overshoot it."""
    truth = Contacts.truth([[1.2, -2.1]], [6.0])
    maps = encoder.encode(truth, GRID)
    assert encoder.decode(1.05 * maps, GRID).score[0] == 1.0
    faint = [encoder.decode(np.float32(share) * maps, GRID).score[0] for share in (0.8, 0.5)]
    assert faint == pytest.approx([0.8, 0.5], abs=0.05)
    noise = np.random.default_rng(8).random((20, *maps.shape))
    for found in encoder.decode_batch(noise, GRID):
        assert (np.diff(found.score) <= 0).all()
        assert ((found.score >= 0) & (found.score <= 1)).all()
        assert len(found) <= 6
        assert not len(found) or np.abs(found.xy).max() < 12.6 + 2.5


@each
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(encoder: Any, bad: float) -> None:
    maps = np.zeros((encoder.channels, 64, 64))
    maps[-1, 5, 6] = bad
    with pytest.raises(UserError, match="not finite"):
        encoder.decode(maps, GRID)
    with pytest.raises(UserError, match="not finite"):
        encoder.decode_batch(maps[None], GRID)


@each
def test_other_shapes_are_refused(encoder: Any) -> None:
    channels = encoder.channels
    for shape in ((64, 64), (channels + 1, 64, 64), (channels, 32, 64), (1, channels, 64, 64)):
        with pytest.raises(ValueError, match="shape"):
            encoder.decode(np.zeros(shape), GRID)


@each
@pytest.mark.parametrize("depth", [6.3, -0.1])
def test_a_depth_that_cannot_be_shown_is_refused(encoder: Any, depth: float) -> None:
    with pytest.raises(UserError, match="max_depth"):
        encoder.encode(Contacts.truth([[0, 0]], [depth]), GRID)


@each
def test_another_grid(encoder: Any) -> None:
    """Rows and columns, origin and pitch are the grid's."""
    grid = Grid((40, 70), (-10.0, -3.0), 0.3)
    truth = Contacts.truth([[2.34, 5.43]], [4.0])
    found = encoder.decode(encoder.encode(truth, grid), grid)
    assert len(found) == 1
    assert max(errors(found, truth)) <= encoder.tolerance


@each
def test_several(encoder: Any) -> None:
    """Three contacts 8 mm apart, as the triple indenter makes them, in a batch and alone."""
    rng = np.random.default_rng(9)
    lists = []
    for _ in range(60):
        turn = rng.uniform(0, 2 * np.pi) + np.arange(3) * 2 * np.pi / 3
        xy = 8 / np.sqrt(3) * np.column_stack([np.cos(turn), np.sin(turn)])
        lists.append(Contacts.truth(xy + rng.uniform(-1.5, 1.5, 2), rng.uniform(0.5, 6, 3)))
    maps = encoder.encode_batch(lists, GRID)
    for one, truth, batch in zip(maps, lists, encoder.decode_batch(maps, GRID), strict=True):
        np.testing.assert_array_equal(one, encoder.encode(truth, GRID))
        assert len(batch) == 3
        position, depth = errors(batch, truth)
        assert position <= max(encoder.tolerance, 0.05)
        assert depth <= max(encoder.tolerance, 0.01)
