"""The simulated TacTip: what a press changes, lost pins, refusals, surface, forces, tables."""

import math

import numpy as np
import pytest
from fem_script import write_tables

from tactibench import Contacts, Grid, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import true_contacts
from tactibench.markers import Tracker
from tactibench_sim import (
    TableMechanics,
    TacTip127,
    TacTip331,
    layout,
    shipped_dome,
    shipped_file,
    tips_of,
)

GRID = Grid.centred(64, 0.4)


def sensor(seed=7, **parameters):
    parameters = {"friction": 0.0} | parameters
    return TacTip127(SensorContext(np.random.SeedSequence(seed)), **parameters)


def single(x=0.0, y=0.0, depth=0.0, **move):
    return Scene(Indenter.single(), Pose(x, y, 0.0, 0.0, depth, **move))


def test_a_press_changes_the_frame_where_it_is():
    one = sensor(noise=False)
    rest = one.rest().image.astype(float)
    away = np.abs(one.press(single(x=5.0, depth=2.0)).image - rest)
    assert away[:, 64:].sum() > 1.5 * away[:, :64].sum()
    down = np.abs(one.press(single(y=5.0, depth=2.0)).image - rest)
    assert down[64:].sum() > 1.5 * down[:64].sum()


@pytest.mark.parametrize("kind", [TacTip127, TacTip331])
def test_all_pins_are_told_apart_at_rest_and_pressed(kind):
    """In frames of 128 px, where the real rest frames have them; pairs of pins 3.9 px apart."""
    one = kind(SensorContext(np.random.SeedSequence(7)), noise=False)
    tracker = Tracker(one.rest().image)
    assert len(tracker.rest) == one.pins
    seen = np.stack(one.renderer.project(one.points([single()]))[:2], axis=-1)[0]
    apart = np.linalg.norm(tracker.rest[:, None] - seen, axis=2)
    assert apart.min(axis=1).max() < 0.15
    scenes = [single(4.0, -3.0, depth) for depth in (1.0, 2.0, 4.0)]
    tracks = tracker.track(np.stack([one.press(scene).image for scene in scenes]))
    assert tracks.seen.mean() > 0.97
    places = np.stack(one.renderer.project(one.points(scenes))[:2], axis=-1)
    off = np.linalg.norm(tracks.xy - places[:, apart.argmin(axis=1)], axis=2)
    assert np.median(off[tracks.seen]) < 0.1


def test_without_friction_pins_are_where_the_tables_say_bit_for_bit():
    one, tables = sensor(friction=0.0), TableMechanics(shipped_dome(), "coupled")
    scenes = [single(6.0, 2.0, 3.0), single(0.0, 5.0, 2.0, dx=1.0)]
    tips = tables.pin_tips(tables.loads(tips_of(scenes)), layout(127), one.pin_length)
    assert np.array_equal(one.points(scenes), tips)
    assert not np.array_equal(sensor(friction=0.5).points(scenes), tips)


def test_lost_pins_are_not_seen():
    whole, lossy = sensor(noise=False), sensor(noise=False, pin_loss=0.2)
    assert len(lossy.directions) == 127 - 25
    assert len(lossy.describe()["lost_pins"]) == 25
    missing = whole.rest().image.astype(int) - lossy.rest().image
    assert missing.min() >= 0
    assert missing.max() > 100


def test_wrong_optics_are_refused():
    with pytest.raises(UserError, match="until air is left"):
        sensor(camera_distance=20.0)
    with pytest.raises(UserError, match="not in the gel"):
        sensor(gel_length=5.0)
    with pytest.raises(UserError, match="not below the tips"):
        sensor(background=210.0)


