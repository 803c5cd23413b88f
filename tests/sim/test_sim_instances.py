"""Other sensors of the same kind: their domes' tables, drawn and interpolated."""

import json
import math
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
import tabulate_instances
from hard_scenes import enclosed_volume
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import fem, instances
from tactibench_sim.instances import RATIO_FACTOR, SKIN_FACTOR, dome_of
from tactibench_sim.mechanics import tables as table_file
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.pins import layout
from tactibench_sim.sensor import TacTip127

SHIPPED = files("tactibench_sim").joinpath(instances.FILE)
NOMINAL, DOMES = table_file.shipped(), instances.shipped()
ALL = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]
few = settings(max_examples=12)
anywhere = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
FIELDS = ("w", "t", "omega", "w_outer", "t_outer")


def test_instance_0_is_the_nominal_table():
    assert dome_of(0) == (0.0, 0.0)
    assert instances.instance_tables(NOMINAL, 0) is NOMINAL
    assert DOMES.tables(NOMINAL, 0.0, 0.0) is NOMINAL


def test_domes_are_drawn_once_and_over_the_whole_range():
    drawn = np.array([dome_of(n) for n in range(1, 2001)])
    assert dome_of(7) == dome_of(7)
    assert len(np.unique(drawn)) == drawn.size
    assert abs(drawn).max() <= 1
    shares = np.histogram2d(*drawn.T, bins=4, range=[[-1, 1]] * 2)[0] / len(drawn)
    assert shares == pytest.approx(1 / 16, abs=0.02)


def test_the_ranges_are_the_stated_ones():
    told = [DOMES.tables(NOMINAL, x, y).parameters["dome"] for x, y in ((-1, -1), (1, 1))]
    assert [d["stiffness_ratio"] for d in told] == pytest.approx([25, 100])
    assert [d["skin"] for d in told] == pytest.approx([0.8, 1.25])


@pytest.mark.parametrize("radius", NOMINAL.by_radius)
@pytest.mark.parametrize("node", [n for n in ALL if n != (0, 0)])
def test_a_computed_dome_is_met(radius, node):
    one, base = DOMES.tables(NOMINAL, *node).by_radius[radius], NOMINAL.by_radius[radius]
    kept = DOMES.by_shape[table_file.shape_name(radius)]
    every = tabulate_instances.EVERY
    for name in FIELDS:
        change = (one.fields[name] - base.fields[name])[::every, ::every]
        assert change == pytest.approx(kept[name][node[0] + 1, node[1] + 1], abs=1e-12)
    force = (one.fields["force"] - base.fields["force"])[::every]
    assert force == pytest.approx(kept["force"][node[0] + 1, node[1] + 1], abs=1e-12)


@few
@given(anywhere, st.sampled_from([(1e-6, 0.0), (0.0, -1e-6), (-1e-6, 1e-6)]))
def test_near_domes_are_near(at, step):
    at = (min(max(at[0], -0.99), 0.99), min(max(at[1], -0.99), 0.99))
    one, other = (
        DOMES.tables(NOMINAL, *where).by_radius[3.0].fields
        for where in (at, (at[0] + step[0], at[1] + step[1]))
    )
    for name in FIELDS:
        assert abs(one[name] - other[name]).max() < 3e-6


@few
@given(anywhere)
def test_what_mechanics_demands_holds_between_computed_domes(at):
    tables = DOMES.tables(NOMINAL, *at)
    inner = 20.0 - tables.parameters["dome"]["skin"]
    for one in tables.by_radius.values():
        assert one.fields["force"][0] == 0
        assert (np.diff(one.fields["force"]) > 0).all()
        assert one.fields["w_outer"][:, 0] == pytest.approx(one.delta, abs=0.008)
        for name in FIELDS:
            assert (one.fields[name][0] == NOMINAL.by_radius[one.radius].fields[name][0]).all()
        for name in ("t", "omega", "t_outer"):
            assert abs(one.fields[name][:, 0]).max() < 1e-12
        for which, radius in (("", inner), ("_outer", 20.0)):
            start = enclosed_volume(radius, one.polar, 0 * one.polar, 0 * one.polar)
            for row in (8, 24, 48):
                w, t = one.fields[f"w{which}"][row], one.fields[f"t{which}"][row]
                dimple = start - enclosed_volume(radius, one.polar, np.maximum(w, 0), 0 * w)
                change = enclosed_volume(radius, one.polar, w, t) - start
                assert abs(change) < 0.01 * dimple


