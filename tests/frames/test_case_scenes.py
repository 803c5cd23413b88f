"""A value changes what it says and nothing else; every tip reaches the depth that was asked for."""

from __future__ import annotations

import typing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.contacts import Scene
from tactibench.frames import CANDIDATES, case_scene, scene_of_depths
from tactibench.geometry import tip_depths, tip_positions, true_contacts
from tactibench.protocols import NEEDS, Family, Press, Protocol, Workspace, load_protocol

KEYS: Protocol = load_protocol("stability").spec
SPACE: Workspace = KEYS.workspace
PRESSED = [family.name for family in KEYS.families if family.press]


def scene(name: str, value: float, k: int = 0) -> Scene:
    family = KEYS.family(name)
    seed = np.random.SeedSequence(KEYS.data_seed, spawn_key=(family.stream, k))
    return case_scene(family, value, SPACE, seed)


def test_the_protocols_words_are_the_scenes() -> None:
    assert set(CANDIDATES) == set(typing.get_args(Press)) == set(NEEDS)


@given(st.sampled_from(PRESSED), st.integers(0, 10_000))
def test_a_press_is_repeated_by_its_seed(name: str, k: int) -> None:
    for value in KEYS.family(name).pressed_values[:2]:
        assert scene(name, value, k) == scene(name, value, k)


@given(
    st.lists(
        st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.05, 6)), min_size=1, max_size=6
    ),
    st.sampled_from([20.0, float("inf")]),
)
def test_every_tip_reaches_its_depth(tips: list[tuple[float, float, float]], dome: float) -> None:
    table = np.array(tips)
    made = scene_of_depths(table[:, :2], table[:, 2], 3.0, dome, "made")
    assert tip_depths(made, dome) == pytest.approx(table[:, 2], abs=1e-9)
    assert tip_positions(made)[:, :2] == pytest.approx(table[:, :2], abs=1e-9)


@pytest.mark.parametrize("name", [n for n in PRESSED if n != "edge"])
def test_tips_lie_in_the_workspace(name: str) -> None:
    for value in KEYS.family(name).pressed_values:
        for k in range(5):
            assert np.abs(tip_positions(scene(name, value, k))[:, :2]).max() < 6.4 + 1e-6


def test_nothing_presses_an_empty_frame() -> None:
    assert not any(len(true_contacts(scene("empty", 0, k))) for k in range(20))


def test_plain_presses_are_those_that_exp1_could_have_drawn() -> None:
    from tactibench.frames import could_be_drawn
    from tactibench.protocols import fits

    exp1 = load_protocol("exp1").spec
    made = [scene("plain", 0, k) for k in range(50)]
    assert all(fits(one, exp1.workspace) for one in made)
    assert all(could_be_drawn(one, exp1.draw("singles"), exp1.workspace) for one in made)
    depths = [one.pose.depth for one in made]
    assert min(depths) < 1.5
    assert max(depths) > 5


@pytest.mark.parametrize("name", ["grazing", "deep"])
def test_depth_is_the_value_and_places_stay(name: str) -> None:
    family = KEYS.family(name)
    places = set()
    for value in family.pressed_values:
        made = scene(name, value, 3)
        assert true_contacts(made).depth == pytest.approx([value])
        places.add((made.pose.x, made.pose.y))
    assert len(places) == 1


@pytest.mark.parametrize("name", ["sharp", "blunt"])
def test_the_radius_is_the_value(name: str) -> None:
    for value in KEYS.family(name).pressed_values:
        assert scene(name, value).indenter.radius == value


def test_a_sheared_tip_ends_at_one_place_after_ways_of_one_direction() -> None:
    ways = KEYS.family("sheared").pressed_values
    made = [scene("sheared", way, 4) for way in ways]
    assert len({(one.pose.x, one.pose.y, one.pose.depth) for one in made}) == 1
    moved = np.array([(one.pose.dx, one.pose.dy) for one in made])
    assert np.hypot(*moved.T) == pytest.approx(ways)
    assert np.cross(np.c_[moved, 0 * moved[:, :1]], [*moved[-1], 0]) == pytest.approx(0)


def test_the_edge_is_a_share_of_the_domes_radius() -> None:
    for value in KEYS.family("edge").pressed_values:
        (place,) = true_contacts(scene("edge", value)).xy
        assert np.hypot(*place) == pytest.approx(20 * value)


@pytest.mark.parametrize("name", ["near", "identical", "symmetric"])
def test_two_tips_are_so_far_apart(name: str) -> None:
    for value in KEYS.family(name).pressed_values:
        for k in range(5):
            truth = true_contacts(scene(name, value, k))
            assert len(truth) == 2
            assert np.linalg.norm(truth.xy[0] - truth.xy[1]) == pytest.approx(value)
            if name == "near":
                heights = tip_positions(scene(name, value, k))[:, 2]
                assert np.ptp(heights) == pytest.approx(0, abs=1e-9)
            else:
                assert np.ptp(truth.depth) == pytest.approx(0, abs=1e-9)
            if name == "symmetric":
                assert truth.xy.sum(axis=0) == pytest.approx([0, 0], abs=1e-9)


def test_beside_a_deep_tip_the_other_has_its_share() -> None:
    for value in KEYS.family("beside").pressed_values:
        depth = true_contacts(scene("beside", value)).depth
        assert depth.min() / depth.max() == pytest.approx(value)
        assert 3 <= depth.max() <= 5


def test_many_tips_stand_on_a_circle() -> None:
    for value in KEYS.family("many").pressed_values:
        truth = true_contacts(scene("many", value))
        assert len(truth) == value
        if value > 1:
            middle = truth.xy.mean(axis=0)
            assert np.linalg.norm(truth.xy - middle, axis=1) == pytest.approx(6.0)


def test_an_indenter_that_fits_nowhere_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tactibench.frames.hard_cases.PATIENCE", 100)
    wide = Family(
        name="wide",
        title="",
        harder="falling",
        easy=40.0,
        values=(30.0,),
        stream=9,
        press="distance",
        radius_mm=3.0,
    )
    with pytest.raises(UserError, match="family 'wide': none of 100 candidates of 30"):
        case_scene(wide, 30.0, SPACE, np.random.SeedSequence(0))
