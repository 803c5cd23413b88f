"""The planar sensor: the mechanics of its pad, the table that ships, and the sensor."""

import math

import numpy as np
import pytest
from fem_script import write_tables
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import true_contacts
from tactibench_sim import PadMechanics, PlanarGrid, Tips, pad_tips, shipped_file, square_grid

FILE = shipped_file("pad.npz")
PAD, THICKNESS = FILE.arrays, FILE.parameters["pad"]["thickness"]
COUPLED, SUPERPOSED = PadMechanics(FILE), PadMechanics(FILE, "superpose")
MARKERS = square_grid(14, 1.5)
DEEPEST = COUPLED.deepest


def tips(*rows):
    """One scene of (x, y, depth)."""
    a = np.array(rows, dtype=float)
    return Tips(a[None, :, :2], a[None, :, 2], np.array([3.0]))


def moved(*rows, mechanics=COUPLED, markers=MARKERS):
    return mechanics.markers(mechanics.loads(tips(*rows)), markers)[0]


def below(*rows, at=None, mechanics=COUPLED):
    """Depression of the surface at points (default: under the tips)."""
    points = np.array(rows)[:, :2] if at is None else np.asarray(at, dtype=float)
    return -mechanics.surface(mechanics.loads(tips(*rows)), points)[0, :, 2]


def lost_volume(r, w, t):
    """Volume missing under a surface displaced by w (inward) and t (outward), of the dent's own.

    integral of w over the deformed plane, d(pi (r + t)^2): what leaves through the end of r, apart
    from numerical errors, since the pad keeps its volume.
    """
    area = 2 * np.pi * (r + t) * (1 + CubicSpline(r, t)(r, 1))
    return simpson(w * area, x=r) / simpson(np.maximum(w, 0.0) * area, x=r)


place = st.floats(-6.4, 6.4)
tip = st.tuples(place, place, st.floats(-0.8, DEEPEST))


@given(st.lists(tip, min_size=1, max_size=4))
@settings(max_examples=40, deadline=None)
def test_every_tip_reaches_its_depth_or_stands_clear(several):
    """The complementarity in its own terms, from surfaces under single tips."""
    loads = COUPLED.loads(tips(*several))
    e = (loads.amplitude * loads.shape)[0]
    under = np.array(
        [np.interp(s, PAD["delta"], PAD["w_surface"][0, :, 0]) for s in loads.shape[0]]
    )
    assert (loads.shape <= DEEPEST).all()
    scale = np.divide(loads.shape[0], under, out=np.ones_like(under), where=under > 0)
    gap = -np.array([row[2] for row in several])
    for j in range(len(several)):
        if e[j] > 0:
            distance = np.hypot(*(np.array(several)[:, :2] - several[j][:2]).T)
            points = np.stack([distance, 0 * distance], axis=1)
            alone = below((0, 0, loads.shape[0, j]), at=points)
            gap += alone * loads.amplitude[0, j] * scale[j]
    assert (e >= 0).all()
    assert (gap > -2e-4).all()
    assert (abs(gap[e > 0]) < 2e-4).all()


@given(st.lists(tip, min_size=1, max_size=4), st.floats(-math.pi, math.pi))
@settings(max_examples=25, deadline=None)
def test_turning_and_mirroring_the_press_turns_and_mirrors_the_field(several, angle):
    c, s = math.cos(angle), math.sin(angle)
    for q in (np.array([[c, -s], [s, c]]), np.array([[1.0, 0.0], [0.0, -1.0]])):
        turned = [(*(q @ row[:2]), row[2]) for row in several]
        found = moved(*turned, markers=MARKERS @ q.T)
        expected = moved(*several)
        np.testing.assert_allclose(found[:, :2], expected[:, :2] @ q.T, atol=1e-9)
        np.testing.assert_allclose(found[:, 2], expected[:, 2], atol=1e-9)


@given(tip)
@settings(max_examples=25, deadline=None)
def test_two_identical_tips_are_one(one):
    np.testing.assert_allclose(moved(one, one), moved(one), atol=1e-8)
    third = (4.0, 3.0, 1.5)
    np.testing.assert_allclose(moved(one, one, third), moved(one, third), atol=1e-6)


