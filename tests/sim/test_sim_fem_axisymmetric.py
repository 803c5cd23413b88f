"""The finite-element runs on coarse meshes: what holds on any mesh, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from axisymmetric import AxisymmetricPress, contact_energy
from dome_press import dome_meridian, press
from pad_press import Pad, press_pad

from tactibench import UserError
from tactibench_sim import fem
from tactibench_sim.fem.continuation import Continuation, Settings

ngs = pytest.importorskip("ngsolve", reason="needs the extra `fem`")

COARSE = fem.Dome(apex_size=0.5, skin_size=1.0, gel_size=4.0)
COARSE_PAD = Pad(contact_size=0.5, skin_size=1.0, gel_size=4.0)
POLAR = np.radians(np.arange(0, 91, 5.0))
R = np.linspace(0, 30, 31)


def pressed(radius, deltas, **options):
    return list(press(COARSE, radius, np.array(deltas), POLAR, **options))


@pytest.mark.parametrize("friction", ["none", "stick"])
@pytest.mark.parametrize("radius", [3.0, 8.0, math.inf])
def test_depth_zero_moves_nothing(radius, friction):
    (rest,) = pressed(radius, [0.0], friction=friction)
    assert rest.force == 0
    assert not rest.inner.any()
    assert not rest.outer.any()


@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_force_grows_with_depth(radius):
    forces = [p.force for p in pressed(radius, [0, 0.1, 0.4, 0.7, 1.0])]
    assert (np.diff(forces) > 0).all()


def test_a_larger_tip_takes_more_force():
    forces = [pressed(radius, [0.5])[0].force for radius in (2.0, 4.0, math.inf)]
    assert (np.diff(forces) > 0).all()


def test_the_state_does_not_depend_on_the_way():
    """Frictionless and elastic: stopping on the way changes nothing."""
    (direct,) = pressed(3.0, [0.6])
    *_, halting = pressed(3.0, [0.1, 0.35, 0.6])
    assert halting.inner == pytest.approx(direct.inner, abs=1e-8)


def test_an_impossible_depth_yields_nothing():
    run = press(COARSE, 3.0, np.array([0.5, 19.5]), POLAR, settings=Settings(smallest=1.0))
    assert next(run).delta == 0.5
    with pytest.raises(fem.NotConvergedError, match="beyond"):
        next(run)
    assert list(run) == []


def test_after_failure_the_state_is_the_last_equilibrium():
    problem = AxisymmetricPress(
        dome_meridian(COARSE),
        COARSE.moduli,
        COARSE.outer,
        3.0,
        100.0,
        Settings(smallest=1.0),
    )
    problem.advance(0.5)
    before, force = problem.state.vec.FV().NumPy().copy(), problem.force()
    with pytest.raises(fem.NotConvergedError):
        problem.advance(19.5)
    assert problem.path.level == 0.5
    assert problem.depth.Get() == 0.5
    assert (problem.state.vec.FV().NumPy() == before).all()
    assert problem.force() == force


def test_the_way_leads_down_only():
    problem = AxisymmetricPress(dome_meridian(COARSE), COARSE.moduli, COARSE.outer, 3.0, 100.0)
    problem.advance(0.2)
    for goal in (0.1, math.nan):
        with pytest.raises(ValueError, match="goal"):
            problem.advance(goal)


def test_unknown_friction_and_solver_are_refused():
    with pytest.raises(ValueError, match="allowed: none, stick"):
        pressed(3.0, [0.1], friction="sliding")
    with pytest.raises(ValueError, match="allowed: umfpack"):
        Settings(inverse="jacobi")


@pytest.mark.skipif(ngs.config.USE_PARDISO or ngs.config.USE_MKL, reason="this NGSolve has pardiso")
def test_a_solver_that_is_not_built_in_is_named():
    with pytest.raises(UserError, match="built without the direct solver 'pardiso'"):
        pressed(3.0, [0.1], settings=Settings(inverse="pardiso"))


def two_spheres_on_a_brick(inverse):
    """A 3-D problem as another module would write it: two tips, one path parameter."""
    from netgen.occ import Box, OCCGeometry, Z

    from tactibench_sim.fem.body import density, mixed_space, spatial_strain
    from tactibench_sim.fem.tip import overlap

    brick = Box((-7, -4, 0), (7, 4, 5))
    brick.solids.name = "gel"
    brick.faces.Min(Z).name = "base"
    brick.faces.Max(Z).name = "outer"
    mesh = ngs.Mesh(OCCGeometry(brick).GenerateMesh(maxh=5.0))
    space = mixed_space(mesh, ngs.VectorH1(mesh, order=2, dirichlet="base"), ["gel"])
    share, state, levels = ngs.Parameter(0.0), ngs.GridFunction(space), []
    u, pressure = space.TrialFunction()
    form = ngs.BilinearForm(space, symmetric=True)
    form += ngs.Variation(density(1.0, *spatial_strain(u), pressure).Compile() * ngs.dx)
    for centre, depth in ((-3.0, 0.6), (3.0, 0.3)):
        square = (ngs.x + u[0] - centre) ** 2 + (ngs.y + u[1]) ** 2
        inside = overlap(square, ngs.z + u[2] - 5 + depth * share, 3.0)
        push = contact_energy(inside, 100.0)
        form += ngs.Variation(push.Compile() * ngs.ds(definedon=mesh.Boundaries("outer")))
    path = Continuation(
        form,
        state,
        share.Set,
        displacement=space.Range(0),
        settings=Settings(inverse=inverse),
        on_step=levels.append,
    )
    path.advance(1.0)
    assert levels == sorted(levels)
    assert levels[-1] == pytest.approx(1.0)
    move = state.components[0]
    volume = ngs.Integrate(ngs.Det(ngs.Id(3) + ngs.Grad(move)), mesh)
    return np.array([move(mesh(x, 0.0, 5.0)) for x in (-3.0, 3.0)]), volume


def test_continuation_carries_two_indenters_in_three_dimensions():
    moved, volume = two_spheres_on_a_brick("umfpack")
    assert -moved[:, 2] == pytest.approx([0.6, 0.3], abs=0.05)
    assert volume == pytest.approx(14 * 8 * 5, rel=1e-9)
    again, _ = two_spheres_on_a_brick("sparsecholesky")
    assert again == pytest.approx(moved, abs=1e-7)


def test_pad_at_rest_and_pressed():
    rest, *pushed = press_pad(COARSE_PAD, 3.0, np.array([0, 0.4, 0.8]), R)
    assert rest.force == 0
    assert not rest.surface.any()
    assert not rest.marker.any()
    assert (np.diff([rest.force, *(p.force for p in pushed)]) > 0).all()
    for p in pushed:
        assert p.surface[0, 0] == pytest.approx(p.delta, abs=0.03)
        assert 0 < p.marker[0, 0] < p.surface[0, 0]
        assert p.marker[1, 0] == 0


def test_a_flat_pad_has_no_plate():
    with pytest.raises(UserError, match="finite radius"):
        next(press_pad(COARSE_PAD, math.inf, np.array([1.0]), R))


@pytest.mark.parametrize(
    "wrong", [{"skin": 10.0}, {"marker_depth": 10.0}, {"contact_radius": 40.0}, {"skin": -1.0}]
)
def test_an_impossible_pad_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Pad(**wrong)


# -- a plate that sticks: what it has touched stays where it touched

STICKY = fem.Dome(apex_size=0.5, skin_size=0.8, gel_size=4.0)
FINE_POLAR = np.radians(np.arange(0, 91, 0.5))
DEPTHS = np.array([0.4, 0.7, 1.0])


def places(profile):
    """Distance from the axis of the outer skin's points."""
    w, t = profile.outer
    return (STICKY.outer - w) * np.sin(FINE_POLAR) + t * np.cos(FINE_POLAR)


