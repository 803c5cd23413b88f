"""Models that read another sensor: its layout, its labelled frames, and what they must not need."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_pins import SIZE, draw, hexagon

from tactibench import Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench.markers import common_lattice
from tactibench.run import NullProgress
from tactibench_pins import LENGTHS, RIDGES, SHARE, Correction, Differences, Kernel, Pins

pytestmark = pytest.mark.long

TRAINED, OTHER = hexagon(3, 8.0), hexagon(4, 6.0)
"""37 and 61 pins, one outline."""
both = pytest.mark.parametrize("kind", [Kernel, Pins])


def presses(rest, count, seed, offset=0.0):
    """Pins flee from where a plate touches; ``offset``: added to the labels' depth."""
    rng = np.random.default_rng(seed)
    frames, truth = [], []
    still = draw(rest)
    for _ in range(count):
        x, depth = rng.uniform(-6, 6), rng.uniform(2, 5)
        away = rest - [2.5 * x + (SIZE - 1) / 2, (SIZE - 1) / 2]
        square = (away**2).sum(axis=1, keepdims=True)
        moved = 0.12 * depth * away * np.exp(-square / (2 * 9.0**2))
        frames.append(Frame(draw(rest + moved), 0.0, Pose(), still))
        truth.append(PlatePose(depth + offset, 3 * x))
    return frames, truth


def made(kind, transfers=True):
    context = ModelContext("plate", Grid.centred(64, 0.4), 6.0, transfers=transfers)
    return kind(context) if kind is Kernel else kind(context, members=2, width=32, epochs=60)


@pytest.fixture(scope="module")
def taught():
    found = {}
    for kind in (Kernel, Pins):
        model = made(kind)
        model.fit(
            *presses(TRAINED, 240, 1),
            validation=presses(TRAINED, 40, 2),
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )
        found[kind] = model
    return found


def errors(model, frames, truth):
    found = model.predict(frames)
    return np.abs(
        [[p.depth - t.depth, p.tilt - t.tilt] for p, t in zip(found, truth, strict=True)]
    ).mean(axis=0)


@both
def test_another_layout_is_read_without_a_label(taught, kind):
    frames, truth = presses(OTHER, 40, 5)
    mean = np.abs(np.array([[t.depth - 3.5, t.tilt] for t in truth])).mean(axis=0)
    assert (errors(taught[kind], frames, truth) < 0.6 * mean).all()


@both
def test_labelled_frames_correct_and_none_take_the_correction_back(taught, kind):
    model = taught[kind]
    frames, truth = presses(OTHER, 60, 5, offset=1.5)
    before = [answer.depth for answer in model.predict(frames)]
    notes = model.adapt(*presses(OTHER, 30, 6, offset=1.5))
    assert notes["frames"] == 30
    assert set(notes["ridge"]) <= set(RIDGES)
    after = errors(model, frames, truth)[0]
    assert after < 0.5 * np.abs(np.array(before) - [t.depth for t in truth]).mean()
    assert model.adapt([], []) == {"frames": 0}
    assert [answer.depth for answer in model.predict(frames)] == before


@both
def test_what_is_timed_is_corrected_as_what_is_scored(taught, kind):
    model, frames = taught[kind], presses(OTHER, 5, 7)[0]
    model.adapt(*presses(OTHER, 12, 6, offset=1.5))
    value = frames
    for _, stage in model.stages():
        value = stage(value)
    assert value == model.predict(frames)
    model.adapt([], [])


@both
def test_weights_of_the_lattice_are_none_of_one_sensors_pins(taught, kind, tmp_path):
    taught[kind].save(tmp_path)
    with pytest.raises(UserError, match="trained with transfers=True, but transfers=False"):
        made(kind, transfers=False).load(tmp_path)


def test_leaving_one_out_in_closed_form_is_leaving_one_out():
    """The chosen ridge is the largest about as good as the best, when each frame is left out."""
    rng = np.random.default_rng(0)
    features = rng.normal(size=(14, 5))
    lacking = (features @ rng.normal(size=5) + 0.3 * rng.normal(size=14))[:, None]
    found = Correction.fit(features, lacking)
    gram = 1.0 + found.features @ found.features.T

    def left_out(ridge):
        errors = []
        for k in range(14):
            others = np.delete(np.arange(14), k)
            inner = gram[np.ix_(others, others)] + ridge * np.eye(13)
            guess = gram[k, others] @ np.linalg.solve(inner, lacking[others, 0])
            errors.append(abs(lacking[k, 0] - guess))
        return np.mean(errors), np.std(errors) / np.sqrt(14)

    by_hand = {ridge: left_out(ridge) for ridge in RIDGES}
    least, scatter = min(by_hand.values())
    assert found.ridges == (max(r for r in RIDGES if by_hand[r][0] <= least + scatter),)
    alpha = np.linalg.solve(gram + found.ridges[0] * np.eye(14), lacking)
    np.testing.assert_allclose(found.alpha, alpha)
    np.testing.assert_allclose(found(features), gram @ alpha)


def test_differences_are_smooth_and_grow_with_the_field():
    points, rng = common_lattice(), np.random.default_rng(0)
    fields = rng.normal(size=(3, 2 * len(points)))
    fields[0] = 0.0
    fields[2] = 3 * fields[1]
    many = np.repeat(fields, 4000, axis=0)
    added = (Differences.on(points).add(many, rng) - many).reshape(3, 4000, -1)
    assert not added[0].any()  # a sensor at rest looks like any other
    rms = np.sqrt(np.square(fields).mean(axis=1))
    share = np.sqrt(np.square(added).mean(axis=(1, 2)))[1:] / rms[1:]
    np.testing.assert_allclose(share, SHARE * np.sqrt(len(LENGTHS)), rtol=0.03)
    near = int(np.argsort(np.hypot(*points.T), kind="stable")[1])  # beside the middle point
    alike = np.corrcoef(added[1][:, [0, near, len(points)]].T)
    assert alike[0, 1] > 0.7
    assert abs(alike[0, 2]) < 0.1  # x and y of one place


def test_differences_in_components_are_those_of_fields():
    points, rng = common_lattice(), np.random.default_rng(0)
    differences = Differences.on(points)
    basis = np.linalg.qr(rng.normal(size=(2 * len(points), 5)))[0]
    factor = differences.of_components(basis)
    whole = np.kron(np.eye(2), differences.factor @ differences.factor.T)
    np.testing.assert_allclose(factor @ factor.T, basis.T @ whole @ basis, atol=1e-9)
