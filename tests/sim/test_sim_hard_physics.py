"""Hard cases of the physics: volume, symmetry, force, and where a pin is drawn."""

import math

import numpy as np
import pytest
from hard_scenes import (
    GRID,
    PINS,
    dome,
    every_radius,
    every_sensor,
    every_tier,
    moved,
    sensor,
    slanted,
    tips,
    towards,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactibench import Indenter, Pose, Scene
from tactibench_sim import (
    Corrections,
    TableMechanics,
    Tables,
    shipped_dome,
)

pytestmark = pytest.mark.long

# -- exact nu = 1/2


def enclosed(points, corners):
    """Volume between a triangulated surface and the origin."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def hemisphere(rings=120, sectors=240):
    """(P, 3) unit directions, the rim included, and (T, 3) corners of outward triangles."""
    polar, azimuth = np.linspace(0, np.pi / 2, rings + 1), np.arange(sectors) * 2 * np.pi / sectors
    a, b = np.meshgrid(polar, azimuth, indexing="ij")
    points = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    index = np.arange(points.size // 3).reshape(a.shape)
    here, beside = index, np.roll(index, -1, axis=1)
    first = np.stack([here[:-1], here[1:], beside[1:]], axis=-1)
    second = np.stack([here[:-1], beside[1:], beside[:-1]], axis=-1)
    return points.reshape(-1, 3), np.concatenate([first, second]).reshape(-1, 3)


def gain(tier, *contacts, radius=3.0):
    """Change of the volume below the inner skin, a share of the dimple's."""
    at, corners = hemisphere()
    u = moved(tier, *contacts, radius=radius, at=at)
    inward = np.maximum(-(u * at).sum(axis=1), 0.0)
    inner = dome(tier).inner
    rest = enclosed(inner * at, corners)
    dimple = rest - enclosed((inner - inward)[:, None] * at, corners)
    assert dimple > 0
    return (enclosed(inner * at + u, corners) - rest) / dimple


@every_tier()
@every_radius
@pytest.mark.parametrize("delta", [0.5, 2.0, 4.0, 6.0])
def test_the_gel_keeps_its_volume(tier, radius, delta):
    """What the dimple takes the bulge gives, to 1 % of the dimple."""
    assert abs(gain(tier, (0.0, 0.0, delta), radius=radius)) < 0.01


@every_tier()
@every_radius
@pytest.mark.parametrize("degrees", [10.0, 25.0, 45.0])
def test_the_gel_keeps_its_volume_under_a_slanted_contact(tier, radius, degrees):
    """To 7 % of the dimple, not to 1 %; without corrections for the rim 10 % are lost at 30 deg and
    20 % at 45 deg."""
    assert abs(gain(tier, slanted(degrees, 3.0, radius), radius=radius)) < 0.07


# -- rotation and mirror equivariance to 1e-12

SCENES = {
    "single": ((4.0, -2.0, 3.0),),
    "apex": ((0.0, 0.0, 5.0),),
    "dual": ((-3.0, 1.0, 4.0), (3.5, 2.0, 3.0)),
    "dimple": ((0.0, 1.0, 4.0), (1.5, 1.0, 0.3)),
    "triple": ((-4.0, 0.0, 1.0), (4.0, 0.5, 2.0), (0.3, 6.0, 4.5)),
}
contacts = st.lists(
    st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.05, 4)), min_size=1, max_size=3
).filter(lambda c: all(math.dist(a[:2], b[:2]) > 2 for i, a in enumerate(c) for b in c[:i]))


def random_and_named_scenes(test):
    """Try SCENES and some drawn ones."""
    test = settings(max_examples=8, deadline=None)(
        given(contacts, st.floats(-math.pi, math.pi))(test)
    )
    for scene in SCENES.values():
        test = example(scene, 2.5)(test)
    return test


@every_tier()
@random_and_named_scenes
def test_turning_and_mirroring_the_scene_turns_and_mirrors_the_field(tier, scene, angle):
    u = moved(tier, *scene)
    turn = Rotation.from_euler("z", angle).as_matrix()
    for matrix in (turn, np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])):
        image = [(*(matrix[:2, :2] @ contact[:2]), contact[2]) for contact in scene]
        assert abs(moved(tier, *image, at=PINS @ matrix.T) - u @ matrix.T).max() < 2e-12


@every_tier()
@settings(max_examples=8, deadline=None)
@given(contacts)
def test_the_order_of_tips_does_not_matter(tier, scene):
    assert moved(tier, *scene[::-1]) == pytest.approx(moved(tier, *scene), abs=1e-9)


@every_tier()
def test_turning_and_mirroring_a_plate(tier):
    plate, turn = slanted(25.0, 4.0, math.inf), Rotation.from_euler("z", 1.3).as_matrix()
    u = moved(tier, plate, radius=math.inf)
    turned = (*(turn[:2, :2] @ plate[:2]), plate[2])
    there = moved(tier, turned, radius=math.inf, at=PINS @ turn.T)
    assert abs(there - u @ turn.T).max() < 1e-12
    flip = np.array([1.0, -1.0, 1.0])
    mirrored = moved(tier, (plate[0], -plate[1], plate[2]), radius=math.inf, at=PINS * flip)
    assert abs(mirrored - u * flip).max() < 1e-12


@pytest.mark.parametrize("tier", ["superpose", "coupled"])
@every_radius
def test_the_tables_know_no_direction(tier, radius):
    """Without the corrections for the rim the field turns with the scene in three dimensions."""
    apex = TableMechanics(
        Tables(shipped_dome().parameters, "", shipped_dome().by_radius, Corrections({}, {})), tier
    )
    n = np.array([[0.0, 0.1, 1.0], [0.3, 0.2, 1.0], [-0.2, 0.3, 1.0]])[: 1 if radius > 3 else 3]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    delta = np.array([3.0, 2.0, 4.0])[: len(n)]
    fields = []
    for turn in (Rotation.identity(), Rotation.from_euler("zyx", [0.4, 0.3, -0.2])):
        loads = apex.loads(tips(*towards(turn.apply(n), delta, radius), radius=radius))
        u = apex.displacement(loads, turn.apply(PINS))[0][0]
        fields.append(turn.inv().apply(u))
    assert abs(fields[1] - fields[0]).max() < 1e-12


@every_sensor
def test_a_quarter_turn_turns_the_skin(tier):
    """Seen on the grid, where a quarter turn is exact. The pins' hexagons know no quarter turn."""
    one, pose = sensor(tier), Pose(3.0, 1.0, 20.0, 0.0, 3.0)
    turned = Pose(-1.0, 3.0, 110.0, 0.0, 3.0)
    seen = one.surface(Scene(Indenter.dual(7.0), pose), GRID)
    there = one.surface(Scene(Indenter.dual(7.0), turned), GRID)
    assert abs(there - np.rot90(seen, -1)).max() < 1e-12


# -- force monotone in depth


@every_tier()
@pytest.mark.parametrize("gap", [0.5, 4.0, 6.5, 12.0])
def test_the_force_of_a_pair_grows_with_depth(tier, gap):
    totals = []
    for depth in np.linspace(0.05, 6.0, 40):
        loads = dome(tier).loads(tips((-gap / 2, 0.0, depth), (gap / 2, 0.0, depth - 0.5)))
        totals.append(dome(tier).forces(loads).sum())
    assert (np.diff(totals) > 0).all()
