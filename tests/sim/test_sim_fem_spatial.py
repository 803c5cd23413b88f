"""Three-dimensional runs on a coarse mesh: what holds on any mesh, and what is refused."""

import math

import numpy as np
import pytest
from dome_press import press
from spatial_runs import press_scene

from tactibench_sim.fem import Dome, NotConvergedError
from tactibench_sim.fem.continuation import Settings
from tactibench_sim.fem.mesh import Spot
from tactibench_sim.fem.press import SPATIAL, Fineness, SpatialPress
from tactibench_sim.fem.tip import PLATE, SPHERE, Tip, rounded_energy

ngs = pytest.importorskip("ngsolve", reason="needs the extra `fem`")

DOME = Dome()
UNIT = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=1.0))  # for functions that depend on no place
COARSE = Fineness(contact=0.8, largest=4.0, margin=0.5, far=9.0)
APEX = Tip.along_axis(DOME, np.array([0.0, 0.0, 1.0]), 3.0)
BESIDE = Tip.downwards(DOME, 5.0, 2.0, 3.0)


def rays(count=40, seed=0):
    b = np.random.default_rng(seed).normal(size=(count, 3))
    b[:, 2] = abs(b[:, 2])
    return b / np.linalg.norm(b, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def half():
    """The coarse half dome, pressed 0.3 mm at the apex."""
    press = SpatialPress(DOME, [APEX], np.array([[0.3]]), mirror=True, fineness=COARSE)
    press.move([0.3])
    return press


@pytest.mark.parametrize("depth", [0.0, -0.4])
def test_a_tip_that_does_not_press_moves_nothing(depth):
    (field,) = press_scene(DOME, [APEX], np.array([[depth]]), mirror=True, fineness=COARSE)
    assert not field.inner(rays()).any()
    assert not field.outer(rays()).any()
    assert not field.forces.any()
    assert field.inner_normals(rays()) == pytest.approx(rays(), abs=1e-12)


def test_the_mirror_image_is_the_other_half(half):
    field, b = half.field(), rays()
    flipped = b * [1, -1, 1]
    assert (field.inner(flipped) == field.inner(b) * [1, -1, 1]).all()
    assert field.inner_normals(flipped) == pytest.approx(field.inner_normals(b) * [1, -1, 1])


def test_a_tip_pushes_down_and_the_skin_gives_way(half):
    field, apex = half.field(), np.array([[0.0, 0.0, 1.0]])
    assert field.forces[0, 2] < 0
    assert abs(field.forces[0, :2]).max() < 0.02 * abs(field.forces[0, 2])
    assert -field.outer(apex)[0, 2] == pytest.approx(0.3, abs=0.06)
    gradient = ngs.Id(3) + ngs.Grad(half.state.components[0])
    volume = ngs.Integrate(ngs.Det(gradient), half.mesh)
    assert volume == pytest.approx(math.pi / 3 * 20**3, rel=0.01)
    assert not field.inner(np.array([[1.0, 0.0, 0.0]])).round(4).any()


def test_a_field_stays_what_it_was(half):
    field = half.field()
    before = field.inner(rays())
    half.move([0.4])
    assert (field.inner(rays()) == before).all()
    assert (half.field().inner(rays()) != before).any()
    half.move([0.3])
    assert half.field().inner(rays()) == pytest.approx(before, abs=1e-3)


def test_an_impossible_depth_yields_no_field():
    impatient = Settings(
        **{**vars(SPATIAL), "largest": 20.0, "smallest": 15.0, "predictor": "secant"}
    )
    depths = np.array([[0.3], [19.0]])
    run = press_scene(DOME, [APEX], depths, mirror=True, fineness=COARSE, settings=impatient)
    assert next(run).depths == pytest.approx([0.3])
    with pytest.raises(NotConvergedError, match="beyond"):
        next(run)
    assert list(run) == []


def test_wrong_questions_are_refused(half):
    field = half.field()
    for wrong in (np.ones((2, 3)), np.array([[0, 0.6, -0.8]]), np.full((1, 3), np.nan)):
        with pytest.raises(ValueError, match="direction"):
            field.inner(wrong)
    with pytest.raises(ValueError, match="shape"):
        field.inner(np.zeros(3))


@pytest.mark.parametrize(
    ("tips", "depths", "mirror", "told"),
    [
        ([APEX], [[np.nan]], True, "finite"),
        ([APEX], [[1.0, 2.0]], True, "shape"),
        ([], np.zeros((1, 0)), False, "shape"),
        ([Tip.downwards(DOME, 5.0, -2.0, 3.0)], [[1.0]], True, "mirror plane"),
        ([Tip((0.0, 0.0, 23.0), (0.0, 0.6, 0.8), 3.0)], [[1.0]], True, "mirror plane"),
    ],
)
def test_impossible_scenes_are_refused(tips, depths, mirror, told):
    with pytest.raises(ValueError, match=told):
        list(press_scene(DOME, tips, np.array(depths), mirror=mirror, fineness=COARSE))


def test_both_predictors_lead_to_the_same_state():
    coarse = Dome(apex_size=0.5, skin_size=1.0, gel_size=4.0)
    polar = np.radians(np.arange(0, 91, 5.0))
    secant, tangent = (
        [p.inner for p in press(coarse, 3.0, np.array([0.5, 1.0]), polar, settings=settings)]
        for settings in (Settings(), Settings(predictor="tangent", largest=0.25, diverging=5.0))
    )
    assert np.array(tangent) == pytest.approx(np.array(secant), abs=1e-8)
    with pytest.raises(ValueError, match="allowed: secant, tangent"):
        Settings(predictor="none")


def test_impossible_tips_are_refused():
    with pytest.raises(ValueError, match="comes down"):
        Tip.downwards(DOME, 23.0, 1.0, 3.0)
    with pytest.raises(ValueError, match="unit vector"):
        Tip((0.0, 0.0, 23.0), (0.0, 0.0, 2.0), 3.0)
    for radius in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="radius"):
            Tip((0.0, 0.0, 23.0), (0.0, 0.0, 1.0), radius)


