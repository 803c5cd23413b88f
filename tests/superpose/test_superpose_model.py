"""The superposition fit on the simulated sensor, and how far off its answers are stated to be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tactibench import Frame, PlatePose, Pose, UserError
from tactibench.frames.faults import move
from tactibench.superposition import ErrorCauses, Spread, nominal_spread


def matched(found, truth):
    """(M, 3) errors and (M, 3) deviations of frames with as many contacts as there are."""
    error, std = [], []
    for one, true in zip(found, truth, strict=True):
        assert len(one) == len(true)
        apart = np.linalg.norm(one.xy[:, None] - true.xy[None], axis=-1)
        i, j = linear_sum_assignment(apart)
        error.append(np.column_stack([one.xy[i] - true.xy[j], one.depth[i] - true.depth[j]]))
        std.append(one.std[i])
    return np.concatenate(error), np.concatenate(std)


@pytest.fixture(scope="session")
def singles_found(fitted, presses):
    return fitted[0].predict(presses["test"][0])


@pytest.fixture(scope="session")
def duals_found(fitted, presses):
    return fitted[0].predict(presses["dual"][0])


def test_single_presses_are_found(singles_found, presses):
    error, _ = matched(singles_found, presses["test"][1])
    assert np.abs(error).mean() < 0.04
    assert np.median(np.abs(error)) < 0.02


def test_single_presses_are_as_far_off_as_their_std_says(singles_found, presses):
    error, std = matched(singles_found, presses["test"][1])
    assert (std > 0).all()
    ratio = error / std
    assert 0.85 <= (np.abs(ratio) < 1.96).mean() <= 1.0
    assert 0.5 < np.sqrt(np.median(ratio**2) / 0.455) < 1.6
    # Shallow presses are known less well.
    depth = np.array([one.depth[0] for one in presses["test"][1]])
    assert std[depth < 1.5, :2].mean() > std[depth > 4, :2].mean()


def test_two_far_apart_are_found_as_two(duals_found, presses):
    frames = [k for k, one in enumerate(duals_found) if len(one) == 2]
    assert len(frames) >= 0.97 * len(duals_found)
    error, std = matched(*([rows[k] for k in frames] for rows in (duals_found, presses["dual"][1])))
    assert np.abs(error).mean() < 0.06
    assert np.abs(error).max() < 0.5
    assert (np.abs(error) < 1.96 * std).mean() > 0.9
    assert np.sqrt(((error / std) ** 2).mean()) < 1.2


@pytest.mark.parametrize("turn", [0.0, 0.9, 2.2, 3.7, 5.1])
def test_a_camera_that_moved_half_a_spacing_shows_no_contact(fitted, presses, turn):
    frame = presses["rest"][0][0]
    moved = move(frame.image, 4.2 * np.cos(turn), 4.2 * np.sin(turn))
    assert [
        len(answer) for answer in fitted[0].predict([Frame(moved, 0.0, Pose(), frame.rest_image)])
    ] == [0]


def test_pins_that_crowd_are_followed_again(fitted, presses):
    """Between two deep tips blobs merge; the contacts say where each pin is to be looked for."""
    model = fitted[0]
    frames, truth = presses["crowded"]
    detector = model._detector(0)
    images = detector.pins.pins.images(frames)
    moved, sure = detector.pins.track(images)
    rows = np.flatnonzero(~sure.all(axis=1))
    assert len(rows) >= 4
    before, after = [], []
    for row in rows:
        found = detector.find(images[row], moved[row], sure[row]).solution
        explained = detector.field(found.contacts[0]).sum(axis=0)
        before.append(np.hypot(*(moved[row] - explained).reshape(2, -1)).max())
        after.append(np.hypot(*found.left[0].reshape(2, -1)).max())
    # A pin taken for its neighbour is most of a spacing off; a misfit of the fields is not.
    assert np.median(before) > 0.5 * detector.pins.pitch
    assert max(after) < 0.5 * detector.pins.pitch
    found = model.predict([frames[row] for row in rows])
    error, _ = matched(found, [truth[row] for row in rows])
    assert np.abs(error).mean() < 0.1
    assert np.abs(error).max() < 0.5  # as of pairs whose pins do not crowd


def test_without_the_neighbours_law_two_tips_are_farther_off(make, fit, presses, duals_found):
    model = make(neighbours="none")
    fit(model)
    errors = []
    for found in (model.predict(presses["dual"][0]), duals_found):
        rows = [k for k, one in enumerate(found) if len(one) == 2]
        error, _ = matched([found[k] for k in rows], [presses["dual"][1][k] for k in rows])
        errors.append(np.abs(error).mean())
    assert errors[1] < 0.4 * errors[0]


def test_the_law_is_learned_where_there_are_presses_with_several(
    fitted, fitted_to_duals, presses, duals_found
):
    found = fitted_to_duals[0].predict(presses["dual"][0])
    rows = [k for k in range(len(found)) if len(found[k]) == len(duals_found[k]) == 2]
    assert len(rows) > 0.95 * len(found)
    true = [presses["dual"][1][k] for k in rows]
    shipped, _ = matched([duals_found[k] for k in rows], true)
    learned, std = matched([found[k] for k in rows], true)
    assert np.abs(learned).mean() < 1.1 * np.abs(shipped).mean()
    # What it learned is taken for better known than the law of a nominal dome.
    assert std.mean() < np.mean([one.std.mean() for one in duals_found])
    assert (np.abs(learned) < 1.96 * std).mean() > 0.8


def test_bad_training_frames_are_refused(make, fit, presses):
    frames, truth = presses["fit"]
    with pytest.raises(UserError, match="19 presses"):
        fit(make(), frames[:19], truth[:19])
    with pytest.raises(UserError, match="rest image"):
        fit(make(), [Frame(frame.image, 0.0, Pose()) for frame in frames[:30]], truth[:30])
    with pytest.raises(UserError, match="plate"):
        fit(make(), frames[:30], [PlatePose(1.0, 2.0)] * 30)


def normal_of(std):
    return np.diag(1 / np.asarray(std, dtype=float).ravel() ** 2)


def with_terms(*rows):
    return Spread(np.array([rows] * 3, dtype=float))


def test_the_variance_is_the_sum_that_the_docstring_states():
    spread = with_terms([0.01, 2.0, 0.1, 1e-3], [0.02, 1.0, 0.2, 2e-3])
    fit = np.array([[0.01, 0.01, 0.5], [0.03, 0.03, 0.5]])
    shift = np.array([[0.3, 0.4, 0.0], [0.0, 0.0, 0.1]])
    std = spread.std(ErrorCauses.of(normal_of(fit), 7.0, shift))
    way, noise = np.array([0.5, 0.1]), fit[:, 0]
    plane = np.sqrt(0.01**2 + (2 * noise) ** 2 + (0.1 * way) ** 2 + 7e-3**2)
    depth = np.sqrt(0.02**2 + noise**2 + (0.2 * way) ** 2 + 14e-3**2)
    np.testing.assert_allclose(std, np.stack([plane, plane, depth], axis=1), rtol=1e-3)


def test_misfit_counts_as_correlated_where_sensors_vary():
    shift, normal = np.zeros((1, 3)), normal_of([0.01] * 3)
    plain, varied = (ErrorCauses.of(normal, 4.0, shift, varies) for varies in (False, True))
    np.testing.assert_allclose(varied.noise / plain.noise, np.sqrt(20 - 19 / 4))
    fitting = [ErrorCauses.of(normal, 0.8, shift, varies).noise for varies in (False, True)]
    np.testing.assert_array_equal(*fitting)


@pytest.mark.parametrize("normal", [np.zeros((6, 6)), np.ones((6, 6)), normal_of([[1e-9] * 3] * 2)])
def test_contacts_that_cannot_be_told_apart_are_no_error(normal):
    std = nominal_spread().std(ErrorCauses.of(normal, 1.0, np.zeros((2, 3))))
    assert std.shape == (2, 3)
    assert np.isfinite(std).all()
    assert (std >= 1e-4).all()
    assert (std <= 3.0).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_terms_that_made_the_errors_are_found_again(count):
    rng = np.random.default_rng(count)
    truth = with_terms([0.02, 3.0, 0.2 * (count > 1), 0.0], [0.01, 2.0, 0.1 * (count > 1), 0.0])
    clues, errors = [], []
    for _ in range(3000 // count):
        fit = np.repeat(rng.uniform(0.002, 0.03, (count, 1)), 3, axis=1)
        clue = ErrorCauses.of(normal_of(fit), 0.5, rng.uniform(0, 0.4, (count, 3)) * (count > 1))
        clues.append(clue)
        errors.append(truth.std(clue) * rng.standard_normal((count, 3)))
    fitted = nominal_spread().with_group(count, clues, errors)
    wanted = np.concatenate([truth.std(clue) for clue in clues])
    found = np.concatenate([fitted.std(clue) for clue in clues])
    np.testing.assert_allclose(found, wanted, rtol=0.2)
    z = np.concatenate(errors) / found
    assert 0.94 < np.mean(np.hypot(z[:, 0], z[:, 1]) < 2.447747) < 0.96
    assert 0.94 < np.mean(np.abs(z[:, 2]) < 1.959964) < 0.96
