"""The three-dimensional reference against the axisymmetric one, its own mesh, and the tables."""

import math
from dataclasses import replace

import numpy as np
import pytest
import snapshots
from snapshots import Run
from spatial_runs import press_scene

from tactibench_sim import fem
from tactibench_sim.fem.press import Fineness
from tactibench_sim.fem.tip import Tip
from tactibench_sim.mechanics import tables as table_file
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.pins import layout

pytestmark = pytest.mark.slow
ngs = pytest.importorskip("ngsolve", reason="needs the extra `fem`")

DOME = fem.Dome()
APEX = Tip.along_axis(DOME, np.array([0.0, 0.0, 1.0]), 3.0)
PINS = layout(331)
COARSE = Fineness(contact=0.6, largest=2.0, margin=1.0, far=6.0)


def moved(displacement, other):
    return np.linalg.norm(displacement - other, axis=-1).max()


def meridian(one, depth):
    """(P, 3) displacement of PINS, force: the axisymmetric table."""
    row = round(depth / one.delta[1])
    polar = np.arccos(PINS[:, 2])
    w, t = (np.interp(polar, one.polar, one.fields[name][row]) for name in ("w", "t"))
    azimuth = np.arctan2(PINS[:, 1], PINS[:, 0])
    away = [np.cos(polar) * np.cos(azimuth), np.cos(polar) * np.sin(azimuth), -np.sin(polar)]
    return t[:, None] * np.stack(away, axis=1) - w[:, None] * PINS, one.fields["force"][row]


def test_on_the_apex_it_is_the_axisymmetric_run():
    one = table_file.shipped().by_radius[3.0]
    depths = np.array([[1.0], [2.0]])
    for field in press_scene(DOME, [APEX], depths, mirror=True):
        expected, force = meridian(one, field.depths[0])
        assert moved(field.inner(PINS), expected) <= 0.02
        assert -field.forces[0, 2] == pytest.approx(force, rel=0.02)


def test_a_plate_is_the_axisymmetric_run():
    one = table_file.shipped().by_radius[math.inf]
    plate = Tip.along_axis(DOME, np.array([0.0, 0.0, 1.0]), math.inf)
    (field,) = press_scene(DOME, [plate], np.array([[1.0]]), mirror=True)
    expected, force = meridian(one, 1.0)
    assert moved(field.inner(PINS), expected) <= 0.03
    assert -field.forces[0, 2] == pytest.approx(force, rel=0.03)


def test_a_finer_mesh_changes_little():
    """Elements of two thirds: measured 0.013 mm and 1.05 % at 2 mm."""
    usual, depths = Fineness(), np.array([[2.0]])
    finer = replace(usual, contact=0.27, largest=1.1, far=3.0)
    coarse, fine = (
        next(press_scene(DOME, [APEX], depths, mirror=True, fineness=each))
        for each in (usual, finer)
    )
    assert coarse.forces[0, 2] == pytest.approx(fine.forces[0, 2], rel=0.015)
    assert moved(coarse.inner(PINS), fine.inner(PINS)) <= 0.015


def test_the_enclosed_volume_is_conserved():
    """Of the deformed inner skin, by its own triangles: nothing of the solver's."""
    tip = Tip.downwards(DOME, 5.0, 0.0, 3.0)
    (field,) = press_scene(DOME, [tip], np.array([[2.0]]), mirror=True, fineness=COARSE)
    polar, azimuth = np.radians(np.arange(0, 91, 1.5)), np.radians(np.arange(0, 361, 3.0))
    p, a = np.meshgrid(polar, azimuth, indexing="ij")
    b = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)
    b[..., 2] = np.maximum(b[..., 2], 0)

    def volume(surface):
        s = surface.reshape(b.shape)
        corners = s[:-1, :-1], s[1:, :-1], s[1:, 1:], s[:-1, 1:]
        return sum(
            (np.cross(corners[i], corners[j]) * corners[0]).sum() / 6 for i, j in ((1, 2), (2, 3))
        )

    rest = 19 * b.reshape(-1, 3)
    after = volume(rest + field.inner(b.reshape(-1, 3)))
    assert after == pytest.approx(volume(rest), rel=0.01)
    assert abs(field.inner(b.reshape(-1, 3))).max() > 1


def test_half_a_dome_is_half_of_a_whole_one():
    tips, depths = [Tip.downwards(DOME, x, 0.0, 3.0) for x in (-4.0, 4.0)], np.array([[1.0, 0.6]])
    (half,) = press_scene(DOME, tips, depths, mirror=True, fineness=COARSE)
    (whole,) = press_scene(DOME, tips, depths, fineness=COARSE)
    assert moved(half.inner(PINS), whole.inner(PINS)) <= 0.05  # two meshes, both coarse
    assert half.forces[:, 2] == pytest.approx(whole.forces[:, 2], rel=0.05)
    mirrored = whole.inner(PINS * [1, -1, 1]) * [1, -1, 1]
    assert moved(whole.inner(PINS), mirrored) <= 0.05


def test_two_spheres_in_one_place_are_one():
    depths = np.array([[1.0]])
    (one,) = press_scene(DOME, [APEX], depths, mirror=True, fineness=COARSE)
    pair = np.repeat(depths, 2, axis=1)
    (two,) = press_scene(DOME, [APEX, APEX], pair, mirror=True, fineness=COARSE)
    assert moved(one.inner(PINS), two.inner(PINS)) <= 0.01
    assert two.forces[:, 2].sum() == pytest.approx(one.forces[0, 2], rel=0.01)
    assert two.forces[0, 2] == pytest.approx(two.forces[1, 2], rel=1e-9)


def chart_tips(run, depths):
    """A run's states as the tables take them; spheres only."""
    axes = np.array([tip.axis for tip in run.tips(DOME)])
    centres = (DOME.outer + run.radius - depths)[..., None] * axes
    height = np.sqrt((DOME.outer + run.radius) ** 2 - (centres[..., :2] ** 2).sum(axis=-1))
    return Tips(centres[..., :2], height - centres[..., 2], np.full(len(depths), run.radius))


@pytest.mark.parametrize(
    ("run", "depths"),
    [(Run(3.0, 40.0, False), [[2.0]]), (Run(3.0, 18.5, True), [[1.75, 1.75]])],
    ids=["single", "pair"],
)
def test_the_shipped_corrections_are_reproduced(run, depths):
    tables = table_file.shipped()
    if not tables.corrections.arrays:
        pytest.skip("the shipped table has no corrections")
    depths, frame = np.array(depths), run.frame()
    (field,) = press_scene(DOME, run.tips(DOME), depths, mirror=True)
    state = snapshots.sampled(field, run)
    b = run.chart.directions() @ frame
    near = b[..., 2] > math.cos(math.radians(65))
    mechanics = TableMechanics(tables, "coupled")
    u, _ = mechanics.displacement(mechanics.loads(chart_tips(run, depths)), b[near])
    # What twelve modes on nodes 5 deg apart leave of a state that they were made from.
    assert moved(u[0], state[0][near] @ frame) <= 0.04
