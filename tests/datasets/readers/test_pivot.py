"""Offset and pivot behind plate labels: exact on the law, close on simulated and real pins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tac_vgnn import tac_vgnn_folder

from tactibench import UserError
from tactibench.datasets import (
    EXPONENT,
    ImportOptions,
    Pivot,
    RecordingFit,
    direction_of,
    fit_pivot,
    fit_recording,
    indentation,
    middle_of_spread,
    open_recording,
    presses_to_fit,
    spread_of,
)
from tactibench.datasets import pivot as pivot_module


def presses(count=600, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(1, 5, count), rng.uniform(-20, 20, count), rng


def label(depth, tilt, offset, pivot, side=0.0):
    """The label that a robot writes at this indentation; the inverse of ``indentation``."""
    turned = np.radians(tilt)
    return depth - offset - pivot * (1 - np.cos(turned)) - side * np.sin(turned)


def test_indentation_is_the_written_formula():
    assert indentation(-1.0, 60.0, 5.0, 20.0) == pytest.approx(14.0)
    np.testing.assert_allclose(indentation([-1, 2], [0, 90], 3, 7), [2, 12])
    np.testing.assert_allclose(indentation([0, 0], [30, -30], 3, 0, 2), [4, 2])


@pytest.mark.parametrize(
    ("offset", "pivot", "side"),
    [(5.0, 20.0, 0.0), (5.0, 0.0, 7.2), (-2.0, -15.0, -1.0)],
)
def test_the_law_itself_gives_offset_and_pivot_back(offset, pivot, side):
    depth, tilt, _ = presses()
    spread = 0.7 * depth**EXPONENT * np.exp(0.1 * tilt / 20 - 0.2 * (tilt / 20) ** 2)
    fit = fit_pivot(spread, label(depth, tilt, offset, pivot, side), tilt)
    assert fit.offset_mm == pytest.approx(offset, abs=1e-4)
    assert fit.pivot_mm == pytest.approx(pivot, abs=1e-2)
    assert fit.side_mm == pytest.approx(side, abs=1e-3)
    assert (fit.presses, fit.left_out) == (600, 0)
    assert fit.residual < 1e-5


def test_shear_is_taken_out():
    depth, tilt, rng = presses()
    shear = rng.uniform(-5, 5, (len(depth), 1))
    spread = depth**EXPONENT * np.exp(0.2 * (shear[:, 0] / 5) ** 2 + 0.1 * shear[:, 0] / 5)
    fit = fit_pivot(spread, label(depth, tilt, 5, 20), tilt, shear)
    assert (fit.offset_mm, fit.pivot_mm) == pytest.approx((5, 20), abs=1e-2)


def test_the_stated_scatter_is_the_scatter():
    fits = []
    for seed in range(16):
        depth, tilt, rng = presses(250, seed)
        spread = depth**EXPONENT * np.exp(rng.normal(0, 0.02, len(depth)))
        fits.append(fit_pivot(spread, label(depth, tilt, 5, 20), tilt))
    for value, stated in (("offset_mm", "offset_scatter"), ("pivot_mm", "pivot_scatter")):
        scatter = np.std([getattr(fit, value) for fit in fits])
        mean = np.mean([getattr(fit, stated) for fit in fits])
        assert 0.7 < scatter / mean < 1.4


def test_a_wrong_exponent_moves_the_offset_by_its_stated_error():
    depth, tilt, _ = presses()
    fit = fit_pivot(depth ** (EXPONENT + 0.05), label(depth, tilt, 5, 20), tilt)
    assert abs(fit.offset_mm - 5) == pytest.approx(fit.offset_std, rel=0.2)


def test_presses_that_move_no_pin_are_left_out_and_counted():
    depth, tilt, _ = presses()
    spread = depth**EXPONENT
    spread[:100] = 1e-3
    fit = fit_pivot(spread, label(depth, tilt, 5, 20), tilt)
    assert (fit.presses, fit.left_out) == (500, 100)
    assert fit.offset_mm == pytest.approx(5, abs=1e-3)


GOOD = RecordingFit(
    Pivot(5, 20, 0.4, 0.1, 1, 0.1, 0.01, 0.5, 0.03, 1500, 0),
    {"depth": "pose_2", "tilt": "pose_6"},
    (),
    331,
    lean_deg=90.0,
    following=0.95,
    untouched_mm=0.0,
)


@pytest.mark.parametrize(
    ("fit", "told"),
    [
        (replace(GOOD, pivot=replace(GOOD.pivot, left_out=400)), "400 of 1,900 presses do not"),
        (replace(GOOD, untouched_mm=2.0), "2.0 mm deep"),
        (replace(GOOD, pivot=replace(GOOD.pivot, residual=0.4)), "misfit 40%"),
        (replace(GOOD, following=0.1), "correlation 0.10"),
    ],
)
def test_pins_contradict_labels_in_words(fit, told):
    assert GOOD.contradiction() == ""
    assert told in fit.contradiction()


def test_pins_spread_about_where_they_flee_from():
    rng = np.random.default_rng(0)
    rest = rng.uniform(-50, 50, (80, 2))
    tilt = rng.uniform(-20, 20, 40)
    contact = np.stack([0 * tilt, 100 * np.sin(np.radians(tilt))], axis=1)
    away = rest - contact[:, None]
    moved = 0.1 * away * np.exp(-(away**2).sum(axis=2, keepdims=True) / 800) + [2.0, -1.0]
    middle = middle_of_spread(moved, rest)
    towards, following = direction_of(middle, tilt)
    assert towards == pytest.approx(90, abs=5)
    assert following > 0.9
    assert direction_of(middle, -tilt)[0] == pytest.approx(-90, abs=5)
    assert direction_of(middle, rng.permutation(tilt))[1] < 0.5
    assert not middle_of_spread(np.zeros((1, 80, 2)), rest).any()


def test_outliers_hardly_matter():
    depth, tilt, rng = presses()
    spread = depth**EXPONENT
    spread[rng.permutation(len(spread))[:30]] *= 2
    fit = fit_pivot(spread, label(depth, tilt, 5, 20), tilt)
    assert fit.offset_mm == pytest.approx(5, abs=0.05)
    assert fit.pivot_mm == pytest.approx(20, abs=0.5)


def test_what_cannot_be_fitted_is_refused():
    depth, tilt, _ = presses()
    with pytest.raises(UserError, match="the tilt label is the same"):
        fit_pivot(depth**EXPONENT, depth, np.zeros(len(depth)))
    with pytest.raises(UserError, match="the depth label is the same"):
        fit_pivot(depth**EXPONENT, np.ones(len(depth)), tilt)
    with pytest.raises(UserError, match="20 presses move the pins; at least 50"):
        fit_pivot(depth[:20] ** EXPONENT, depth[:20], tilt[:20])


def test_an_even_shift_of_all_pins_is_no_spread():
    moved = np.random.default_rng(0).normal(size=(3, 50, 2))
    np.testing.assert_allclose(spread_of(moved + np.array([3.0, -7.0])), spread_of(moved))
    square = np.array([[[1, 0], [-1, 0], [0, 1], [0, -1]]], dtype=float)
    np.testing.assert_allclose(spread_of(2 * square), [2.0])


@pytest.mark.long
@pytest.mark.parametrize(("name", "pivot"), [("331", 20.0), ("127", 0.0)])
def test_public_recordings(name, pivot, monkeypatch):
    monkeypatch.setattr(pivot_module, "MOST", 100)
    recording = open_recording(tac_vgnn_folder(name))
    assert presses_to_fit(recording) == 100
    fit = fit_recording(recording, ImportOptions())
    assert fit.pivot.offset_mm == pytest.approx(5.0, abs=0.2)
    assert fit.pivot.pivot_mm == pytest.approx(pivot, abs=3)
    assert (fit.shear, fit.pins) == (("move_1", "move_6"), int(name))
    assert fit.contradiction() == ""
    assert fit.lean_deg == pytest.approx(90, abs=5)
    assert fit.options()["depth"] == "pose_2"


def test_a_recording_without_a_rest_frame_cannot_be_fitted(second):
    with pytest.raises(UserError, match=r"no frame of the undeformed sensor.*init_0\.png"):
        fit_recording(open_recording(second), ImportOptions())
