"""Drawn presses: inside the workspace, as many as asked for, the same everywhere."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.distance import pdist

from tactibench import Scene, UserError
from tactibench.geometry import true_contacts
from tactibench.protocols import PATIENCE, Protocol, SceneSet, draw_scenes, load_protocol

EXPERIMENTS = {name: load_protocol(name).spec for name in ("exp1", "exp2", "exp3")}
SHARED = ("singles", "duals-train", "triples-train")
"""Draws that the three have in common."""
DRAWS = {
    (name, draw.name)
    for name, spec in EXPERIMENTS.items()
    for draw in spec.draws
    if name == "exp1" or draw.name not in SHARED
}


@cache
def drawn_by(name: str, draw: str) -> SceneSet:
    return draw_scenes(EXPERIMENTS[name], draw)


def tips(scene: Scene) -> np.ndarray:
    """(K, 2) by complex rotation: another way than the code under test."""
    turn = np.exp(1j * math.radians(scene.pose.yaw))
    z = [complex(dx, dy) * turn for dx, dy, _ in scene.indenter.offsets]
    return np.array([[p.real + scene.pose.x, p.imag + scene.pose.y] for p in z])


@pytest.mark.parametrize(("name", "draw"), sorted(DRAWS))
def test_every_tip_touches_inside_the_ranges(name: str, draw: str) -> None:
    spec, drawn = EXPERIMENTS[name], drawn_by(name, draw)
    counts = {"singles": 5000, "pairs": 1200, "catch": 120, "between": 220, "unseen-pairs": 288}
    asked = spec.draw(draw)
    assert len(drawn.scenes) == counts.get(draw, asked.count)
    for scene in drawn.scenes[::5]:
        truth = true_contacts(scene, spec.workspace.dome_radius_mm)
        assert len(truth) == asked.tips
        assert np.abs(tips(scene)).max() <= 6.4 + 1e-9
        np.testing.assert_allclose(np.sort(truth.xy, 0), np.sort(tips(scene), 0), atol=1e-9)
        assert truth.depth.min() >= 0.5 - 1e-8
        assert truth.depth.max() <= 6.0 + 1e-8
        assert truth.depth.max() == pytest.approx(scene.pose.depth)


def test_hundred_pairs_at_every_distance() -> None:
    scenes = drawn_by("exp2", "pairs").scenes
    apart = [round(float(np.linalg.norm(np.diff(tips(s), axis=0))), 6) for s in scenes]
    steps = {6.5 + 0.5 * i: 100 for i in range(12)}
    assert {d: apart.count(d) for d in set(apart)} == steps


def test_triples_are_equilateral_with_heights_in_half_millimetres() -> None:
    heights = set()
    for scene in drawn_by("exp3", "triples").scenes:
        xy = tips(scene)
        sides = [np.linalg.norm(xy[i] - xy[i - 1]) for i in range(3)]
        assert sides == pytest.approx([8.0] * 3)
        heights |= {dz for _, _, dz in scene.indenter.offsets}
    assert heights == {0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0}


@pytest.mark.parametrize(("name", "draw"), [("exp2", "uneven"), ("exp3", "five")])
def test_scattered_tips_keep_their_distance_and_have_depths_of_their_own(
    name: str, draw: str
) -> None:
    asked, drawn = EXPERIMENTS[name].draw(draw), drawn_by(name, draw)
    depths, places = [], []
    for scene in drawn.scenes:
        truth = true_contacts(scene)
        assert pdist(truth.xy).min() >= (asked.apart_mm or 0.0) - 1e-9
        depths += truth.depth.tolist()
        places += truth.xy.tolist()
    assert uniform_p(depths, 0.5, 6.0) > 0.01
    # Tips that must be far apart crowd at the border, but to no side of it.
    assert np.abs(np.mean(places, axis=0)).max() < 4 * np.std(places) / math.sqrt(len(places))
    assert len({scene.indenter for scene in drawn.scenes}) == len(drawn.scenes)


def test_tips_that_hardly_fit_end_in_a_sentence() -> None:
    spec = EXPERIMENTS["exp3"]
    crowded = spec.draw("five").model_copy(update={"tip_count": 8, "apart_mm": 9.0})
    with pytest.raises(UserError, match=r"draw 'five': 8 tips 9\.0 mm apart hardly fit"):
        draw_scenes(spec.model_copy(update={"draws": (crowded,)}), "five")


def uniform_p(values: list[float], low: float, high: float) -> float:
    return float(stats.kstest(values, "uniform", args=(low, high - low)).pvalue)


def test_single_presses_and_yaw_are_uniform() -> None:
    poses = [scene.pose for scene in drawn_by("exp1", "singles").scenes]
    assert drawn_by("exp1", "singles").rejected == 0
    assert uniform_p([p.x for p in poses], -6.4, 6.4) > 0.01
    assert uniform_p([p.y for p in poses], -6.4, 6.4) > 0.01
    assert uniform_p([p.depth for p in poses], 0.5, 6.0) > 0.01
    # A square workspace favours its diagonals, so only the quarter turn is uniform for wide pairs;
    # the quarters of narrow ones are alike by symmetry.
    yaws = [s.pose.yaw for s in drawn_by("exp2", "pairs").scenes]
    quarters = [sum(q <= yaw / 90 < q + 1 for yaw in yaws) for q in range(4)]
    assert sum(quarters) == len(yaws)
    assert stats.chisquare(quarters).pvalue > 0.01


def test_the_same_draw_is_the_same_whatever_else_is_drawn() -> None:
    spec = EXPERIMENTS["exp2"]
    assert draw_scenes(spec, "catch") == drawn_by("exp2", "catch")
    alone = spec.model_copy(update={"draws": (spec.draw("catch"),)})
    assert draw_scenes(alone, "catch") == drawn_by("exp2", "catch")
    for name in ("exp2", "exp3"):
        for shared in SHARED:
            assert drawn_by(name, shared) == drawn_by("exp1", shared)


def test_streams_and_seeds_give_other_presses() -> None:
    spec = EXPERIMENTS["exp2"]
    other = spec.draw("catch").model_copy(update={"stream": 99})
    changed = spec.model_copy(update={"draws": (other,)})
    reseeded = spec.model_copy(update={"data_seed": spec.data_seed + 1})
    mine = {s.pose for s in drawn_by("exp2", "catch").scenes}
    for drawn in (draw_scenes(changed, "catch"), draw_scenes(reseeded, "catch")):
        assert not mine & {s.pose for s in drawn.scenes}
    every = [scene for draw in spec.draws for scene in drawn_by("exp2", draw.name).scenes]
    assert len({scene.pose for scene in every}) == len(every)


def recounted(spec: Protocol, name: str) -> SceneSet:
    """Draw again, candidate by candidate, and count by hand those that do not fit."""
    draw = spec.draw(name)
    rng = np.random.default_rng(np.random.SeedSequence(spec.data_seed, spawn_key=(draw.stream,)))
    accepted, rejected = [], 0
    from tactibench import Indenter, Pose

    while len(accepted) < 100:
        x, y = rng.uniform(-6.4, 6.4, 2)
        depth, yaw = rng.uniform(0.5, 6.0), rng.uniform(0, 360)
        scene = Scene(Indenter.dual(draw.distances_mm[0]), Pose(x, y, yaw, 0.0, depth))
        truth = true_contacts(scene)
        inside = np.abs(tips(scene)).max() <= 6.4
        if inside and len(truth) == 2 and truth.depth.min() >= 0.5:
            accepted.append(scene)
        else:
            rejected += 1
    return SceneSet(tuple(accepted), rejected)


def test_refused_candidates_are_counted() -> None:
    spec = EXPERIMENTS["exp2"]
    first = spec.draw("pairs").model_copy(update={"distances_mm": (12.0,)})
    only = spec.model_copy(update={"draws": (first,)})
    drawn = draw_scenes(only, "pairs")
    by_hand = recounted(only, "pairs")
    assert drawn.rejected == by_hand.rejected > 100
    assert [s.pose for s in drawn.scenes] == [s.pose for s in by_hand.scenes]


def test_a_workspace_without_room_ends_in_a_sentence() -> None:
    spec = EXPERIMENTS["exp2"]
    tight = spec.workspace.model_copy(update={"depth_min_mm": 5.9999})
    hopeless = spec.model_copy(update={"workspace": tight})
    with pytest.raises(UserError, match=f"'pairs': none of {PATIENCE:,} candidates at 12.0 mm"):
        draw_scenes(hopeless, "pairs")
