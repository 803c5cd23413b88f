"""Superposition on sensors that it was not trained on, and on frames that the camera changed."""

from dataclasses import replace

import numpy as np
import pytest
from single_presses import single_presses

from tactibench.frames import FAULTS

UNSEEN = 201


def errors(found, truth):
    """(N,) mean absolute error of x, y and depth of single presses, mm; 3 for another number."""
    return np.array(
        [
            np.abs([*(one.xy[0] - true.xy[0]), one.depth[0] - true.depth[0]]).mean()
            if len(one) == 1
            else 3.0
            for one, true in zip(found, truth, strict=True)
        ]
    )


def pressed(count, seed, **parameters):
    """Frames and truth of presses of every depth that a protocol asks for."""
    return single_presses(count, seed, reach=5.0, depths=(0.5, 5.0), **parameters)


@pytest.fixture(scope="module")
def unseen():
    return pressed(40, 1, instance=UNSEEN)


@pytest.fixture(scope="module")
def shown():
    return pressed(12, 2, instance=UNSEEN)


@pytest.fixture(scope="module")
def of_many(make, fit):
    """A model of 480 presses on 16 sensors."""
    model = make()
    report = fit(model, *pressed(480, 3, instances=16))
    assert report.notes["sensors"] > 12
    return model


def changed(frames, name, value):
    return [
        replace(frame, signal=FAULTS[name](frame.image, value, np.random.default_rng(k)))
        for k, frame in enumerate(frames)
    ]


CHANGES = [
    ("shift", 1.0, 1.5),
    ("rotation", 2.0, 1.5),
    ("gain", 0.4, 1.5),
    ("gain", 1.5, 1.5),
    ("blur", 0.8, 1.7),
    ("lost-pins", 0.05, 1.7),
]


@pytest.mark.parametrize(("name", "value", "most"), CHANGES)
def test_a_camera_that_changed_costs_little(fitted, presses, name, value, most):
    frames, truth = presses["test"]
    clean, other = (
        np.median(errors(fitted[0].predict(images), truth))
        for images in (frames, changed(frames, name, value))
    )
    assert other < most * clean + 0.002


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, value, _ in CHANGES])
def test_nothing_touches_a_camera_that_changed(fitted, presses, name, value):
    rest = presses["rest"][0] * 5
    assert [len(one) for one in fitted[0].predict(changed(rest, name, value))] == [0] * 5


@pytest.mark.long  # needs a training on sixteen sensors
def test_an_unseen_sensor_is_read_better_after_many_than_after_one(fitted, of_many, unseen):
    one, many = (
        errors(model.predict(unseen[0]), unseen[1]).mean() for model in (fitted[0], of_many)
    )
    assert many < 0.6 * one
    assert many < 0.12


@pytest.mark.long  # needs a training on sixteen sensors
def test_labelled_presses_of_a_sensor_bring_its_answers_nearer(of_many, unseen, shown):
    before = of_many.predict(unseen[0])
    assert of_many.adapt(*shown) == {"single_presses": 12}
    after = errors(of_many.predict(unseen[0]), unseen[1]).mean()
    assert of_many.adapt([], []) == {"single_presses": 0}
    again = of_many.predict(unseen[0])
    assert after < 0.7 * errors(before, unseen[1]).mean()
    np.testing.assert_array_equal(again[0].xy, before[0].xy)


def test_one_sensor_teaches_nothing_of_others(fitted, shown):
    assert fitted[0].adapt(*shown) is None
