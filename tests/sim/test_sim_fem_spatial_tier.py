"""Tier `fem` and the runs that corrections are learned from, without long runs."""

import math

import numpy as np
import pytest
import snapshots
import tabulate_dome as maker
from snapshots import Run

from tactibench import UserError
from tactibench_sim import fem
from tactibench_sim.fem.press import Fineness, SpatialPress
from tactibench_sim.mechanics import tables as table_file
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.corrections import Corrections
from tactibench_sim.mechanics.finite_elements import FemMechanics
from tactibench_sim.pins import layout

pytest.importorskip("ngsolve", reason="needs the extra `fem`")

COARSE = Fineness(contact=0.8, largest=4.0, margin=0.5, far=9.0)
PINS = layout(127)


@pytest.fixture(scope="module")
def mechanics():
    return FemMechanics(table_file.shipped(), COARSE)


def tips(*each, radius=3.0):
    at = np.array(each, dtype=float)
    return Tips(at[None, :, :2], at[None, :, 2], np.array([radius]))


def test_untouched_is_rest(mechanics):
    loads = mechanics.loads(tips((0, 0, -0.5), (5, 0, 0.0)))
    u, q = mechanics.displacement(loads, PINS)
    assert not u.any()
    assert not q.any()
    assert not mechanics.skin(loads, PINS).any()
    assert (mechanics.pin_tips(loads, PINS, 2.0)[0] == 19 * PINS - 2 * PINS).all()


def test_a_press_turned_about_the_axis_is_the_same_press(mechanics):
    loads = [mechanics.loads(tips((6 * c, 6 * s, 0.3))) for c, s in ((1, 0), (0.6, 0.8))]
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    for one, other in zip(
        mechanics.displacement(loads[0], PINS),
        mechanics.displacement(loads[1], PINS @ turn),
        strict=True,
    ):
        assert other[0] == pytest.approx(one[0] @ turn, abs=1e-9)
    u, q = mechanics.displacement(loads[0], PINS)
    angle = np.linalg.norm(q[0], axis=1)[:, None]
    normal = PINS * np.cos(angle) + q[0] * np.sinc(angle / np.pi)
    expected = 19 * PINS + u[0] - 2 * normal
    assert mechanics.pin_tips(loads[0], PINS, 2.0)[0] == pytest.approx(expected, abs=1e-12)
    under = np.array([[6.0, 0, math.sqrt(400 - 36)]]) / 20
    assert mechanics.skin(loads[0], under)[0, 0] == pytest.approx(0.3, abs=0.08)


@pytest.mark.parametrize(
    ("where", "told"), [((22, 0, 0.5), "from the apex"), ((0, 0, 12.0), "penetrates 12.00 mm")]
)
def test_out_of_reach_is_refused(mechanics, where, told):
    with pytest.raises(UserError, match=told):
        mechanics.loads(tips(where))


def test_a_run_that_does_not_converge_is_refused(mechanics, monkeypatch):
    def move(self, depths):
        raise fem.NotConvergedError("no")

    monkeypatch.setattr(SpatialPress, "move", move)
    with pytest.raises(UserError, match="did not converge"):
        mechanics.loads(tips((0, 0, 0.5)))


def test_the_plan():
    runs = snapshots.plan((3.0, math.inf))
    assert len({run.name for run in runs}) == len(runs) == 14
    assert {run.radius for run in runs if run.pair} == {3.0}
    pair = Run(3.0, 14.0, True)
    depths = pair.depths()
    assert len({tuple(row) for row in depths}) == len(depths) == 15
    assert (depths[:, 0] >= depths[:, 1]).all()
    centres = np.array([tip.axis for tip in pair.tips(fem.Dome())])
    assert math.degrees(math.acos(centres[0] @ centres[1])) == pytest.approx(14)
    assert centres[1][0] > 0
    frame = Run(3.0, 40.0, False).frame()
    assert frame @ frame.T == pytest.approx(np.eye(3))
    assert frame[0, 2] < 0  # e points down the side


class Linear:
    """A field whose displacement is a constant matrix times the direction."""

    matrix = np.arange(9.0).reshape(3, 3)

    def inner(self, directions):
        return directions @ self.matrix.T

    def outer(self, directions):
        return 2 * self.inner(directions)