@few
@given(st.floats(-1, 1), st.floats(-1, 0.9))
def test_a_stiffer_gel_and_a_thicker_skin_take_more_force(fixed, low):
    """Forces are in units of the skin's modulus: a greater ratio is a softer gel."""
    for radius in NOMINAL.by_radius:
        soft, stiff, thin, thick = (
            DOMES.tables(NOMINAL, *at).by_radius[radius].fields["force"][1:]
            for at in ((low + 0.1, fixed), (low, fixed), (fixed, low), (fixed, low + 0.1))
        )
        assert (stiff > soft).all()
        assert (thick > thin).all()


def test_an_individual_is_told_apart():
    several = [instances.instance_tables(NOMINAL, n) for n in (0, 1, 2, 3)]
    again = instances.instance_tables(NOMINAL, 2)
    assert len({one.digest for one in several}) == 4
    assert all(len(one.digest) == 64 for one in several)
    assert again.digest == several[2].digest
    assert again.parameters["instance"] == 2
    assert again.parameters["between"] == DOMES.digest
    assert json.loads(json.dumps(again.parameters)) == again.parameters
    assert NOMINAL.parameters == table_file.shipped().parameters
    assert "instance" not in NOMINAL.parameters


def test_corrections_are_those_of_the_nominal_dome():
    assert instances.instance_tables(NOMINAL, 5).corrections is NOMINAL.corrections


@pytest.mark.parametrize("tier", ["superpose", "coupled"])
def test_pins_stand_on_the_individuals_own_skin(tier):
    tables = instances.instance_tables(NOMINAL, 4)
    dome, pins = TableMechanics(tables, tier), layout(127)
    none = dome.loads(Tips(np.zeros((1, 1, 2)), np.full((1, 1), -np.inf), np.full(1, 3.0)))
    skin = SKIN_FACTOR ** dome_of(4)[1]
    assert abs(skin - 1) > 0.02
    rest = dome.pin_tips(none, pins, 2.0)[0]
    assert np.linalg.norm(rest, axis=1) == pytest.approx(20.0 - skin - 2.0)
    deep = dome.loads(Tips(np.zeros((1, 1, 2)), np.full((1, 1), 4.0), np.full(1, 3.0)))
    nominal = TableMechanics(NOMINAL, tier)
    moved = [one.displacement(deep, pins)[0] for one in (dome, nominal)]
    assert 0.02 < abs(moved[0] - moved[1]).max() < 1.0


def sensor(instance, **parameters):
    return TacTip127(SensorContext(np.random.SeedSequence(0)), instance=instance, **parameters)


def test_a_sensor_has_the_dome_of_its_instance():
    told = [sensor(n).describe()["tables"] for n in (0, 3, 3, 4)]
    assert told[0]["sha256"] == NOMINAL.digest
    assert told[1] == told[2]
    assert told[1]["sha256"] != told[3]["sha256"]
    x, y = dome_of(3)
    assert told[1]["dome"]["stiffness_ratio"] == pytest.approx(50 * RATIO_FACTOR**x)
    assert told[1]["dome"]["skin"] == pytest.approx(SKIN_FACTOR**y)


@pytest.mark.parametrize("parameters", [{"instance": 3}, {"instance": 0, "instances": 2}])
def test_a_table_of_ones_own_has_no_instances(parameters):
    table = str(files("tactibench_sim.mechanics").joinpath(table_file.FILE))
    with pytest.raises(UserError, match=r"sensor\.instances?=\d is of others; leave one"):
        sensor(**parameters, table=table)


def test_a_radius_that_instances_do_not_have_is_refused_without_a_way_that_is_none():
    scene = Scene(Indenter.single(0.5), Pose(depth=0.3))
    with pytest.raises(UserError, match=r"radius is 0\.5 mm.*tables for: 3 mm, plate") as caught:
        sensor(1).press(scene)
    assert "tabulate" not in str(caught.value)


# -- the file


def test_the_file_is_small_and_of_the_table_that_ships():
    assert len(SHIPPED.read_bytes()) < 600_000
    assert DOMES.parameters["dome"] == NOMINAL.parameters["dome"]
    assert DOMES.parameters["ratio_factor"] == RATIO_FACTOR
    assert DOMES.parameters["skin_factor"] == SKIN_FACTOR