def test_surface_is_deepest_under_the_tip():
    one = sensor()
    surface = one.surface(single(3.0, -2.0, 2.0), GRID)
    row, column = np.unravel_index(surface.argmax(), surface.shape)
    touch = 20 / 21  # the first touch lies nearer the apex than the tip's axis
    assert GRID.xy(row, column) == pytest.approx([3.0 * touch, -2.0 * touch], abs=0.35)
    assert surface.max() == pytest.approx(1.97, abs=0.05)
    assert surface.min() < 0  # the bulge
    assert one.surface(single(3.0, -2.0, 2.0), Grid.centred(64, 1.0))[0, 0] == 0


def test_a_table_of_ones_own(tmp_path):
    mine = tmp_path / "dome.npz"
    arrays = dict(shipped_file("dome.npz").arrays)
    arrays["sphere3_w"] = arrays["sphere3_w"] * 0.5
    write_tables(mine, arrays, shipped_dome().parameters)
    one, other = sensor(), sensor(table=str(mine))
    assert (one.press(single(depth=3)).image != other.press(single(depth=3)).image).any()
    assert one.describe() != other.describe()
    for name in (tmp_path / "missing.npz", tmp_path / "text.npz"):
        (tmp_path / "text.npz").write_text("no archive")
        with pytest.raises(UserError, match="cannot be read"):
            sensor(table=str(name))
    for more in ({"instance": 3}, {"instances": 2}):
        with pytest.raises(UserError, match=r"sensor.table=.* and .*name different sensors"):
            sensor(table=str(mine), **more)


def test_a_table_of_one_radius(tmp_path):
    """As scripts/fem makes it for one --radius: it has no plate."""
    mine, arrays = tmp_path / "four.npz", {}
    for name, array in shipped_file("dome.npz").arrays.items():
        if name in ("delta", "polar") or name.startswith("sphere3"):
            arrays[name.replace("sphere3", "sphere4")] = array
    write_tables(mine, arrays, {"dome": shipped_dome().parameters["dome"]})
    four = sensor(table=str(mine), friction=0.5)
    assert (four.rest().image == sensor().rest().image).all()
    assert four.points([Scene(Indenter.single(4.0), Pose(depth=3.0, dx=1.0))]).any()
    for radius, depth, dx, said in (
        (3.0, 2.0, 0.0, "tables for: 4 mm"),
        (4.0, 5.0, 1.0, "drag tables end at 4 mm"),
    ):
        with pytest.raises(UserError, match=said):
            four.press(Scene(Indenter.single(radius), Pose(depth=depth, dx=dx)))


def test_a_spoilt_or_pickled_table_is_refused(tmp_path):
    path = tmp_path / "spoilt.npz"
    write_tables(path, {"delta": np.arange(3.0)}, {})
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match="cannot be read"):
        sensor(table=str(path))
    np.savez(path, more=np.array([{}], dtype=object), parameters="{}", sha256="")
    with pytest.raises(UserError, match=r"cannot be read \(ValueError\)"):
        sensor(table=str(path))


TABLE = shipped_dome().by_radius[3.0]
SINGLE = Indenter.single()


@pytest.fixture(scope="module")
def tactip():
    return sensor(modulus=1.0, friction=0.0)


def tips(*offsets):
    return Indenter(3.0, tuple(offsets), "custom")


def forces(tactip, scene):
    """(K,) normal forces, E_skin mm^2."""
    return np.linalg.norm(tactip.press(scene).force, axis=1)


def test_a_single_contact_at_a_node_carries_what_the_table_says(tactip):
    for node in (1, 4, 8, 24, 48):
        force = forces(tactip, Scene(SINGLE, Pose(depth=TABLE.delta[node])))
        assert force == pytest.approx([TABLE.fields["force"][node]], rel=1e-12)


FINITE_ELEMENTS = {
    0: (0.175, 0.588, 1.792),
    20: (0.175, 0.594, 1.802),
    40: (0.177, 0.601, 1.859),
    55: (0.179, 0.631, 2.028),
}
"""Polar angle, deg -> forces 1, 3 and 6 mm deep, by the three-dimensional model of scripts/fem,
which is 1 % stiffer than the tables at the apex."""


