"""Error bounds of the tiers: those in the repository are what tables and reference scenes give."""

import json
import math
from dataclasses import fields

import error_bounds
import numpy as np
import pytest
from error_bounds import Bounds, envelope, measured, reached, write

from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.mechanics.tables import shipped
from tactibench_sim.reference_frames import scenes as reference

TABLES, SCENES = shipped(), reference.shipped()
COUPLED, SUPERPOSED = (TableMechanics(TABLES, tier) for tier in ("coupled", "superpose"))


@pytest.fixture(scope="module")
def bounds():
    return measured(TABLES, SCENES)


def test_the_committed_bounds_are_measured_and_of_the_tables_that_ship(bounds):
    digest, committed = error_bounds.read()
    assert digest == TABLES.digest
    for field in fields(Bounds):
        stored, again = getattr(committed, field.name), getattr(bounds, field.name)
        assert stored == pytest.approx(again, abs=1.1e-4), field.name
        assert (stored >= again - 1e-6).all(), field.name  # rounded up
    assert np.isinf(committed.pair[-1])  # no pair is so deep


def test_no_reference_scene_is_worse_than_its_bound():
    _, committed = error_bounds.read()
    for scene in SCENES:
        bound = committed.of_scenes(*scene.as_tips.directions())
        for mechanics, most in zip((SUPERPOSED, COUPLED), bound, strict=True):
            u, _ = mechanics.displacement(mechanics.loads(scene.as_tips), scene.directions)
            error = np.linalg.norm(u[0] - scene.displacement, axis=1).max()
            assert error <= most[0] + 2e-3, scene.name


def test_superposing_bounds_hold_the_difference_of_the_tiers(bounds):
    """Where both tiers are compared again, between the angles and depths of the table."""
    for scene in SCENES:
        if len(scene.tips) != 2:
            continue
        loads = COUPLED.loads(scene.as_tips)
        fields = [
            tier.displacement(tier.loads(scene.as_tips), scene.directions)[0]
            for tier in (COUPLED, SUPERPOSED)
        ]
        apart = np.linalg.norm(fields[0] - fields[1], axis=-1).max()
        angle = math.acos(min(1.0, loads.n[0, 0] @ loads.n[0, 1]))
        first, second = loads.delta[0]
        assert apart <= bounds.superposing(*(np.array([v]) for v in (angle, first, second)))[0]


def test_the_table_is_symmetric_and_grows_with_depth(bounds):
    assert bounds.added == pytest.approx(bounds.added.swapaxes(1, 2), abs=1e-6)
    diagonal = np.diagonal(bounds.added, axis1=1, axis2=2)
    assert (np.diff(diagonal, axis=1) > 0).all()
    assert (np.diff(bounds.pair[:5]) >= 0).all()


def test_what_no_scene_says_is_unknown():
    """One pair is all there is: nothing is known of single contacts, of three, or deeper."""
    pair = next(s for s in SCENES if len(s.tips) == 2 and abs(s.depth - 2) < 1e-6)
    bounds = measured(TABLES, [pair])
    assert np.isinf(bounds.single).all()
    assert np.isinf(bounds.many).all()
    assert np.isfinite(bounds.pair).tolist() == [True, True, False, False, False, False]
    assert np.isinf(bounds.added[1:, 5, 1:]).all()
    assert (bounds.added[:, 0] == 0).all()


def test_writing_rounds_up_and_keeps_infinity(tmp_path):
    values = np.array([0.0, 0.2, 0.123401, 0.1234, np.inf])
    row = values[None]
    bounds = Bounds(values, values, row, values, values, values, values, row[None])
    assert len(write(tmp_path / "b.json", TABLES, bounds)) == 64
    content = json.loads((tmp_path / "b.json").read_text())
    assert content["depth"] == [0.0, 0.2, 0.1235, 0.1234, None]
    assert content["added"] == [[content["depth"]]]


def test_an_envelope_never_falls():
    deepest, errors = np.array([0.5, 1.5, 2.5]), np.array([0.1, 0.3, 0.2])
    assert envelope([1.0, 2.0, 3.0], deepest, errors).tolist() == [0.1, 0.3, 0.3]
    assert envelope([1.0], np.zeros(0), np.zeros(0)).tolist() == [0.0]


def test_a_node_is_known_where_scenes_come_near_it():
    nodes = [1.0, 2.0, 4.0]
    assert reached(nodes, np.array([0.4])).tolist() == [False, False, False]
    assert reached(nodes, np.array([0.5, 1.5])).tolist() == [True, True, False]
    assert reached(nodes, np.array([3.0])).tolist() == [True, True, True]
    assert not reached(nodes, np.zeros(0)).any()
