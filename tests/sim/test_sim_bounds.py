"""The bounds that ship are those that the tables and the reference scenes give."""

import json
import math
import sys
from dataclasses import fields

import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import UserError
from tactibench_sim import reference, tabulate_bounds
from tactibench_sim.bounds import FILE, Bounds, bounds_for
from tactibench_sim.command import sim
from tactibench_sim.field import Mechanics
from tactibench_sim.table import shipped
from tactibench_sim.tabulate_bounds import envelope, measured, reached, write

TABLES, SCENES = shipped(), reference.shipped()


@pytest.fixture(scope="module")
def found():
    return measured(TABLES, SCENES)


def test_the_bounds_that_ship_are_measured(found):
    ours = bounds_for(TABLES.digest)
    for field in fields(Bounds):
        told, again = getattr(ours, field.name), getattr(found, field.name)
        assert told == pytest.approx(again, abs=1.1e-4), field.name
        assert (told >= again - 1e-6).all(), field.name  # rounded up


def test_the_command_writes_them_without_finite_elements(tmp_path, monkeypatch, found):
    monkeypatch.setitem(sys.modules, "ngsolve", None)
    monkeypatch.setattr(tabulate_bounds, "measured", lambda *given: found)
    out = tmp_path / FILE
    result = CliRunner().invoke(sim, ["tabulate", str(out), "--bounds"], catch_exceptions=False)
    assert result.exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
    told = json.loads(out.read_text())
    assert told["tables"] == TABLES.digest
    assert told["pair"][-1] is None  # no pair is so deep


@pytest.mark.parametrize("more", [["--planar"], ["--radius", "4"], ["--domes"], ["--skin", "2"]])
def test_the_command_takes_no_other_option_beside_them(tmp_path, monkeypatch, more):
    monkeypatch.setattr("tactibench_sim.fem.require_ngsolve", lambda: None)
    result = CliRunner().invoke(sim, ["tabulate", str(tmp_path / "b.json"), "--bounds", *more])
    assert isinstance(result.exception, UserError)
    assert "no other option" in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_writing_rounds_up_and_keeps_infinity(tmp_path):
    one = np.array([0.0, 0.2, 0.123401, 0.1234, np.inf])
    bounds = Bounds(one, one, one[None], one, one, one, one, one[None, None])
    digest = write(tmp_path / "b.json", TABLES, bounds)
    assert len(digest) == 64
    told = json.loads((tmp_path / "b.json").read_text())
    assert told["depth"] == [0.0, 0.2, 0.1235, 0.1234, None]
    assert told["added"] == [[told["depth"]]]


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


def test_what_no_scene_says_is_unknown():
    """One pair is all there is: nothing is known of single contacts, of three, or deeper."""
    pair = next(s for s in SCENES if len(s.tips) == 2 and abs(s.depth - 2) < 1e-6)
    found = measured(TABLES, [pair])
    assert np.isinf(found.single).all()
    assert np.isinf(found.many).all()
    assert np.isfinite(found.pair).tolist() == [True, True, False, False, False, False]
    assert np.isinf(found.added[1:, 5, 1:]).all()
    assert (found.added[:, 0] == 0).all()


def test_superposing_bounds_hold_the_difference_of_the_tiers(found):
    """Where both tiers are compared again, between the angles and depths of the table."""
    coupled, superposed = Mechanics(TABLES, "coupled"), Mechanics(TABLES, "superpose")
    for scene in SCENES:
        if len(scene.tips) != 2:
            continue
        loads = coupled.loads(scene.asked)
        fields = [
            tier.displacement(tier.loads(scene.asked), scene.directions)[0]
            for tier in (coupled, superposed)
        ]
        apart = np.linalg.norm(fields[0] - fields[1], axis=-1).max()
        angle = math.acos(min(1.0, loads.n[0, 0] @ loads.n[0, 1]))
        first, second = loads.delta[0]
        assert apart <= found.superposing(*(np.array([v]) for v in (angle, first, second)))[0]


def test_the_table_is_symmetric_and_grows_with_depth(found):
    assert found.added == pytest.approx(found.added.swapaxes(1, 2), abs=1e-6)
    diagonal = np.diagonal(found.added, axis1=1, axis2=2)
    assert (np.diff(diagonal, axis=1) > 0).all()
    assert (np.diff(found.pair[:5]) >= 0).all()