@pytest.mark.parametrize("polar", FINITE_ELEMENTS)
def test_forces_off_the_apex_are_those_of_finite_elements(tactip, polar):
    for depth, force in zip((1.0, 3.0, 6.0), FINITE_ELEMENTS[polar], strict=True):
        away = 23 - depth  # the penetration is along the line to the dome's centre
        x, z = away * math.sin(math.radians(polar)), away * math.cos(math.radians(polar))
        down = math.sqrt(23**2 - x**2) - z
        assert forces(tactip, Scene(SINGLE, Pose(x, depth=down))) == pytest.approx(
            [force], rel=0.02
        )


def test_tips_at_one_place_carry_together_what_one_carries(tactip):
    one = forces(tactip, Scene(SINGLE, Pose(1, 2, 0, 0, 2.5)))
    for count in (2, 3):
        carried = forces(tactip, Scene(tips(*[(0, 0, 0)] * count), Pose(1, 2, 0, 0, 2.5)))
        assert len(carried) == count
        assert carried.sum() == pytest.approx(one[0], rel=1e-9)


@pytest.mark.parametrize("indenter", [SINGLE, Indenter.dual(7), Indenter.triple((0, 0.5, 1))])
def test_the_whole_force_grows_with_depth(tactip, indenter):
    depths = np.linspace(0.05, 6.0, 40)
    whole = [forces(tactip, Scene(indenter, Pose(1, 0, 30, 0, d))).sum() for d in depths]
    assert (np.diff(whole) > 0).all()
    assert whole[0] < 0.02


def test_forces_are_in_the_order_of_the_true_contacts(tactip):
    scene = Scene(tips((-4, 0, 0), (4, 0, 0.8), (0, 6, -9)), Pose(depth=2))
    contacts: Contacts = true_contacts(scene)
    force = tactip.press(scene).force
    assert force.shape == (len(contacts), 3) == (2, 3)
    assert (np.argsort(-force[:, 2]) == np.argsort(contacts.depth)).all()
    assert tactip.press(Scene(SINGLE, Pose())).force.shape == (0, 3)


def split(force, scene):
    """(K,) normal and tangential forces of tips on the skin."""
    contacts = true_contacts(scene)
    z = np.sqrt(23.0**2 - (contacts.xy**2).sum(axis=1)) - contacts.depth
    n = np.column_stack([contacts.xy, z])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    normal = -(force * n).sum(axis=1)
    return normal, np.linalg.norm(force + normal[:, None] * n, axis=1)


def test_forces_are_newtons_and_tangential_ones_keep_to_coulomb():
    scene = Scene(Indenter.dual(9.0), Pose(4.0, -2.0, 30.0, depth=2.0))
    smooth = split(sensor(modulus=0.5, friction=0.0).press(scene).force, scene)
    assert smooth[1] == pytest.approx([0, 0], abs=1e-9)
    one, other = (
        sensor(modulus=m, friction=0.5, friction_within=0.0).press(scene).force for m in (0.5, 1.0)
    )
    assert other == pytest.approx(2 * one, rel=1e-12)
    normal, tangential = split(one, scene)
    assert normal == pytest.approx(smooth[0], rel=0.1)
    assert (tangential > 0.2 * normal).all()
    assert (tangential < 0.55 * normal).all()  # mu 0.5, about the normal where the skin was pressed
    assert sensor().press(scene).force is None


@pytest.mark.parametrize("more", [{}, {"instances": 3}])
def test_every_press_tells_the_force_of_its_own_friction(more):
    scenes = [Scene(SINGLE, Pose(5.0, depth=2.0))] * 6
    whole = [frame.force for frame in sensor(modulus=1.0, friction=0.5, **more).press_many(scenes)]
    single = sensor(modulus=1.0, friction=0.5, **more)
    again = [single.press(scene).force for scene in scenes]
    assert np.array_equal(whole, again)
    ratios = [tangential / normal for normal, tangential in (split(f, scenes[0]) for f in whole)]
    assert np.ptp(ratios) > 0.02
