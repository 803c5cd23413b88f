"""The shipped table: integrity, reference figures, what mechanics demands, and how it is made."""

import math
import shutil
from importlib.resources import files

import numpy as np
import pytest
from dome_press import press
from hard_scenes import enclosed_volume
from tabulate_dome import columns, normal_rotation

from tactibench_sim import data_file, fem
from tactibench_sim.mechanics import tables as table_file

SHIPPED = files("tactibench_sim.mechanics").joinpath(table_file.FILE)
TABLES = table_file.shipped()
SPHERE, PLATE = TABLES.by_radius[3.0], TABLES.by_radius[math.inf]
BOTH = pytest.mark.parametrize("one", [SPHERE, PLATE], ids=["sphere", "plate"])


def test_file_is_small():
    assert len(SHIPPED.read_bytes()) < 2_000_000


def test_writing_and_reading_agree(tmp_path):
    path = tmp_path / "again.npz"
    with np.load(str(SHIPPED)) as archive:
        arrays = {k: archive[k] for k in archive.files if k not in ("parameters", "sha256")}
    assert data_file.write(path, arrays, TABLES.parameters) == TABLES.digest
    assert table_file.read(path).digest == TABLES.digest
    assert list(tmp_path.iterdir()) == [path]


def test_forces_of_an_independent_feasibility_run():
    """Same dome, another code and mesh; its figures carry two or three digits."""
    depths = np.array([0.25, 0.5, 1.0, 1.5, 2.0])
    force = np.interp(depths, SPHERE.delta, SPHERE.fields["force"])
    assert force == pytest.approx([0.043, 0.088, 0.173, 0.259, 0.353], rel=0.012)


def test_profile_of_an_independent_feasibility_run():
    at = np.radians([0.5, 5, 10, 15, 20, 30, 40])
    w = SPHERE.fields["w"][np.searchsorted(SPHERE.delta, 1.0)]
    told = [0.96, 0.67, 0.35, 0.16, 0.06, -0.004, -0.019]
    assert np.interp(at, SPHERE.polar, w) == pytest.approx(told, abs=0.025)


@BOTH
def test_force_grows_with_depth(one):
    assert one.fields["force"][0] == 0
    assert (np.diff(one.fields["force"]) > 0).all()


@BOTH
def test_nothing_moves_at_depth_zero_and_at_the_rim(one):
    for name in ("w", "t", "omega", "w_outer", "t_outer"):
        assert abs(one.fields[name][0]).max() < 1e-9
    for name in ("w", "t", "w_outer", "t_outer"):
        assert abs(one.fields[name][:, -1]).max() < 1e-5


@BOTH
def test_the_skin_is_where_the_indenter_is(one):
    """At the apex the outer skin has moved by the penetration, but for the contact's stiffness."""
    assert one.fields["w_outer"][:, 0] == pytest.approx(one.delta, abs=0.004)


@BOTH
@pytest.mark.parametrize(("which", "radius"), [("", 19.0), ("_outer", 20.0)])
def test_enclosed_volume_is_conserved(one, which, radius):
    """What the dimple takes the bulge gives, to 1 % of the dimple: nu is 1/2 exactly."""
    start = enclosed_volume(radius, one.polar, 0 * one.polar, 0 * one.polar)
    for row in (4, 8, 24, 48, 52):
        w, t = one.fields[f"w{which}"][row], one.fields[f"t{which}"][row]
        dimple = start - enclosed_volume(radius, one.polar, np.maximum(w, 0), 0 * w)
        assert abs(enclosed_volume(radius, one.polar, w, t) - start) < 0.01 * dimple


def test_rotation_is_that_of_a_rigid_displacement():
    """Moving a sphere as a whole (w = a cos, t = a sin) turns no normal."""
    polar = np.radians(np.arange(181) / 2)
    turned = normal_rotation(19.0, polar, 2 * np.cos(polar)[None], 2 * np.sin(polar)[None])
    assert abs(turned).max() < 1e-6


def test_rotation_of_a_small_displacement_is_the_linear_one():
    polar = np.radians(np.arange(181) / 2)
    w, t = 1e-5 * np.cos(3 * polar), 1e-5 * np.sin(2 * polar)
    linear = (-3e-5 * np.sin(3 * polar) + t) / 19.0
    assert normal_rotation(19.0, polar, w, t)[1:] == pytest.approx(linear[1:], abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, math.inf], ids=["sphere", "plate"])
def test_finite_elements_give_the_table_again(radius):
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    one = TABLES.by_radius[radius]
    dome = fem.Dome(**TABLES.parameters["dome"])
    again = columns(dome, radius, one.delta, one.polar)
    for name, values in again.items():
        assert values == pytest.approx(one.fields[name], abs=2e-5), name


@pytest.mark.slow
def test_a_coarser_mesh_gives_the_same_force():
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    coarse = fem.Dome(apex_size=0.16, skin_size=0.5, gel_size=2.0)
    *_, last = press(coarse, 3.0, np.array([0.5, 1.0]), SPHERE.polar)
    told = np.interp(1.0, SPHERE.delta, SPHERE.fields["force"])
    assert last.force == pytest.approx(told, rel=0.01)


def test_copy_of_the_shipped_file_reads(tmp_path):
    path = shutil.copy(str(SHIPPED), tmp_path / "copy.npz")
    assert table_file.read(path).digest == TABLES.digest
