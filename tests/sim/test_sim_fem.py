"""The finite elements of scripts/fem: closed forms, what holds on any mesh, the shipped tables."""

import math

import axisymmetric
import numpy as np
import pytest
from axisymmetric import AxisymmetricPress, Pad, dome_meridian, press, press_pad
from elements import Dome, NotConvergedError, Settings
from friction import RubbingPress
from scipy.optimize import brentq
from spatial import Drag, Fineness, SpatialPress, Tip
from tabulate_presses import columns, normal_rotation

from tactibench_sim import shipped_dome

ngs = pytest.importorskip("ngsolve", reason="needs the extra `fem`")

COARSE = Dome(apex_size=0.5, skin_size=1.0, gel_size=4.0)
POLAR = np.radians(np.arange(0, 91, 5.0))
TABLES = shipped_dome()


def pressed(radius, deltas, **options):
    return list(press(COARSE, radius, np.array(deltas), POLAR, **options))


@pytest.mark.parametrize("friction", ["none", "stick"])
@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_force_grows_from_rest(radius, friction):
    rest, *more = pressed(radius, [0, 0.1, 0.4, 0.7], friction=friction)
    assert rest.force == 0
    assert not rest.inner.any()
    assert not rest.outer.any()
    assert (np.diff([0, *(p.force for p in more)]) > 0).all()


def test_after_failure_the_state_is_the_last_equilibrium():
    problem = AxisymmetricPress(
        dome_meridian(COARSE), COARSE.moduli, COARSE.outer, 3.0, 100.0, Settings(smallest=1.0)
    )
    problem.advance(0.5)
    before, force = problem.state.vec.FV().NumPy().copy(), problem.force()
    with pytest.raises(NotConvergedError, match="beyond"):
        problem.advance(19.5)
    assert problem.path.level == problem.depth.Get() == 0.5
    assert (problem.state.vec.FV().NumPy() == before).all()
    assert problem.force() == force
    with pytest.raises(ValueError, match="goal"):
        problem.advance(0.1)


def test_a_pad_is_pressed():
    coarse = Pad(contact_size=0.5, skin_size=1.0, gel_size=4.0)
    rest, *pushed = press_pad(coarse, 3.0, np.array([0, 0.4, 0.8]), np.linspace(0, 30, 31))
    assert rest.force == 0
    assert not rest.surface.any()
    for p in pushed:
        assert p.surface[0, 0] == pytest.approx(p.delta, abs=0.03)
        assert 0 < p.marker[0, 0] < p.surface[0, 0]
        assert p.marker[1, 0] == 0


# -- Sneddon's solution of a rigid sphere on a half-space

RADIUS = 3.0
BLOCK = Pad(
    thickness=400, skin=0, stiffness_ratio=1, width=800, gel_size=40, penalty=1000, contact_size=0.1
)


def sneddon(depth):
    """(contact radius, force / E) at nu = 1/2."""

    def half_log(a):
        return math.log((RADIUS + a) / (RADIUS - a)) / 2

    a = brentq(lambda a: a * half_log(a) - depth, 1e-9, RADIUS * (1 - 1e-12))
    return a, 4 / 3 * ((a**2 + RADIUS**2) * half_log(a) - a * RADIUS)


class Linear(AxisymmetricPress):
    """Small strain, vertical traction, contact judged at undeformed places, as Sneddon assumes."""

    def stored(self, young, u, pressure):
        strain, hoop = ngs.Sym(ngs.Grad(u)), u[0] / ngs.x
        volume = ngs.Trace(strain) + hoop
        return young / 3 * (ngs.InnerProduct(strain, strain) + hoop**2) + pressure * volume

    def inside(self, u):
        square = self.radius**2 - ngs.x**2
        surface = self.radius - ngs.sqrt(ngs.IfPos(square, square, 0.0))
        height = ngs.y + u[1] - (self.top - self.depth)
        return ngs.IfPos(square, height - surface, -1.0)

    def steepness(self, u):
        return 1.0


