"""The model that states where contacts are and how sure it is."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Grid, UserError


def flat(answers):
    """x, y, depth of every contact of all frames."""
    rows = [np.column_stack([contacts.xy, contacts.depth]) for contacts in answers]
    return np.concatenate([np.empty((0, 3)), *rows])


@pytest.mark.long
def test_it_learns_where_and_how_deep_and_says_how_sure_it_is(trained, make_presses):
    history = trained.report.history
    assert history[-1]["loss"] < history[0]["loss"] - 3
    frames, truth = make_presses(50, 8)
    found = trained.predict(frames)
    right = [len(contacts) == 1 for contacts in found]
    assert sum(right) >= 20
    pairs = [(f, t) for f, t, one in zip(found, truth, right, strict=True) if one]
    error = flat([f for f, _ in pairs]) - flat([t for _, t in pairs])
    spread = flat(truth).std(axis=0)
    assert (np.abs(error).mean(axis=0) < spread * [0.1, 0.1, 0.6]).all()
    z = error / np.concatenate([f.std for f, _ in pairs])
    assert np.mean((z[:, :2] ** 2).sum(axis=1) < 5.991) >= 0.7


@pytest.mark.long
def test_the_std_are_those_of_the_network_times_the_factors(trained, make_presses):
    frames, _ = make_presses(24, 5)
    factors = trained.report.notes["std_factors"]
    assert np.shape(factors) == (2, 3)
    raw = trained._encoder.decode_batch(trained.evaluate(frames), trained._grid)
    for contacts, plain in zip(trained.predict(frames), raw, strict=True):
        if len(contacts):
            np.testing.assert_allclose(
                contacts.std, plain.std * factors[int(len(plain) > 1)], rtol=1e-3
            )


def test_frames_with_several_contacts_are_learned_from_and_kept_for_the_std(make_mixture, fit):
    report = fit(make_mixture(epochs=1), count=40, most=2)
    assert report.notes["kept_for_std"] == 1


def test_an_encoder_of_another_kind_is_refused(make_mixture):
    class Heat:
        channels = 1

    with pytest.raises(UserError, match="kind mixture"):
        make_mixture(encoder=Heat())


def test_a_grid_that_its_cells_do_not_divide_is_refused(make_mixture):
    with pytest.raises(UserError, match="multiple of 16"):
        make_mixture(grid=Grid.centred(60, 0.4))
