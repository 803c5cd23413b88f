from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import Contacts, UserError
from tactibench.markers import Tracks, pin_graph
from tactibench_vgnn import NEAREST, NO_PIN, NODE, PinLayout, neighbour_table, node_features

QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""(x, y) @ QUARTER turns x towards y."""


def flat(rest):
    affine = np.array([[0.4, 0.0], [0.0, 0.4], [-12.6, -12.6]])
    return PinLayout(rest, np.full(len(rest), 1.5), affine)


def tracked(*frames):
    xy = np.stack(frames)
    return Tracks(xy, np.ones(xy.shape[:2], dtype=bool), np.full(xy.shape[:2], 1.5))


def partners(table):
    return [set(row[row != NO_PIN].tolist()) for row in table]


def slow_neighbours(edges, count):
    found = [set() for _ in range(count)]
    for a, b in edges.tolist():
        found[a].add(b)
        found[b].add(a)
    return found


@given(arrays(np.float64, (12, 2), elements=st.floats(0, 60, width=32), unique=True))
@settings(max_examples=30, deadline=None)
def test_the_table_holds_the_nearest_partners_of_every_pin(xy):
    edges = np.array([[a, b] for a in range(12) for b in range(a + 1, 12) if (a + b) % 3])
    table = neighbour_table(edges, xy)
    every = slow_neighbours(edges, 12)
    for pin, (found, possible) in enumerate(zip(partners(table), every, strict=True)):
        assert found <= possible
        away = np.linalg.norm(xy - xy[pin], axis=1)
        if found:
            farthest = max(away[list(found)])
            assert len(found) == NEAREST or all(
                away[other] >= farthest - 1e-9 for other in possible - found
            )
        assert bool(found) == bool(possible)


def test_a_frame_at_rest_has_no_features_but_that_its_pins_are_seen(rest_pins):
    features = node_features(tracked(rest_pins), flat(rest_pins))
    assert features.shape == (1, 37, NODE)
    assert features.dtype == np.float32
    np.testing.assert_allclose(features[0, :, :4], 0, atol=1e-6)
    assert (features[..., 4] == 1).all()


def test_cells_of_a_layout_that_doubles_grow_by_log_4(rest_pins):
    away = (rest_pins - rest_pins.mean(axis=0)) * 2 + rest_pins.mean(axis=0)
    growth = node_features(tracked(away), flat(rest_pins))[0, :, 2]
    border = pin_graph(rest_pins).border
    np.testing.assert_allclose(growth[~border], np.log(4), rtol=1e-5)


def test_features_are_divided_by_the_scales_of_the_training(rest_pins, push_pins):
    xy = tracked(push_pins(1.0, 2.0, 4.0))
    plain = flat(rest_pins)
    scaled = replace(plain, moved_px=2.0, grown=0.5)
    one, other = (node_features(xy, layout) for layout in (plain, scaled))
    np.testing.assert_allclose(one / [2, 2, 0.5, 1, 1], other, rtol=1e-5, atol=1e-6)


def test_turning_the_frame_turns_the_displacements_and_nothing_else(rest_pins, push_pins):
    moved = push_pins(2.0, -3.0, 4.0)
    middle = rest_pins.mean(axis=0)
    turned_rest, turned = ((xy - middle) @ QUARTER + middle for xy in (rest_pins, moved))
    one = node_features(tracked(moved), flat(rest_pins))[0]
    other = node_features(tracked(turned), flat(turned_rest))[0]
    np.testing.assert_allclose(one[:, :2] @ QUARTER, other[:, :2], atol=1e-5)
    np.testing.assert_allclose(one[:, 2:], other[:, 2:], atol=1e-5)
    tables = [neighbour_table(pin_graph(xy).edges, xy) for xy in (moved, turned)]
    assert partners(tables[0]) == partners(tables[1])


def test_pins_that_coincide_give_finite_features(rest_pins):
    moved = rest_pins.copy()
    moved[3], moved[20:23] = moved[4], moved[20]
    assert np.isfinite(node_features(tracked(moved), flat(rest_pins))).all()


def test_a_picture_of_a_pin_that_grows_says_so_and_an_unknown_one_nothing(rest_pins):
    tracks = tracked(rest_pins, rest_pins)
    tracks.radius[0, 7] *= np.e
    tracks.radius[1] = np.nan
    features = node_features(tracks, flat(rest_pins))
    assert features[0, 7, 3] == pytest.approx(1)
    assert np.count_nonzero(features[..., 3]) == 1
    unknown = replace(flat(rest_pins), radius=np.zeros(37))
    assert not node_features(tracks, unknown)[..., 3].any()


def test_the_size_of_a_pin_that_was_not_seen_is_not_known(rest_pins):
    """Its disc was fitted to no light and has shrunk: 45 deviations, where pins swell by one."""
    tracks = tracked(rest_pins, rest_pins)
    tracks.radius[1, 5] *= 0.4
    tracks.seen[1, 5] = False
    assert not node_features(tracks, flat(rest_pins))[..., 3].any()


def spread_presses(push_pins):
    places = [(x, y) for x in (-4.0, 0.0, 4.0) for y in (-4.0, 0.0, 4.0)]
    truth = [Contacts.truth([[x, y]], [4.0]) for x, y in places]
    return tracked(*(push_pins(x, y, 4.0) for x, y in places)), truth


def test_the_layout_learns_where_in_mm_its_pins_stand(rest_pins, push_pins):
    tracks, truth = spread_presses(push_pins)
    layout = PinLayout.learn(tracks, tracked(rest_pins), truth)
    expected = (rest_pins - 31.5) / 2.5
    inside = np.abs(expected).max(axis=1) < 6
    np.testing.assert_allclose(layout.anchors[inside], expected[inside], atol=1.0)
    away = np.linalg.norm(np.concatenate([c.xy for c in truth])[:, None] - layout.anchors, axis=-1)
    assert (away.min(axis=1) < layout.reach_mm).all()
    assert layout.moved_px == pytest.approx(np.sqrt(((tracks.xy - rest_pins) ** 2).mean()))


def test_presses_that_move_nothing_are_refused(rest_pins):
    still = tracked(*[rest_pins] * 5)
    with pytest.raises(UserError, match="at least 3"):
        PinLayout.learn(still, tracked(rest_pins), [Contacts.truth([[0, 0]], [1])] * 5)