def touching(profile):
    """Well inside the contact: undeformed height above the plate by a quarter of its depth."""
    return STICKY.outer * (1 - np.cos(FINE_POLAR)) < profile.delta / 4


@pytest.fixture(scope="module")
def runs():
    return {
        friction: list(press(STICKY, math.inf, DEPTHS, FINE_POLAR, friction=friction))
        for friction in ("none", "stick")
    }


def test_what_has_touched_stays(runs):
    first, *later = runs["stick"]
    for profile in later:
        assert places(profile)[touching(first)] == pytest.approx(
            places(first)[touching(first)], abs=5e-3
        )


def test_without_friction_it_slides(runs):
    first, *_, last = runs["none"]
    assert abs(places(last) - places(first))[touching(first)].max() > 0.01


def test_sticking_takes_more_force_at_small_depth(runs):
    for free, stuck in zip(runs["none"], runs["stick"], strict=True):
        assert free.force < stuck.force < 1.1 * free.force


@pytest.mark.slow
def test_increments_are_small_enough():
    """Against a quarter of the increment: pin bases within 0.01 mm, force within 1 %."""
    depths = np.array([1.0, 2.0, 4.0])
    usual = press(STICKY, math.inf, depths, FINE_POLAR, friction="stick")
    fine = press(
        STICKY, math.inf, depths, FINE_POLAR, friction="stick", settings=Settings(largest=0.0125)
    )
    for one, other in zip(usual, fine, strict=True):
        assert one.inner == pytest.approx(other.inner, abs=0.01)
        assert one.force == pytest.approx(other.force, rel=0.01)


# -- halving every element


def halved(body):
    sizes = [name for name in vars(body) if name.endswith("_size")]
    return replace(body, **{name: getattr(body, name) / 2 for name in sizes})


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, math.inf], ids=["sphere", "plate"])
def test_halving_every_element_of_the_dome_changes_little(radius):
    polar, depth = np.radians(np.arange(0, 91, 0.5)), np.array([2.0])
    (coarse,) = press(fem.Dome(), radius, depth, polar)
    (fine,) = press(halved(fem.Dome()), radius, depth, polar)
    assert coarse.force == pytest.approx(fine.force, rel=0.01)
    assert coarse.inner == pytest.approx(fine.inner, abs=0.01)


@pytest.mark.slow
def test_halving_every_element_of_the_pad_changes_little():
    r, depth = np.linspace(0, 15, 61), np.array([1.0, 2.0])
    for coarse, fine in zip(
        press_pad(Pad(), 3.0, depth, r), press_pad(halved(Pad()), 3.0, depth, r), strict=True
    ):
        assert coarse.force == pytest.approx(fine.force, rel=0.01)
        assert coarse.marker == pytest.approx(fine.marker, abs=0.01)