def test_inside_is_the_closed_form():
    """Sphere below its centre, rod above it, plate a half-space; depth moves along the axis."""
    unit = UNIT(0.3, 0.3)
    random = np.random.default_rng(1)
    for tip, depth in ((APEX, 0.0), (BESIDE, 1.5), (Tip.along_axis(DOME, rays()[0], 2.0), 0.7)):
        centre, axis = tip.centre(depth), np.array(tip.axis)
        for place in centre + 3 * random.normal(size=(20, 3)):
            inside = tip.inside([ngs.Parameter(float(value)) for value in place], depth)(unit)
            q = place - centre
            side = q - (q @ axis) * axis
            distance = np.linalg.norm(side if q @ axis > 0 else q)
            assert inside == pytest.approx(tip.radius - distance, abs=1e-9)
            plate = Tip(tip.start, tip.axis, math.inf)
            assert plate.inside(place.tolist(), depth) == pytest.approx(q @ axis, abs=1e-12)


@pytest.mark.parametrize("cushion", [SPHERE, PLATE])
def test_contact_energy_is_smooth_and_ends_as_a_penalty(cushion):
    unit = UNIT(0.3, 0.3)
    at = ngs.Parameter(0.0)
    energy = rounded_energy(at, cushion)

    def value(inside):
        at.Set(float(inside))
        return energy(unit)

    h = cushion.rounding / 100
    x = np.arange(-200, 500) * h
    second = np.diff([value(one) for one in x], 2) / h**2
    expected = cushion.penalty * np.clip(x[1:-1] / cushion.rounding, 0, 1)
    assert second == pytest.approx(expected, abs=0.2)


def test_a_spot_covers_its_part_of_the_skin():
    spot = Spot(np.array([0.6, 0.0, 0.8]), 4.0, 1.0)
    points = spot.points(20.0)
    assert np.linalg.norm(points, axis=1) == pytest.approx(20.0)
    angle = np.arccos(np.clip(points @ spot.direction / 20, -1, 1))
    assert angle.max() * 20 <= 4.0
    assert np.sum(angle * 20 > 3) > 20
    assert angle.min() < 1e-9
