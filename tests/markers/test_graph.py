from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay, Voronoi

from tactibench import UserError
from tactibench.markers import pin_graph

SEEDS = st.integers(0, 2**32 - 1)


def scipy_edges(xy):
    corners = Delaunay(xy).simplices
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def scipy_areas(xy):
    cells = Voronoi(xy)
    out = np.full(len(xy), np.inf)
    for pin, region in enumerate(cells.point_region):
        corners = cells.regions[region]
        if corners and -1 not in corners:
            out[pin] = ConvexHull(cells.vertices[corners]).volume
    return out


@settings(max_examples=30)
@given(SEEDS, st.integers(3, 90), st.floats(0.01, 1000), st.floats(-100, 100))
def test_edges_and_inner_areas_are_those_of_scipy(seed, count, scale, offset) -> None:
    xy = scale * (np.random.default_rng(seed).uniform(0, 1, (count, 2)) + offset)
    graph = pin_graph(xy)
    assert np.array_equal(graph.edges, scipy_edges(xy - xy.mean(axis=0)))
    inner = ~graph.border
    assert np.allclose(graph.area[inner], scipy_areas(xy - xy.mean(axis=0))[inner], rtol=1e-5)
    assert graph.border[ConvexHull(xy - xy.mean(axis=0)).vertices].all()
    assert np.isfinite(graph.area).all()
    assert (graph.area > 0).all()


def test_rings_of_pins_give_the_graph_of_scipy(rings) -> None:
    rng = np.random.default_rng(0)
    for height in (0.0, 5.0, 20.0):  # to where the triangles at rest are turned over
        xy = rings + rng.normal(0, 0.2, rings.shape) + height * rng.normal(0, 0.3, rings.shape)
        assert np.array_equal(pin_graph(xy).edges, scipy_edges(xy))


@settings(max_examples=15)
@given(SEEDS)
def test_a_permutation_permutes_the_graph(seed) -> None:
    rng = np.random.default_rng(seed)
    xy, order = rng.uniform(0, 50, (40, 2)), rng.permutation(40)
    graph, other = pin_graph(xy), pin_graph(xy[order])
    assert np.allclose(other.area, graph.area[order])
    assert np.array_equal(other.border, graph.border[order])
    back = np.unique(np.sort(order[other.edges], axis=1), axis=0)
    assert np.array_equal(back, graph.edges)


@settings(max_examples=15)
@given(SEEDS, st.integers(1, 5))
def test_coinciding_pins_share_a_cell(seed, count) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 50, (30, 2))
    doubled = rng.choice(30, count, replace=False)
    graph, plain = pin_graph(np.concatenate([xy, xy[doubled]])), pin_graph(xy)
    assert graph.area.sum() == pytest.approx(plain.area.sum())
    assert np.allclose(graph.area[30:], graph.area[doubled])
    pairs = {tuple(edge) for edge in graph.edges.tolist()}
    assert all((int(p), 30 + k) in pairs for k, p in enumerate(doubled))
    assert np.all(np.bincount(graph.edges.ravel(), minlength=30 + count) > 0)


@pytest.mark.parametrize(
    ("count", "step"), [(7, (1.0, 0.0)), (7, (2.0, 1.0)), (7, (0.1, 0.3)), (2, (0.0, 1.0))]
)
def test_pins_on_a_line_are_refused(count, step) -> None:
    with pytest.raises(UserError, match=f"{count} pins lie on a line or are fewer than three"):
        pin_graph(np.arange(float(count))[:, None] * np.array(step))
