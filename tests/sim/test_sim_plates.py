"""The simulated plate presses: geometry, symmetry, drag and slip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from tactibench_sim import (
    Labels,
    Rig,
    Unknowns,
    changes,
    directions,
    drag_mm,
    indentation,
    plate_of,
    project,
    shipped_file,
)

KINDS = ("50_stick", "50_none")
STRAIGHT = Unknowns(centre_x=179.5, centre_y=179.5, drag_per_mm=-0.6)


def layout():
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return 179.5 + np.concatenate([[[0.0, 0.0]], *(k * ring for k in (20, 45, 75, 105, 130))])


def labels(rows):
    return Labels(*np.array(rows, dtype=float).T)


@pytest.fixture(params=KINDS)
def what(request):
    return Rig(plate_of(request.param), layout(), 360)


def test_pins_stand_where_the_rest_frame_shows_them(what) -> None:
    pins = directions(what, STRAIGHT)
    assert np.allclose(np.linalg.norm(pins, axis=1), 1)
    angle = np.arctan2(*(layout()[1:] - 179.5).T[::-1])
    assert np.allclose(np.arctan2(pins[1:, 1], pins[1:, 0]), angle)
    assert (np.diff(pins[1::12, 2]) < 0).all()


def test_one_pin_agrees_with_splines_and_a_lever(what) -> None:
    """A press without drag: the formula written down once more."""
    x = replace(STRAIGHT, air_mm=20.0, gel_mm=22.0, focal_px=200.0, pin_length_mm=1.3)
    press = labels([[-2.0, 12.0, 0.0, 0.0]])
    depth, tilt = float(indentation(x, press)[0]), math.radians(12.0)
    way = -2 + 5 + 20 * (1 - math.cos(tilt))
    assert depth == pytest.approx(way * (1 - x.give_per_mm * way))
    kind, content = KINDS[what.plate is plate_of(KINDS[1])], shipped_file("plates.npz").arrays
    splines = [
        RectBivariateSpline(content["delta"], content["polar"], content[f"{kind}_press"][..., k])
        for k in range(3)
    ]
    normal = np.array([0.0, math.sin(tilt), math.cos(tilt)])

    def seen(tip):
        return np.array(project(x.optics(360), tip, 20.0 + 22.0 - 20.0)[:2])

    moved = changes(what, x, press, np.ones(1))[..., :2][0]
    for pin, found in zip(directions(what, x), moved, strict=True):
        angle = math.acos(pin @ normal)
        if angle > math.radians(85):  # the tables end at the clamped rim
            continue
        w, t, turn = (float(s(depth, angle)[0, 0]) for s in splines)
        along = np.cross(np.cross(normal, pin), pin) / math.sin(angle)  # away from the contact
        tip = 19 * pin - w * pin + t * along - 1.3 * (math.cos(turn) * pin + math.sin(turn) * along)
        assert found == pytest.approx(seen(tip) - seen((19 - 1.3) * pin), abs=4e-3)


def test_presses_are_mirrored_and_turned_with_the_labels(what) -> None:
    rng = np.random.default_rng(0)
    one = labels(rng.uniform([-4, -20, -1, -5], [0, 20, 1, 5], (12, 4)))
    two = Labels(one.depth, -one.tilt, -one.move, -one.turn)
    x = replace(STRAIGHT, drag_per_deg=0.02, drag_per_tilt=0.1)
    flipped = replace(what, rest=what.rest * [1, -1] + [0, 359.0])
    mirrored = changes(flipped, x, two, np.ones(12))[..., :2] * [1, -1]
    turned = changes(what, replace(x, yaw_deg=-90.0), two, np.ones(12))[..., :2]
    expected = changes(what, x, one, np.ones(12))[..., :2]
    assert np.allclose(mirrored, expected, atol=1e-9)
    assert np.allclose(turned, expected, atol=1e-9)


def test_a_plate_slips_beyond_its_limit(what) -> None:
    """To the limit the skin follows the plate; beyond it more travel changes nothing."""
    x = replace(STRAIGHT, slip_mm=0.3, slip_power=1.5, give_per_mm=0.0)
    depth = float(indentation(x, labels([[-2.0, 0.0, 0.0, 0.0]]))[0])
    limit = 0.3 * depth**1.5
    moves = np.array([-3, -2, -1.01, -0.99, -0.5, 0, 0.5, 0.99, 1.01, 2, 3]) * limit / 0.6
    told = labels([[-2.0, 0.0, move, 0.0] for move in moves])
    pull = drag_mm(x, told, np.full(len(moves), depth), np.ones(len(moves)))
    assert pull == pytest.approx(np.clip(-0.6 * moves, -limit, limit))
    field = changes(what, x, told, np.ones(len(moves)))[..., :2]
    assert np.array_equal(field[0], field[2])
    assert np.array_equal(field[-1], field[-3])
    assert abs(field[3] - field[4]).max() > 1.0
