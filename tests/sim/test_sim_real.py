"""The simulated plate presses and the fit of their unknowns."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from tac_vgnn import tac_vgnn_folder

from tactibench_sim.real.calibration import SHIPPED, WITHOUT, Calibration, Unknowns, shipped
from tactibench_sim.real.comparison import checkerboard, compare, error_table, errors_of
from tactibench_sim.real.fit import fit, rig_of
from tactibench_sim.real.plate import (
    FILE,
    Labels,
    Rig,
    directions,
    displacements,
    drag_mm,
    indentation,
    kinds,
    plate,
)
from tactibench_sim.real.recording import Presses

STRAIGHT = Unknowns(centre_x=179.5, centre_y=179.5, drag_per_mm=-0.6)


def layout():
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return 179.5 + np.concatenate([[[0.0, 0.0]], *(k * ring for k in (20, 45, 75, 105, 130))])


def labels(rows):
    return Labels(*np.array(rows, dtype=float).T)


def some(count, seed=0):
    rng = np.random.default_rng(seed)
    columns = rng.uniform([-4, -20, -1, -5], [0, 20, 1, 5], (count, 4))
    return labels(columns)


@pytest.fixture(params=["50_stick", "50_none"])
def what(request):
    return Rig(plate(request.param), layout(), 360)


def test_pins_stand_where_the_rest_frame_shows_them(what) -> None:
    pins = directions(what, STRAIGHT)
    assert np.allclose(np.linalg.norm(pins, axis=1), 1)
    angle = np.arctan2(*(layout()[1:] - 179.5).T[::-1])
    assert np.allclose(np.arctan2(pins[1:, 1], pins[1:, 0]), angle)
    assert (np.diff(pins[1::12, 2]) < 0).all()


def test_a_plate_above_the_dome_moves_nothing(what) -> None:
    moved = displacements(what, STRAIGHT, labels([[-6, 0, 0, 0], [-5.5, 10, 0, 0]]), np.ones(2))
    assert abs(moved).max() < 1e-9


def test_one_pin_agrees_with_a_plain_pinhole_and_splines(what) -> None:
    """A press without drag, no refraction: the formula written down once more."""
    x = replace(STRAIGHT, air_mm=20.0, gel_mm=22.0, focal_px=200.0, pin_length_mm=1.3)
    bare = replace(what, lens="pinhole", gel_index=1.0)
    press = labels([[-2.0, 12.0, 0.0, 0.0]])
    depth, tilt = float(indentation(x, press)[0]), math.radians(12.0)
    way = -2 + 5 + 20 * (1 - math.cos(tilt))
    assert depth == pytest.approx(way * (1 - x.give_per_mm * way))
    from importlib.resources import files

    kind = "50_stick" if what.plate is plate("50_stick") else "50_none"
    content = np.load(str(files("tactibench_sim.real").joinpath(FILE)))
    splines = [
        RectBivariateSpline(content["delta"], content["polar"], content[f"{kind}_press"][..., k])
        for k in range(3)
    ]
    normal = np.array([0.0, math.sin(tilt), math.cos(tilt)])

    def seen(tip):
        return 200.0 * tip[:2] / (20 + 22 - 20 + tip[2])

    moved = displacements(bare, x, press, np.ones(1))[0]
    for pin, found in zip(directions(bare, x), moved, strict=True):
        angle = math.acos(pin @ normal)
        w, t, turn = (float(s(depth, angle)[0, 0]) for s in splines)
        along = np.cross(np.cross(normal, pin), pin) / math.sin(angle)  # away from the contact
        tip = 19 * pin - w * pin + t * along - 1.3 * (math.cos(turn) * pin + math.sin(turn) * along)
        assert found == pytest.approx(seen(tip) - seen((19 - 1.3) * pin), abs=4e-3)


def test_presses_are_mirrored_and_turned_with_the_labels(what) -> None:
    one = some(12)
    two = Labels(one.depth, -one.tilt, -one.move, -one.turn)
    x = replace(STRAIGHT, drag_per_deg=0.02, drag_per_tilt=0.1)
    flipped = replace(what, rest=what.rest * [1, -1] + [0, 359.0])
    mirrored = displacements(flipped, x, two, np.ones(12)) * [1, -1]
    turned = displacements(what, replace(x, yaw_deg=-90.0), two, np.ones(12))
    expected = displacements(what, x, one, np.ones(12))
    assert np.allclose(mirrored, expected, atol=1e-9)
    assert np.allclose(turned, expected, atol=1e-9)


def test_the_plate_takes_along_the_skin_it_holds() -> None:
    for kind in kinds():
        drag = plate(kind).drag(math.radians(25.0))
        centre, rim = drag[0], drag[-1]
        assert centre[1] == pytest.approx(1.0, abs=0.02)
        assert centre[2] == pytest.approx(-1.0, abs=0.02)
        assert abs(rim).max() < 0.02
        assert (np.diff(plate(kind).patch) >= 0).all()


def test_only_a_dragged_press_is_dragged(what) -> None:
    press = labels([[-1.0, 0.0, 0.8, 0.0]])
    yes, no = (displacements(what, STRAIGHT, press, np.full(1, d)) for d in (1.0, 0.0))
    still = displacements(what, STRAIGHT, labels([[-1.0, 0.0, 0.0, 0.0]]), np.ones(1))
    assert np.allclose(no, still)
    assert (yes - no)[0, 0, 1] < -2.0  # the centre pin goes where the plate goes, up the frame
    assert (yes - no)[0, :, 0].mean() == pytest.approx(0.0, abs=1e-6)


def made(truth, count, seed):
    told, rest = some(count, seed), layout()
    what = Rig(plate("50_stick"), rest, 360)
    dragged = np.random.default_rng(seed).integers(0, 2, count).astype(float)
    moved = displacements(what, truth, told, dragged)
    return Presses(tuple(map(str, range(count))), told, rest, moved, 360)


def test_the_fit_finds_what_made_the_presses() -> None:
    truth = replace(
        STRAIGHT,
        depth_offset_mm=5.6,
        pivot_mm=17.0,
        pivot_side_mm=0.5,
        drag_per_mm=-0.75,
        yaw_deg=89.0,
        focal_px=113.0,
        centre_x=178.0,
    )
    free = (
        "depth_offset_mm",
        "pivot_mm",
        "pivot_side_mm",
        "drag_per_mm",
        "yaw_deg",
        "focal_px",
        "centre_x",
    )
    first, others = made(truth, 40, 3), made(truth, 30, 4)
    what = rig_of(first, "50_stick")
    found, loss = fit(first, what, STRAIGHT, free)
    assert loss < 0.01
    for name in free:
        assert getattr(found, name) == pytest.approx(getattr(truth, name), rel=0.02), name
    assert np.median(errors_of(others, what, found, state_known=True).relative) < 0.01


def test_a_missing_pin_counts_in_no_error() -> None:
    presses = made(STRAIGHT, 10, 5)
    moved = presses.moved.copy()
    moved[:, 7] = np.nan
    gaps = replace(presses, moved=moved)
    what = rig_of(presses, "50_stick")
    result = errors_of(gaps, what, STRAIGHT, state_known=True)
    assert result.relative.max() < 1e-6
    rows = error_table(gaps, what, STRAIGHT, result, result)
    assert rows[0].presses == 10
    assert rows[0].pixels < 1e-6
    assert rows[0].gain == pytest.approx(1.0)


@pytest.mark.slow
def test_the_drag_tables_come_out_of_the_finite_elements_again() -> None:
    pytest.importorskip("ngsolve")
    from tabulate_plates import drag

    from tactibench_sim.fem import Dome

    polar = np.radians(np.arange(91.0))
    for patch in (12.0, 30.0):
        again = drag(Dome(stiffness_ratio=50, apex_size=0.2), np.radians([patch]), polar)[0]
        shipped = plate("50_stick").drag(math.radians(patch))[::4]
        assert abs(again - shipped)[:, :3].max() < 0.03  # another mesh


def test_a_plate_slips_beyond_its_limit(what) -> None:
    """To the limit the skin follows the plate; beyond it more travel changes nothing."""
    x = replace(STRAIGHT, slip_mm=0.3, slip_power=1.5, give_per_mm=0.0)
    depth = float(indentation(x, labels([[-2.0, 0.0, 0.0, 0.0]]))[0])
    limit = 0.3 * depth**1.5
    moves = np.array([-3, -2, -1.01, -0.99, -0.5, 0, 0.5, 0.99, 1.01, 2, 3]) * limit / 0.6
    told = labels([[-2.0, 0.0, move, 0.0] for move in moves])
    pull = drag_mm(x, told, np.full(len(moves), depth), np.ones(len(moves)))
    assert pull == pytest.approx(np.clip(-0.6 * moves, -limit, limit))
    field = displacements(what, x, told, np.ones(len(moves)))
    assert np.array_equal(field[0], field[2])
    assert np.array_equal(field[-1], field[-3])
    assert abs(field[3] - field[4]).max() > 1.0


def test_what_holds_the_dome_gives_way(what) -> None:
    """A plate whose travel is t stands at t (1 - g t), whatever its tilt."""
    x, stiff = replace(STRAIGHT, give_per_mm=0.04), replace(STRAIGHT, give_per_mm=0.0)
    told = some(20)
    way = indentation(stiff, told)
    assert indentation(x, told) == pytest.approx(np.where(way > 0, way * (1 - 0.04 * way), way))
    shallower = labels(
        np.stack([told.depth - 0.04 * way.clip(0) ** 2, told.tilt, told.move, told.turn], axis=1)
    )
    again = displacements(what, stiff, shallower, np.ones(20))
    assert displacements(what, x, told, np.ones(20)) == pytest.approx(again, abs=1e-9)


def test_held_out_blocks_touch_no_fitted_one_of_their_tilt_and_depth() -> None:
    told = some(4000)
    fitted, part = checkerboard(told)
    assert 0.4 < fitted.mean() < 0.6
    assert set(part) == {0, 1, 2, 3}
    column = np.floor(4 * (told.tilt + 20) / 40.0).clip(0, 3)
    row = np.floor(4 * (told.depth + 4) / 4.0).clip(0, 3)
    inside = (abs(4 * (told.tilt + 20) / 40 % 1 - 0.5) < 0.45) & (
        abs((told.depth + 4) % 1 - 0.5) < 0.45
    )
    assert ((column + row)[inside] % 2 == 0).tolist() == fitted[inside].tolist()


def test_a_file_of_version_1_knows_neither_slip_nor_give(tmp_path) -> None:
    """And says the same about itself as before, so that stored runs keep their identity."""
    old = shipped("")
    assert (old.unknowns.slip_mm, old.unknowns.give_per_mm) == (math.inf, 0.0)
    assert set(old.content()["unknowns"]) == {f.name for f in fields(Unknowns)} - set(WITHOUT)
    for name in SHIPPED:
        shipped(name).write(tmp_path / "again.json")
        assert Calibration.read(tmp_path / "again.json") == shipped(name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pins", "everywhere", "hardly_moved"), [("331", 0.25, 0.16), ("127", 0.30, 0.20)]
)
def test_real_presses_are_met_where_none_was_fitted(pins, everywhere, hardly_moved) -> None:
    comparison = compare(tac_vgnn_folder(f"{pins}/model_surface2d"))
    rows = {row.group: row for row in comparison.rows}
    assert comparison.complete > 0.99
    assert rows["all"].presses > 2000
    assert rows["all"].relative <= everywhere
    assert rows["move 0-1 mm"].relative <= hardly_moved
    for name, row in rows.items():
        if name.startswith("indentation") and row.presses > 100:
            assert row.gain == pytest.approx(1.0, abs=0.05)