def test_a_tip_in_a_dimple_carries_nothing():
    dimple = below((0, 0, 2.0), at=[[1.0, 0.0]])[0]
    loads = COUPLED.loads(tips((0, 0, 2.0), (1.0, 0.0, dimple - 0.1)))
    assert loads.amplitude[0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize("distance", [6.5, 7.0, 8.0, 9.5, 12.0])
@pytest.mark.parametrize("depth", [0.5, 1.0, 3.0])
def test_both_tips_of_a_pair_reach_their_depth(distance, depth):
    pair = ((0, 0, depth), (distance, 0, 0.7 * depth))
    reached = below(*pair)
    assert reached == pytest.approx([depth, 0.7 * depth], rel=6e-3)
    alone = np.array([below(one)[0] for one in pair])
    wrong = abs(below(*pair, mechanics=SUPERPOSED) - alone)
    assert wrong.max() > 5 * abs(reached - alone).max()


def test_the_field_grows_continuously_from_nothing():
    sizes = [abs(moved((0.3, 0.2, d))).max() for d in (1e-9, 1e-6, 1e-3, 1e-2)]
    assert sizes[0] < 1e-8
    assert (np.diff(sizes) > 0).all()
    path = np.linspace(0.0, DEEPEST, 601)
    fields = np.stack([moved((0.3, 0.2, d), (5.0, 1.0, d - 1.0)) for d in path])
    assert abs(np.diff(fields, axis=0)).max() < 2.5 * (path[1] - path[0])


def test_at_its_nodes_the_spline_is_the_table():
    r = PAD["r"][:200:7]
    for i in (3, 12, 24):
        found = moved((0, 0, PAD["delta"][i]), markers=np.stack([r, 0 * r], axis=1))
        np.testing.assert_allclose(-found[:, 2], PAD["w"][0, i, :200:7], atol=1e-12)
        np.testing.assert_allclose(found[:, 0], PAD["t"][0, i, :200:7], atol=1e-12)


def test_the_shipped_pad_keeps_its_volume():
    f = PAD
    lost = [
        lost_volume(PAD["r"], f["w_surface"][0, i], f["t_surface"][0, i])
        for i in range(1, len(PAD["delta"]))
    ]
    assert np.abs(lost).max() < 0.01
    assert np.ptp(lost) < 1e-3  # what is lost leaves through the end of the table, at every depth


def test_the_shipped_force_rises_and_begins_as_a_bonded_layer():
    """Dimitriadis et al., Biophys. J. 82 (2002) 2798, eq. 12: sphere on a bonded layer, nu = 1/2.

    It is for small strain and a paraboloid, and 5 % off where chi = a / h = 0.25.
    """
    force, delta = PAD["force"][0], PAD["delta"]
    assert (np.diff(force) > 0).all()
    for i in (1, 2, 3, 4):
        chi = math.sqrt(3.0 * delta[i]) / THICKNESS
        layer = 1 + 1.133 * chi + 1.283 * chi**2 + 0.769 * chi**3 + 0.0975 * chi**4
        hertz = 16 / 9 * math.sqrt(3.0) * delta[i] ** 1.5
        assert force[i] == pytest.approx(hertz * layer, rel=0.05)


def test_far_away_the_bulge_decays_as_theory_says():
    """Slowest mode of a bonded incompressible layer: cos s = s, so that it decays as exp(-s r / h).

    Its amplitude falls as 1 / sqrt(r) besides.
    """
    s = 0.7390851332
    r, w = PAD["r"], -PAD["w_surface"][0, 8]
    window = (r > 15) & (r < 35)
    slope = np.polyfit(r[window], np.log(w[window] * np.sqrt(r[window])), 1)[0]
    assert slope == pytest.approx(-s / THICKNESS, rel=0.05)


def test_what_the_tables_do_not_hold_is_refused():
    with pytest.raises(UserError, match=r"3\.10 mm into the pad; .* end at 3 mm"):
        COUPLED.loads(tips((0, 0, 3.1)))
    one = tips((0, 0, 1.0))
    with pytest.raises(UserError, match=r"radius is 2\.5 mm"):
        COUPLED.loads(Tips(one.xy, one.depth, np.array([2.5])))
    with pytest.raises(UserError, match=r"radius is 0\.5 mm"):
        COUPLED.loads(Tips(one.xy, one.depth, np.array([0.5])))
    with pytest.raises(UserError, match="the tier is 'best'"):
        PadMechanics(FILE, "best")


GRID = Grid.centred(64, 0.4)


def sensor(seed=7, **parameters):
    return PlanarGrid(SensorContext(np.random.SeedSequence(seed)), **parameters)


def scenes(count, seed=0):
    rng = np.random.default_rng(seed)
    kinds = [Indenter.single(), Indenter.dual(7.0), Indenter.triple((0.0, 1.0, 2.0))]
    return [
        Scene(
            kinds[k % 3],
            Pose(*rng.uniform(-3, 3, 2), rng.uniform(-180, 180), 0.0, rng.uniform(0.5, 3)),
        )
        for k in range(count)
    ]


def single(x=0.0, y=0.0, depth=0.0):
    return Scene(Indenter.single(), Pose(x, y, 0.0, 0.0, depth))


def test_the_rest_frame_is_the_grid_through_a_pinhole():
    """Without refraction, a marker at (x, y) on the plane is at f x / z; centroids of the discs."""
    one = sensor(noise=False, gel_index=1.0, window_index=1.0, size=256, vignetting=0.0)
    image = one.rest().image.astype(float) - 16
    scale = one.optics.focal * 256 / (one.optics.camera_distance_mm - 0.5)
    steps = np.arange(-6.5, 7) * 1.5
    expected = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * scale + 127.5
    rows, columns = np.indices(image.shape)
    for x, y in expected:
        near = (abs(columns - x) < 7) & (abs(rows - y) < 7)
        weight = image * near
        seen = [(weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()]
        assert seen == pytest.approx([x, y], abs=0.02)


def test_surface_is_the_depth_under_the_tip():
    one = sensor()
    surface = one.surface(single(3.0, -2.0, 2.0), GRID)
    row, column = np.unravel_index(surface.argmax(), surface.shape)
    assert GRID.xy(row, column) == pytest.approx([3.0, -2.0], abs=0.29)
    assert surface.max() == pytest.approx(2.0, abs=0.03)
    assert surface.min() < -0.05


def test_tips_are_those_of_the_core_on_a_flat_pad():
    for scene in scenes(30, seed=3):
        found = pad_tips([scene], 10.0)
        touching = found.depth[0] > 0
        truth = true_contacts(scene, math.inf)
        np.testing.assert_allclose(found.xy[0, touching], truth.xy, atol=1e-12)
        np.testing.assert_allclose(found.depth[0, touching], truth.depth, atol=1e-12)


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (Scene(Indenter.plate(), Pose(depth=1)), "plate would touch all of the flat pad"),
        (Scene(Indenter.plate(), Pose(depth=1, tilt=5)), "plate would touch all of the flat pad"),
        (Scene(Indenter.single(), Pose(depth=1, tilt=5)), "tilt is 5 deg"),
        (Scene(Indenter.single(), Pose(depth=-1)), "depth is -1 mm"),
        (Scene(Indenter.single(), Pose(x=math.nan, depth=1)), "x nan.*must be finite"),
        (Scene(Indenter.single(), Pose(depth=math.inf)), "depth inf.*must be finite"),
        (Scene(Indenter.single(), Pose(depth=3.2)), "tables end at 3 mm"),
        (Scene(Indenter.single(), Pose(depth=1e6)), "no pad is that thick"),
        (Scene(Indenter.single(), Pose(x=10.5, depth=1)), "within 10 mm of its middle"),
        (Scene(Indenter.dual(12.0), Pose(y=-9.9, yaw=90, depth=1)), "within 10 mm of its middle"),
        (Scene(Indenter.single(2.0), Pose(depth=1)), "radius is 2 mm"),
    ],
)
def test_what_is_no_press_of_the_pad_is_refused(scene, named):
    one = sensor()
    for call in (one.press, one.bound, lambda s: one.surface(s, GRID)):
        with pytest.raises(UserError, match=named) as caught:
            call(scene)
        assert str(caught.value).endswith(".")
    seen = []
    with pytest.raises(UserError, match=named):
        seen.extend(one.press_many([*scenes(2), scene]))
    assert len(seen) == 2


def test_an_instance_differs_in_its_camera_not_in_its_pad():
    one, two = sensor(), sensor(instance=5)
    assert two.optics.gel_mm == one.optics.gel_mm == 5.0
    assert two.optics.camera_distance_mm != one.optics.camera_distance_mm
    assert (two.rest().image != one.rest().image).any()


def test_a_table_of_ones_own(tmp_path):
    mine = tmp_path / "mine.npz"
    arrays = {**FILE.arrays, "t": FILE.arrays["t"] * 0.5}
    pad = {**FILE.parameters["pad"], "thickness": 6.0}
    write_tables(mine, arrays, {"pad": pad, "solver": "none"})
    one, other = sensor(), sensor(table=str(mine))
    assert other.optics.gel_mm == 6.0
    assert (one.press(single(depth=3)).image != other.press(single(depth=3)).image).any()
    assert one.describe() != other.describe()
