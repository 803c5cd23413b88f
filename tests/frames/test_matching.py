"""Recorded presses for protocols that draw theirs: which match, which train, what is lacking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from few_presses import few_presses
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.frames import could_be_drawn, divide_by_parts, match
from tactibench.protocols import draw_scenes, load_protocol

EXP1, EXP2, EXP3 = (load_protocol(name).spec for name in ("exp1", "exp2", "exp3"))
SINGLE = Scene(Indenter.single(), Pose(1.0, 2.0, depth=3.0))


@pytest.mark.parametrize("name", ["exp1", "exp2", "exp3"])
def test_what_a_protocol_draws_matches_its_draw(name, tmp_path):
    spec = load_protocol(str(few_presses(tmp_path / "protocols")[name])).spec
    for draw in spec.draws:
        for scene in draw_scenes(spec, draw.name).scenes[:10]:
            assert could_be_drawn(scene, draw, spec.workspace)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(Indenter.plate(), Pose(depth=3.0)),
        Scene(Indenter.single(2.5), SINGLE.pose),
        replace(SINGLE, pose=Pose(7.0, 0.0, depth=3.0)),
        replace(SINGLE, pose=Pose(0.0, 0.0, depth=0.2)),
        replace(SINGLE, pose=Pose(0.0, 0.0, depth=6.2)),
        replace(SINGLE, pose=Pose(0.0, 0.0, tilt=5.0, depth=3.0)),
        Scene(Indenter.dual(8.0), Pose(depth=3.0)),
    ],
)
def test_presses_that_the_draw_could_not_make(scene):
    assert could_be_drawn(SINGLE, EXP1.draw("singles"), EXP1.workspace)
    assert not could_be_drawn(scene, EXP1.draw("singles"), EXP1.workspace)


def test_pairs_and_triples_by_their_geometry():
    pairs, triples = EXP2.draw("pairs"), EXP3.draw("triples")
    deep = Pose(depth=4.0)
    assert could_be_drawn(Scene(Indenter.dual(6.5), deep), pairs, EXP2.workspace)
    assert not could_be_drawn(Scene(Indenter.dual(6.6), deep), pairs, EXP2.workspace)
    uneven = replace(Indenter.dual(8.0), offsets=((-4.0, 0.0, 0.0), (4.0, 0.0, 0.5)))
    assert not could_be_drawn(Scene(uneven, deep), pairs, EXP2.workspace)
    assert could_be_drawn(Scene(Indenter.triple((0.0, 0.5, 0.0)), deep), triples, EXP3.workspace)
    assert not could_be_drawn(
        Scene(Indenter.triple((0.0, 0.3, 0.0)), deep), triples, EXP3.workspace
    )
    assert not could_be_drawn(
        Scene(Indenter.triple((0.0, 0.5, 0.0), side=7.0), deep), triples, EXP3.workspace
    )


def singles(count):
    rng = np.random.default_rng(0)
    return [
        Scene(Indenter.single(), Pose(*map(float, rng.uniform(-6, 6, 2)), depth=2.0))
        for _ in range(count)
    ]


@settings(max_examples=30)
@given(st.integers(3, 120), st.integers(1, 4))
def test_a_press_is_in_one_part_and_none_is_lost(count, size):
    presses = [f"p{i // size}" for i in range(count)]
    found = match(EXP1, EXP1.split, "single", singles(count), presses)
    parts = [
        set(found.fit["singles"]),
        set(found.validation["singles"]),
        set(found.test["singles"]),
    ]
    assert sum(map(len, parts)) == len(set.union(*parts)) == count
    owners = [{presses[row] for row in part} for part in parts]
    assert not owners[0] & owners[1]
    assert not (owners[0] | owners[1]) & owners[2]
    if count // size >= 10:
        assert found.lacking == ()
        assert abs(len(owners[2]) - 0.2 * len(set(presses))) <= 1


def test_the_division_follows_the_data_seed_alone():
    presses = [f"p{i}" for i in range(50)]
    first, second = (match(EXP1, EXP1.split, "single", singles(50), presses) for _ in range(2))
    assert first == second
    other = EXP1.model_copy(update={"data_seed": 1})
    assert match(other, other.split, "single", singles(50), presses).test != first.test


def test_a_recording_with_its_own_split_is_divided_by_it():
    pairs = [Scene(Indenter.dual(8.0), Pose(0.0, 0.0, float(yaw), depth=3.0)) for yaw in range(4)]
    scenes, presses = [*singles(6), *pairs], [str(i) for i in range(10)]
    parts = ["train", "test", "validation", "", "train", "test", "train", "test", "", "test"]
    found = match(EXP2, EXP2.split, "single", scenes, presses, parts)
    assert found.fit == {"singles": [0, 4]}
    assert found.validation == {"singles": [2]}
    assert found.test == {"pairs": [7, 9], "catch": [1, 5]}
    both = match(EXP2, EXP2.split, "multiple", scenes, presses, parts)
    assert (both.fit["singles"], both.fit["duals-train"]) == ([0, 4], [6])


def test_a_split_of_a_recording_needs_every_part_and_keeps_presses_whole():
    assert divide_by_parts(["test", "train", "", "validation"], "abcd") == ((1,), (3,), (0,))
    with pytest.raises(UserError, match="part 'validation'"):
        divide_by_parts(["test", "train"], "ab")
    with pytest.raises(UserError, match="two parts"):
        divide_by_parts(["test", "train", "validation"], "aba")


def test_what_is_lacking_is_named_and_what_fits_nowhere_counted():
    scenes = [*singles(30), Scene(Indenter.plate(), Pose(depth=2.0))]
    presses = [str(i) for i in range(31)]
    assert match(EXP2, EXP2.split, "single", scenes, presses).lacking == ("pairs",)
    assert match(EXP3, EXP3.split, "single", scenes, presses).lacking == ("duals", "triples")
    assert match(EXP1, EXP1.split, "single", scenes, presses).left_out == 1
    assert match(EXP1, EXP1.split, "single", scenes[-1:], presses[-1:]).lacking == ("singles",)


def test_catch_trials_come_from_the_tested_presses_and_pairs_are_halved_for_training():
    pairs = [
        Scene(Indenter.dual(float(d)), Pose(0.0, 0.0, float(yaw), depth=3.0))
        for d in (7.0, 8.0)
        for yaw in range(0, 180, 10)
    ]
    triples = [
        Scene(Indenter.triple((0.0, 0.5, 0.0)), Pose(0.0, 0.0, float(y), depth=4.0))
        for y in range(20)
    ]
    scenes = [*singles(40), *pairs, *triples]
    presses = [str(i) for i in range(len(scenes))]
    found = match(EXP2, EXP2.split, "multiple", scenes, presses)
    assert found.lacking == ()
    assert not set(found.test["catch"]) & {*found.fit["singles"], *found.validation["singles"]}
    assert not set(found.test["pairs"]) & set(found.fit["duals-train"])
    assert len(found.test["pairs"]) + len(found.fit["duals-train"]) == len(pairs)
    assert len(found.fit["triples-train"]) == len(triples)
