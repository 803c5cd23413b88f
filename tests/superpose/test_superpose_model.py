"""The superposition fit on the simulated sensor."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tactibench import Contacts, Frame, PlatePose, Pose, UserError


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


def same(one, other):
    for a, b in zip(one, other, strict=True):
        for name in ("xy", "depth", "score", "std"):
            x, y = getattr(a, name), getattr(b, name)
            assert (x is None) == (y is None)
            if x is not None:
                np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9)


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
    assert np.abs(error).max() < 0.3


def test_without_the_neighbours_law_two_tips_are_farther_off(make, fit, presses, duals_found):
    model = make(neighbours="none")
    fit(model)
    errors = []
    for found in (model.predict(presses["dual"][0]), duals_found):
        rows = [k for k, one in enumerate(found) if len(one) == 2]
        error, _ = matched([found[k] for k in rows], [presses["dual"][1][k] for k in rows])
        errors.append(np.abs(error).mean())
    assert errors[1] < 0.4 * errors[0]


def test_a_frame_is_found_by_its_picture_alone(fitted, presses, duals_found):
    model, _ = fitted
    blind = [Frame(frame.image, 0.0, Pose()) for frame in presses["dual"][0][:3]]
    colour = [Frame(np.repeat(frame.image[..., None], 3, axis=2), 0.0, Pose()) for frame in blind]
    same(model.predict(blind), duals_found[:3])
    same(model.predict(colour), duals_found[:3])


def test_the_report_tells_what_was_seen(fitted, fitted_to_duals):
    nominal, fitted_law = "nominal mechanics", "fitted to multi-contact labels"
    assert fitted[1].notes == {"single_presses": 300, "others": 0}
    assert fitted_to_duals[1].notes == {"single_presses": 300, "others": 160}
    assert (fitted[1].prior, fitted_to_duals[1].prior) == (nominal, fitted_law)
    assert fitted[1].epochs == 1
    assert fitted[1].seconds > 0


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


def test_single_presses_are_read_alike_in_both_regimes(fitted_to_duals, singles_found, presses):
    same(fitted_to_duals[0].predict(presses["test"][0]), singles_found)


def test_learned_laws_are_kept(fitted_to_duals, make, presses, tmp_path):
    fitted_to_duals[0].save(tmp_path)
    model = make()
    model.load(tmp_path)
    frames = presses["dual"][0][:5]
    same(model.predict(frames), fitted_to_duals[0].predict(frames))


def test_no_frame_of_several_contacts_is_seen_without_a_law(make, fit, presses, singles_found):
    """neighbours=none fits single presses alone, whatever else is among the frames."""
    rng = np.random.default_rng(2)
    garbage = [
        Frame(rng.integers(0, 256, (128, 128), dtype=np.uint8), 0.0, Pose()) for _ in range(20)
    ]
    frames = presses["fit"][0][:80] + garbage
    truth = presses["fit"][1][:80] + presses["law"][1][:20]
    one, other = make(neighbours="none"), make(neighbours="none")
    fit(one, frames, truth)
    fit(other, presses["fit"][0][:80], presses["fit"][1][:80])
    same(*(model.predict(presses["test"][0][:8]) for model in (one, other)))


@pytest.mark.parametrize("validation", ["none", "duals"])
def test_without_single_presses_to_validate_it_still_answers(make, fit, presses, validation):
    model = make()
    held = ([], []) if validation == "none" else tuple(part[:3] for part in presses["dual"])
    fit(model, presses["fit"][0][:60], presses["fit"][1][:60], validation=held)
    (found,) = model.predict(presses["test"][0][:1])
    assert len(found) >= 1
    assert (found.std > 0).all()


def test_bad_training_frames_are_refused(make, fit, presses):
    frames, truth = presses["fit"]
    with pytest.raises(UserError, match="19 presses"):
        fit(make(), frames[:19], truth[:19])
    with pytest.raises(UserError, match="0 presses"):
        fit(make(), *presses["dual"])
    with pytest.raises(UserError, match="rest image"):
        fit(make(), [Frame(frame.image, 0.0, Pose()) for frame in frames[:30]], truth[:30])
    with pytest.raises(UserError, match="plate"):
        fit(make(), frames[:30], [PlatePose(1.0, 2.0)] * 30)
    with pytest.raises(UserError, match="frame 1"):
        fit(make(), [Frame(np.full((4,), np.nan), 0.0, Pose(), frames[0].rest)] * 30, truth[:30])


def test_no_more_contacts_than_asked_for(make, fit, presses):
    model = make(max_count=1)
    fit(model, presses["fit"][0][:120], presses["fit"][1][:120])
    assert {len(one) for one in model.predict(presses["dual"][0][:5])} == {1}


def test_answers_are_contacts_within_the_depth_of_the_protocol(duals_found, singles_found):
    for one in duals_found + singles_found:
        assert isinstance(one, Contacts)
        assert ((one.depth >= 0) & (one.depth <= 1.2 * 6.0)).all()
