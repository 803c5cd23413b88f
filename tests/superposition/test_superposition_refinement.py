"""Refinement of another model's contacts, on a drawn sensor whose fields add up exactly."""

from __future__ import annotations

import numpy as np
import pytest

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench.plugins import PluginHost
from tactibench.run import NullProgress
from tactibench.superposition import DEPTHS, REACH_MM, Refinement


@pytest.fixture(scope="module")
def refinement(singles):
    """Learned from 60 drawn presses, its noise from 20 others."""
    frames, truth = singles
    return Refinement.learn(frames[:60], truth[:60], (frames[60:], truth[60:]))


@pytest.fixture(scope="module")
def presses(press, random_contacts):
    """Ten drawn presses of one tip: frames and (10, 3) contacts, mm."""
    contacts = random_contacts(10, np.random.default_rng(3)) * (0.8, 0.8, 0.9) + (0, 0, 0.4)
    return [press(one[None])[0] for one in contacts], contacts


def answer(*contacts):
    rows = np.array(contacts, dtype=float)
    return Contacts(rows[:, :2], rows[:, 2], np.linspace(0.9, 0.5, len(rows)))


def error(answers, contacts):
    """(N,) distances in x, y and depth of single answers, mm."""
    found = np.array([[*each.xy[0], each.depth[0]] for each in answers])
    return np.linalg.norm(found - contacts, axis=1)


def test_a_contact_goes_where_the_pins_put_it(refinement, presses):
    frames, contacts = presses
    rough = [answer(one + np.array([0.4, -0.3, 0.3])) for one in contacts]
    refined = refinement(frames, rough)
    assert [len(each) for each in refined] == [1] * len(frames)
    assert error(rough, contacts).min() > 0.5
    assert np.median(error(refined, contacts)) < 0.05
    assert [each.score[0] for each in refined] == [0.9] * len(frames)


def test_a_contact_that_no_field_explains_is_dropped(refinement, presses):
    frames, contacts = presses
    elsewhere = [np.array([*-np.sign(one[:2]) * 5.0, 1.0]) for one in contacts]
    refined = refinement(frames, [answer(*both) for both in zip(contacts, elsewhere, strict=True)])
    assert [len(each) for each in refined] == [1] * len(frames)
    assert error(refined, contacts).max() < 0.5


def test_nothing_is_found_where_nothing_is_answered_or_pressed(refinement, presses):
    frames, contacts = presses
    assert [len(each) for each in refinement(frames, [Contacts.none()] * len(frames))] == [0] * 10
    rest = Frame(frames[0].rest_image, 0.0, Pose(), frames[0].rest_image)
    assert len(refinement([rest], [answer(contacts[0])])[0]) == 0


@pytest.mark.parametrize("seed", range(4))
def test_never_more_contacts_and_none_beyond_its_reach(refinement, presses, seed):
    frames, contacts = presses
    rng = np.random.default_rng(seed)
    given = [
        answer(*(one + rng.normal(0, (1.0, 1.0, 0.5), (1 + k % 3, 3))).clip((-7, -7, 0.2), 7))
        for k, one in enumerate(contacts)
    ]
    for before, after in zip(given, refinement(frames, given), strict=True):
        assert len(after) <= len(before)
        for xy, depth, score in zip(after.xy, after.depth, after.score, strict=True):
            of = int(np.flatnonzero(before.score == score)[0])
            assert np.hypot(*(xy - before.xy[of])) <= REACH_MM
            assert DEPTHS[0] <= depth / before.depth[of] <= DEPTHS[1]


def test_more_contacts_than_any_fit_resolves_are_cut_to_the_surest(refinement, presses):
    frames, contacts = presses
    crowd = answer(*(contacts[0] + (0.3 * k, 0, 0) for k in range(8)))
    assert len(refinement(frames[:1], [crowd])[0]) <= 6


@pytest.mark.parametrize(
    "labels", [PlatePose(1.0, 0.0, 0.0), Contacts.truth([[1.0, 2.0]])], ids=["plate", "no depth"]
)
def test_what_it_cannot_learn_from_is_said(singles, labels):
    frames, truth = singles
    others = [labels] * len(frames)
    with pytest.raises(UserError, match="needs contacts whose depth is known"):
        Refinement.learn(frames, others, (frames, others))
    with pytest.raises(UserError, match="at least 20"):
        Refinement.learn(frames[:10], truth[:10], (frames, truth))


def kernel(**parameters):
    context = ModelContext("contacts", Grid.centred(64, 0.4), 6.0)
    return PluginHost().models["kernel"].build(context, **parameters)


def fitted(model, frames, truth, count=60):
    report = model.fit(
        frames[:count],
        truth[:count],
        validation=(frames[60:], truth[60:]),
        rng=np.random.default_rng(0),
        progress=NullProgress(),
    )
    return model, report


def test_a_refined_model_is_the_model_and_the_fit(singles, presses, tmp_path):
    alone, _ = fitted(kernel(), *singles)
    model, _ = fitted(kernel(refine="fields"), *singles)
    assert [name for name, _ in model.stages()] == ["preprocess", "forward", "decode", "refine"]
    # Sixty presses are few: what the model has within the reach is refined, the rest is dropped.
    near = error(alone.predict(presses[0]), presses[1]) < 1.0
    assert near.sum() >= 4
    frames = [frame for frame, one in zip(presses[0], near, strict=True) if one]
    contacts = presses[1][near]
    refined = model.predict(frames)
    assert error(refined, contacts).max() < 0.1
    assert np.median(error(alone.predict(frames), contacts)) > 0.2
    model.save(tmp_path)
    again = kernel(refine="fields")
    again.load(tmp_path)
    assert np.array_equal(error(again.predict(frames), contacts), error(refined, contacts))
    assert model.parameter_count() > alone.parameter_count()
    # Labelled presses of this very sensor change nothing where fields do not vary.
    model.adapt(frames, [Contacts.truth([one[:2]], [one[2]]) for one in contacts])
    model.adapt([], [])
    assert np.array_equal(error(model.predict(frames), contacts), error(refined, contacts))


def test_without_fields_the_model_answers_alone(singles, presses, tmp_path):
    model, report = fitted(kernel(refine="fields"), *singles, count=15)
    assert "at least 20" in report.notes["not_refined"]
    model.save(tmp_path)
    again = kernel(refine="fields")
    again.load(tmp_path)
    shown = presses[0]
    assert [name for name, _ in again.stages()][-1] == "decode"
    assert np.array_equal(again.predict(shown)[0].xy, model.predict(shown)[0].xy)
