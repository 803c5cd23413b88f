"""Models of pins: what they learn and refuse, their components and weights, several sensors."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from single_presses import single_presses

from tactibench import Contacts, UserError
from tactibench.markers import rest_images
from tactibench.run import NullProgress
from tactibench_pins import (
    Components,
    Features,
    Kernel,
    LatticePins,
    OwnPins,
    Setting,
    choose_setting,
    contact_threshold,
    find_reader,
    kernel,
    kernel_weights,
    read_answers,
    rms_displacement,
)

NAMES = ("kernel", "pins")
FAR = {"kernel": 0.1, "pins": 0.35}
"""Error beside that of the mean answer: networks need more presses than a test can make."""
both = pytest.mark.parametrize("name", NAMES)


def poses(answers):
    return np.array([[pose.depth, pose.tilt] for pose in answers])


@pytest.mark.long
@both
def test_plates_are_read_far_better_than_by_their_mean(taught, make_presses, name):
    frames, truth = make_presses(60, 7)
    answers = poses(taught[name][0].predict(frames))
    error = np.abs(answers - poses(truth)).mean(axis=0)
    alone = np.abs(poses(truth) - poses(truth).mean(axis=0)).mean(axis=0)
    assert (error < FAR[name] * alone).all(), error / alone


@both
def test_a_sensor_at_rest_is_no_contact(make_model, fit, make_presses, name, tmp_path):
    """No training frame is at rest: the faintest press says how far pins go at least."""
    model = make_model(name, answer="contacts", **({"epochs": 20} if name == "pins" else {}))
    fit(model, plate=False, count=60)
    frames, _ = make_presses(20, 8, plate=False)
    rng = np.random.default_rng(1)
    still = [
        replace(frame, signal=frame.rest + rng.integers(0, 3, frame.rest.shape, dtype=np.uint8))
        for frame in frames
    ]
    model.save(tmp_path)
    again = make_model(name, answer="contacts", **({"epochs": 20} if name == "pins" else {}))
    again.load(tmp_path)
    for learned in (model, again):
        assert [len(contacts) for contacts in learned.predict(still)] == [0] * 20
        assert [len(contacts) for contacts in learned.predict(frames)] == [1] * 20


def test_of_too_many_presses_some_are_learned_from(make_model, fit, make_presses, monkeypatch):
    monkeypatch.setattr(sys.modules[Kernel.__module__], "MOST_PRESSES", 100)
    model = make_model("kernel")
    assert fit(model, count=150).notes["left_out"] == 50
    frames, truth = make_presses(60, 7)
    alone = np.abs(poses(truth) - poses(truth).mean(axis=0)).mean()
    assert np.abs(poses(model.predict(frames)) - poses(truth)).mean() < 0.2 * alone


def test_how_far_pins_went_decides():
    values = np.array([[1.0, 2.0, 3.0, far] for far in (0.0, 0.49, 0.5, 2.0)])
    assert [len(contacts) for contacts in read_answers(values, "contacts", 0.5)] == [0, 0, 1, 1]
    assert [pose.tilt for pose in read_answers(values[:, 1:], "plate", 0.0)] == [3.0] * 4
    moved = np.repeat([[1.0], [2.0], [4.0]], 6, axis=1)
    np.testing.assert_allclose(rms_displacement(moved), [1.0, 2.0, 4.0])
    assert 0.5 <= contact_threshold(moved, "contacts") < 0.52
    assert contact_threshold(moved, "plate") == 0.0


@both
def test_several_contacts_and_no_contact(make_model, make_presses, name):
    frames, truth = make_presses(4, 13, plate=False)
    two = Contacts.truth([[0, 0], [3, 0]], [1, 1])

    def learn(answers):
        model, rng = make_model(name, answer="contacts", epochs=1), np.random.default_rng(0)
        return model.fit(frames, answers, validation=([], []), rng=rng, progress=NullProgress())

    with pytest.raises(UserError, match=f"model '{name}' answers one contact, but .* holds 2"):
        learn([*truth[:3], two])
    assert 1 in learn([*truth[:3], Contacts.none()]).notes.values()
    with pytest.raises(UserError, match="raise the training count"):
        learn([Contacts.none()] * 4)


def moved(count=60, pins=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 3)) * [5, 2, 0.5] @ rng.normal(size=(3, 2 * pins)) + 1


def test_components_are_those_of_the_singular_values():
    frames = moved()
    components = Components.fit(frames, 3)
    _, values, rows = np.linalg.svd(frames - frames.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(components.spread, values[:3] / np.sqrt(len(frames)))
    np.testing.assert_allclose(np.abs(rows[:3] @ components.basis), np.eye(3), atol=1e-9)
    assert len(components.first(2)) == 2


@given(st.floats(0, 1))
def test_whitening_is_a_power_of_the_spread(whitening):
    frames = moved()
    components = Components.fit(frames, 3)
    spread = components.of(frames, whitening).std(axis=0)
    relative = (components.spread / components.spread[0]) ** (1 - whitening)
    np.testing.assert_allclose(spread, relative, rtol=1e-6)


def test_least_squares_is_the_closed_form():
    rng = np.random.default_rng(1)
    places, target = rng.normal(size=(20, 2)), rng.normal(size=(20, 1))
    gram = kernel(places, places, 1.3)
    by_hand = np.exp(-((places[:, None] - places) ** 2).sum(axis=-1) / (2 * 1.3**2))
    np.testing.assert_allclose(gram, by_hand)
    alpha = kernel_weights(gram, target, Setting(ridge=0.1, rounds=0))
    np.testing.assert_allclose((gram + 0.1 * np.eye(20)) @ alpha, target)


def test_reweighting_forgives_a_third_of_wrong_targets():
    """When values are 0 and three in ten are 1, the median is 0 and the mean 0.3."""
    x = np.linspace(-1, 1, 200)[:, None]
    wrong = (np.random.default_rng(2).random(200) < 0.3).astype(float)[:, None]
    gram = kernel(x, x, 2.0)
    plain = gram @ kernel_weights(gram, wrong, Setting(ridge=1.0, rounds=0))
    median = gram @ kernel_weights(gram, wrong, Setting(ridge=1.0, rounds=8))
    assert plain.mean() == pytest.approx(wrong.mean(), abs=0.02)
    assert np.abs(median).mean() < 0.1


def test_the_best_setting_is_no_worse_than_the_usual_one():
    frames = moved(120, seed=3)
    components = Components.fit(frames, 3)
    targets = np.sin(components.of(frames, 0.5)[:, :2])
    learned = Features(components, frames[:80], targets[:80])

    def error(setting):
        own, length = learned.places(setting)
        alpha = kernel_weights(kernel(own, own, length), learned.targets, setting)
        places, _ = learned.places(setting, frames[80:])
        return np.abs(kernel(places, own, length) @ alpha - targets[80:]).mean()

    chosen = choose_setting(learned, frames[80:], targets[80:])
    assert error(chosen) <= error(Setting())


kernel_first = pytest.mark.parametrize(
    "name", ["kernel", pytest.param("pins", marks=pytest.mark.long)]
)


def off(model, frames, truth):
    """Mean distance of answers from the truth, mm; a miss counts 3."""
    answers = model.predict(frames)
    return np.mean(
        [
            np.linalg.norm(a.xy[0] - t.xy[0]) if len(a) else 3.0
            for a, t in zip(answers, truth, strict=True)
        ]
    )


@pytest.fixture(scope="module")
def many():
    return single_presses(300, 1, instances=5)


@pytest.mark.long
@kernel_first
def test_an_unseen_instance_is_read_by_its_own_rest_image(make_model, many, name, tmp_path):
    more = {"epochs": 60} if name == "pins" else {}
    model = make_model(name, answer="contacts", **more)
    model.fit(
        *many,
        validation=single_presses(40, 2, instances=5),
        rng=np.random.default_rng(0),
        progress=NullProgress(),
    )
    unseen = single_presses(40, 3, instance=23)
    nominal = single_presses(40, 4)
    assert off(model, *unseen) < 0.8
    assert off(model, *nominal) < 0.8
    model.save(tmp_path)
    again = make_model(name, answer="contacts", **more)
    again.load(tmp_path)
    for frames, _ in (unseen, nominal):
        for one, two in zip(model.predict(frames), again.predict(frames), strict=True):
            assert np.array_equal(one.xy, two.xy)
            assert np.array_equal(one.depth, two.depth)


def test_one_rest_image_keeps_its_own_pins_and_several_are_seen_on_the_lattice(many):
    targets = np.ones((300, 3))
    assert len(rest_images(many[0])) == 5
    assert type(find_reader(many[0], targets, transfers=False)) is LatticePins
    frames, _ = single_presses(5, 1)
    assert len(rest_images(frames)) == 1
    assert type(find_reader(frames, targets, transfers=False)) is OwnPins