def test_differences_from_another_table_are_refused():
    with pytest.raises(UserError, match=r"sphere4.*scripts/fem/tabulate_instances.py"):
        DOMES.tables(_with(4.0), 0.5, 0.5)
    stiff = {**NOMINAL.parameters, "dome": {**NOMINAL.parameters["dome"], "stiffness_ratio": 60}}
    with pytest.raises(UserError, match=r"'stiffness_ratio': 60.*tabulate_instances.py"):
        DOMES.tables(table_file.Tables(stiff, "", NOMINAL.by_radius, NOMINAL.corrections), 0.5, 0.5)


def _with(radius):
    one = NOMINAL.by_radius[3.0]
    more = {**NOMINAL.by_radius, radius: table_file.Table(radius, one.delta, one.polar, one.fields)}
    return table_file.Tables(NOMINAL.parameters, "", more, NOMINAL.corrections)


def invented(dome, radius, delta, polar):
    """Columns quadratic in both logarithms, around the nominal ones."""
    x = math.log(dome.stiffness_ratio / 50) / math.log(RATIO_FACTOR)
    y = math.log(dome.skin) / math.log(SKIN_FACTOR)
    amount = 0.3 * x - 0.2 * x * x + 0.1 * y + 0.05 * x * x * y * y
    one, rows = NOMINAL.by_radius[radius], slice(None, None, tabulate_instances.EVERY)
    field = amount * np.outer(delta * (7 - delta), np.cos(2 * polar)) / 12
    out = {name: one.fields[name][rows] + field for name in FIELDS}
    return {**out, "force": one.fields["force"][rows] + amount * delta}


def test_a_dome_between_computed_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(tabulate_instances, "columns", invented)
    monkeypatch.setattr(fem, "require_ngsolve", lambda: SimpleNamespace(__version__="none"))
    told = []
    digest = tabulate_instances.tabulate_instances(tmp_path / "made.npz", NOMINAL, told.append)
    assert len(told) == 16
    made = instances.read(tmp_path / "made.npz")
    assert made.digest == digest
    for x, y in [(0.3, -0.7), (-0.5, 0.5), (1.0, 1.0)]:
        dome = fem.Dome(stiffness_ratio=50 * RATIO_FACTOR**x, skin=SKIN_FACTOR**y)
        got = made.tables(NOMINAL, x, y)
        assert fem.Dome(**got.parameters["dome"]) == dome
        for radius, one in got.by_radius.items():
            exact = invented(dome, radius, one.delta[::2], one.polar)
            for name in FIELDS:
                assert one.fields[name][::2] == pytest.approx(
                    exact[name], abs=2 * instances.QUANTUM
                )
            assert one.fields["force"][::2] == pytest.approx(exact["force"], abs=1e-6)


def test_a_run_that_does_not_converge_leaves_no_file(tmp_path, monkeypatch):
    def columns(dome, radius, delta, polar):
        if dome.skin > 1.2:
            raise fem.NotConvergedError("the finite-element run did not converge beyond 4.085")
        return invented(dome, radius, delta, polar)

    monkeypatch.setattr(tabulate_instances, "columns", columns)
    monkeypatch.setattr(fem, "require_ngsolve", lambda: SimpleNamespace(__version__="none"))
    with pytest.raises(fem.NotConvergedError):
        tabulate_instances.tabulate_instances(tmp_path / "made.npz", NOMINAL)
    assert not list(tmp_path.iterdir())


def test_a_difference_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="more than fits"):
        tabulate_instances.change("w", np.full((3, 4), 5.0), np.zeros((6, 4)))


@pytest.mark.slow
def test_finite_elements_between_computed_domes():
    """Ratio 37, skin 1.12 mm: about as far from the nine computed domes as a dome can be."""
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    x, y = math.log(37 / 50) / math.log(RATIO_FACTOR), math.log(1.12) / math.log(SKIN_FACTOR)
    one = DOMES.tables(NOMINAL, x, y).by_radius[3.0]
    dome = fem.Dome(stiffness_ratio=37.0, skin=1.12)
    rows = [0, 4, 8, 16, 24, 32, 40, 48, 52]
    exact = tabulate_instances.columns(dome, 3.0, one.delta[rows], one.polar)
    for name in FIELDS:
        assert one.fields[name][rows] == pytest.approx(exact[name], abs=0.006), name
    assert one.fields["force"][rows] == pytest.approx(exact["force"], rel=0.015)