def test_samples_are_along_the_frame_of_the_contact():
    run = Run(3.0, 40.0, False)
    inner, outer = snapshots.sampled(Linear(), run)
    local, frame = run.chart.directions(), run.frame()
    there = (local @ frame)[..., 2] > 1e-3
    assert (np.isnan(inner).all(axis=-1) == ~there).all()
    expected = local[there] @ (frame @ Linear.matrix @ frame.T).T
    assert inner[there] == pytest.approx(expected)
    assert outer[there] == pytest.approx(2 * expected)


def invented(run, dome):
    for row in run.depths():
        yield np.full((2, *run.chart.directions().shape), row.sum() * run.degrees)


def test_an_interrupted_tabulation_goes_on(tmp_path, monkeypatch):
    made = []

    def failing(run, *more):
        made.append(run.name)
        if len(made) == 3:
            raise fem.NotConvergedError("beyond")
        return invented(run, *more)

    monkeypatch.setattr(snapshots, "states", failing)
    with pytest.raises(fem.NotConvergedError):
        snapshots.make(tmp_path / "runs", fem.Dome(), snapshots.plan((3.0,)))
    assert len(list((tmp_path / "runs").iterdir())) == 2
    singles, pairs = snapshots.make(tmp_path / "runs", fem.Dome(), snapshots.plan((3.0,)))
    assert len(made) == 3 + 8  # the two that were there are not made again
    assert (len(singles), len(pairs)) == (4, 6)
    assert singles[1].beta == pytest.approx(math.radians(20))
    assert singles[1].depths == pytest.approx(np.arange(1, 14) / 2)
    assert singles[1].displacement[2] == pytest.approx(1.5 * 20)
    assert singles[1].chart.reach == 120
    assert pairs[0].depths[1] == pytest.approx([1.75, 1.75])
    with pytest.raises(UserError, match="another dome"):
        snapshots.make(tmp_path / "runs", fem.Dome(skin=2.0), snapshots.plan((3.0,)))
    next((tmp_path / "runs").glob("*_9.npz")).write_bytes(b"no")
    with pytest.raises(UserError, match="cannot be read"):
        snapshots.make(tmp_path / "runs", fem.Dome(), snapshots.plan((3.0,)))


@pytest.mark.parametrize(("degrees", "pair"), [(55.0, False), (9.0, True)])
@pytest.mark.parametrize("reached", [7, 10])
def test_only_a_single_contact_may_end_early(tmp_path, monkeypatch, degrees, pair, reached):
    """A plate far from the apex meets the rim: what lies before it counts from 4 mm on."""

    def ending(run, *more):
        for k, state in enumerate(invented(run, *more)):
            if (run.degrees, run.pair) == (degrees, pair) and k == reached:
                raise fem.NotConvergedError("beyond")
            yield state

    monkeypatch.setattr(snapshots, "states", ending)
    if pair or reached == 7:
        with pytest.raises(fem.NotConvergedError):
            snapshots.make(tmp_path, fem.Dome(), snapshots.plan((3.0,)))
    else:
        singles, _ = snapshots.make(tmp_path, fem.Dome(), snapshots.plan((3.0,)))
        assert singles[-1].depths == pytest.approx(np.arange(1, 11) / 2)
        assert len(singles[-1].displacement) == 10


def columns(dome, radius, delta, polar):
    field = np.outer(delta, np.cos(polar))
    names = ("w", "t", "omega", "w_outer", "t_outer")
    return {**dict.fromkeys(names, field), "force": delta}


def test_the_command_writes_corrections(tmp_path, monkeypatch):
    def learned(singles, pairs, tables):
        assert (len(singles), len(pairs)) == (4, 6)
        assert list(tables.by_radius) == [3.0]
        return Corrections({"around_amounts": np.ones((1, 4, 4, 1))}, {"around_radii": [3.0]})

    monkeypatch.setattr(maker, "columns", columns)
    monkeypatch.setattr(snapshots, "states", invented)
    monkeypatch.setattr(snapshots, "corrections_from", learned)
    out = tmp_path / "dome.npz"
    maker.main([str(out), "--radius", "3", "--corrections", str(tmp_path / "runs")])
    tables = table_file.read(out)
    assert tables.corrections.arrays["around_amounts"].all()
    assert tables.corrections.grid == {"around_radii": [3.0]}
    assert tables.parameters["spatial"]["mesh"]["far"] == 4.5
