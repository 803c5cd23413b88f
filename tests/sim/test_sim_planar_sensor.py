"""The planar sensor as the benchmark sees it."""

import math

import numpy as np
import pytest
from fem_script import write_tables

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import true_contacts
from tactibench_sim import PlanarGrid, Tips, pad_tips, shipped_file

PAD = shipped_file("pad.npz")
GRID = Grid.centred(64, 0.4)


def sensor(seed=7, **parameters):
    parameters.setdefault("threads", 1)
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


def images(frames):
    return np.stack([frame.image for frame in frames])


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


def test_markers_spread_from_the_tip_and_come_nearer_to_the_camera():
    one = sensor()
    moved = one.points([single(1.0, -0.5, 2.0)])[0] - one.points([single()])[0]
    away = one.markers - [1.0, -0.5]
    outward = (moved[:, :2] * away).sum(axis=1)
    assert (outward > 0).all()
    under = np.hypot(*away.T) < 2.0
    assert (moved[under, 2] < -0.5).all()
    assert moved[:, 2].max() > 0.02  # the bulge
    assert abs(moved[:, 0] * away[:, 1] - moved[:, 1] * away[:, 0]).max() < 1e-12


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


def test_a_tip_beyond_the_pad_that_does_not_touch_is_no_mistake():
    scene = Scene(Indenter(3.0, ((0, 0, 4.0), (30.0, 0, 0.0)), "wide"), Pose(depth=2.0))
    assert (
        sensor(noise=False).press(scene).image == sensor(noise=False).press(single(depth=2.0)).image
    ).all()


def test_the_pad_is_as_thick_to_the_camera_as_to_the_tips():
    assert PAD.parameters["pad"]["thickness"] == sensor().optics.gel_mm == 5.0


def test_an_instance_differs_in_its_camera_not_in_its_pad():
    one, two = sensor(), sensor(instance=5)
    assert two.optics.gel_mm == one.optics.gel_mm == 5.0
    assert two.optics.camera_distance_mm != one.optics.camera_distance_mm
    assert (two.rest().image != one.rest().image).any()


def test_bound_is_one_row_a_contact_and_small():
    one = sensor()
    for scene in scenes(6):
        limits = one.bound(scene)
        assert limits.shape == (len(true_contacts(scene, math.inf)), 3)
        assert (limits > 0).all()
        assert limits.max() < 0.1
    assert one.bound(single()).shape == (0, 3)
    assert np.isfinite(one.bound(single(depth=3.0))).all()
    assert np.isfinite(one.bound(single(x=10.0, depth=1.0))).all()


def test_the_best_linear_estimate_reaches_the_bound():
    """Weighted least squares on noisy frames around a known pose: its spread is the bound."""
    one, quiet = sensor(read_noise=3.0), sensor(noise=False)
    at, h = np.array([1.3, -0.8, 1.7]), 0.05
    slopes = []
    for k in range(3):
        step = h * np.eye(3)[k]
        up, down = (quiet.clean(tips_at(at + s * step))[0].ravel() for s in (1, -1))
        slopes.append((up - down) / (2 * h))
    jacobian = np.stack(slopes, axis=1)
    clean = quiet.clean(tips_at(at))[0].ravel()
    weight = jacobian / one.renderer.variance(clean)[:, None]
    solve = np.linalg.solve(weight.T @ jacobian, weight.T)
    seen = images(one.press_many([single(*at)] * 400)).reshape(400, -1) - clean
    assert (seen @ solve.T).std(axis=0) == pytest.approx(one.bound(single(*at))[0], rel=0.2)


def tips_at(pose):
    return Tips(np.array([[pose[:2]]]), np.array([[pose[2]]]), np.array([3.0]))


def test_a_table_of_ones_own(tmp_path):
    mine = tmp_path / "mine.npz"
    arrays = {**PAD.arrays, "t": PAD.arrays["t"] * 0.5}
    pad = {**PAD.parameters["pad"], "thickness": 6.0}
    write_tables(mine, arrays, {"pad": pad, "solver": "none"})
    one, other = sensor(), sensor(table=str(mine))
    assert other.optics.gel_mm == 6.0
    assert (one.press(single(depth=3)).image != other.press(single(depth=3)).image).any()
    assert one.describe() != other.describe()