@pytest.mark.slow
def test_a_linear_twin_gives_sneddons_force(monkeypatch):
    monkeypatch.setattr(axisymmetric, "AxisymmetricPress", Linear)
    depths = np.array([0.1, 0.25, 0.5, 1.0, 1.5, 2.0])
    forces = [p.force for p in press_pad(BLOCK, RADIUS, depths, np.zeros(1))]
    assert forces == pytest.approx([sneddon(d)[1] for d in depths], rel=0.01)


# -- three dimensions


@pytest.fixture(scope="module")
def half():
    """The coarse half dome, pressed 0.3 mm at the apex."""
    apex = Tip.along_axis(Dome(), np.array([0.0, 0.0, 1.0]), 3.0)
    fineness = Fineness(contact=0.8, largest=4.0, margin=0.5, far=9.0)
    one = SpatialPress(Dome(), [apex], np.array([[0.3]]), mirror=True, fineness=fineness)
    one.move([0.3])
    return one


def rays(count=40, seed=0):
    b = np.random.default_rng(seed).normal(size=(count, 3))
    b[:, 2] = abs(b[:, 2])
    return b / np.linalg.norm(b, axis=1, keepdims=True)


def test_a_tip_pushes_down_and_the_skin_gives_way(half):
    field, apex, b = half.field(), np.array([[0.0, 0.0, 1.0]]), rays()
    assert field.forces[0, 2] < 0
    assert abs(field.forces[0, :2]).max() < 0.02 * abs(field.forces[0, 2])
    assert -field.outer(apex)[0, 2] == pytest.approx(0.3, abs=0.06)
    volume = ngs.Integrate(ngs.Det(ngs.Id(3) + ngs.Grad(half.state.components[0])), half.mesh)
    assert volume == pytest.approx(math.pi / 3 * 20**3, rel=0.01)
    flipped = b * [1, -1, 1]
    assert (field.inner(flipped) == field.inner(b) * [1, -1, 1]).all()


@pytest.mark.slow
def test_a_stuck_tip_drags_the_skin(half):
    apex = np.array([[0.0, 0.0, 1.0]])
    before, drag = half.field().outer(apex)[0, 0], Drag(half, np.array([1.0, 0.0]))
    assert drag.move(0.1).outer(apex)[0, 0] - before == pytest.approx(0.1, abs=0.03)
    assert drag.force() > 0


@pytest.mark.slow
def test_a_tip_that_slips_pulls_by_coulombs_limit():
    """Sideways farther than the skin follows, all of the contact slips one way."""
    dome = Dome()
    press = SpatialPress(
        dome, [Tip.downwards(dome, 0.0, 0.0, 3.0)], np.array([[0.0], [0.5]]), mirror=True
    )
    rubbing = RubbingPress(press, 0.2, np.array([0.5]))
    rubbing.move(0.5)
    normal, tangential = np.linalg.norm(rubbing.forces[0], axis=-1)
    assert tangential < 0.05 * normal  # at the apex the slips of all sides cancel
    rubbing.move(1.0)
    normal, tangential = np.linalg.norm(rubbing.forces[0], axis=-1)
    assert tangential / normal == pytest.approx(0.2, rel=0.05)


# -- the tables that ship


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, math.inf], ids=["sphere", "plate"])
def test_finite_elements_give_the_table_again(radius):
    one = TABLES.by_radius[radius]
    again = columns(Dome(**TABLES.parameters["dome"]), radius, one.delta, one.polar)
    for name, values in again.items():
        assert values == pytest.approx(one.fields[name], abs=2e-5), name


def test_rotation_of_a_displacement():
    """None where a sphere moves as a whole (w = a cos, t = a sin); linear where it is small."""
    polar = np.radians(np.arange(181) / 2)
    turned = normal_rotation(19.0, polar, 2 * np.cos(polar)[None], 2 * np.sin(polar)[None])
    assert abs(turned).max() < 1e-6
    w, t = 1e-5 * np.cos(3 * polar), 1e-5 * np.sin(2 * polar)
    linear = (-3e-5 * np.sin(3 * polar) + t) / 19.0
    assert normal_rotation(19.0, polar, w, t)[1:] == pytest.approx(linear[1:], abs=1e-10)
