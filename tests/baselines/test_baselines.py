"""The trivial models: right, exact after saving, and fast enough to stand on every board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tactibench import Contacts, Frame, Grid, ModelContext, PlatePose, Pose, UserError, gray_frames
from tactibench.run import NullProgress
from tactibench_baselines import MeanModel, NearestModel


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture
def context() -> Callable[[str], ModelContext]:
    return lambda answer: ModelContext(answer, Grid.centred(64, 0.4), 6.0)


@pytest.fixture
def fitted(context: Any) -> Callable[..., Any]:
    def fit(kind: Any, frames: Any, truth: Any, answer: str = "contacts", **parameters: Any) -> Any:
        model = kind(context(answer), **parameters)
        report = model.fit(
            frames,
            truth,
            validation=([], []),
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )
        assert report.notes == {"frames": len(frames)}
        return model

    return fit


BOTH = pytest.mark.parametrize("kind", [MeanModel, NearestModel])
ANSWERS = pytest.mark.parametrize("answer", ["contacts", "plate"])


def random_frames(rng, count, side=40):
    """Frames of one sensor: they share a rest frame."""
    rest = rng.integers(0, 256, (side, side), dtype=np.uint8)
    images = rng.integers(0, 256, (count, side, side), dtype=np.uint8)
    return [Frame(image, float(i), Pose(), rest) for i, image in enumerate(images)]


def random_contacts(rng, counts):
    return [Contacts.truth(rng.uniform(-6, 6, (n, 2)), rng.uniform(0.5, 6, n)) for n in counts]


def random_plates(rng, count):
    return [PlatePose(*map(float, rng.uniform((1, -20), (5, 20)))) for _ in range(count)]


def random_truth(rng, answer, count):
    if answer == "plate":
        return random_plates(rng, count)
    return random_contacts(rng, rng.integers(0, 4, count))


def same(a, b):
    """Equal to the last bit."""
    if isinstance(a, PlatePose):
        return a == b
    return all(np.array_equal(getattr(a, f), getattr(b, f)) for f in ("xy", "depth", "score"))


def test_mean_weighs_contacts_alike_not_frames(fitted, rng):
    truth = [Contacts.truth([[3.0, 0.0]], [1.0]), Contacts.truth([[0, 3], [0, 0]], [4.0, 4.0])]
    model = fitted(MeanModel, random_frames(rng, 2), truth)
    (got,) = model.predict(random_frames(rng, 1))
    np.testing.assert_allclose(got.xy, [[1.0, 1.0]])
    np.testing.assert_allclose(got.depth, [3.0])


@ANSWERS
def test_nearest_recalls_its_training_frames(rng, fitted, answer):
    frames, truth = random_frames(rng, 30), random_truth(rng, answer, 30)
    got = fitted(NearestModel, frames, truth, answer=answer).predict(frames)
    assert all(map(same, got, truth))


@pytest.mark.parametrize("rest", [True, False])
def test_nearest_agrees_with_a_plain_search(rng, fitted, rest):
    train, test = random_frames(rng, 300), random_frames(rng, 70)
    if not rest:
        train = [replace(frame, rest=None) for frame in train]
    truth = random_contacts(rng, [1] * 300)
    model = fitted(NearestModel, train, truth, size=8)

    def features(frames):
        levels = gray_frames(frames, 8).astype(float)
        if rest:
            levels -= gray_frames([replace(f, signal=f.rest) for f in frames], 8)
        return levels.reshape(len(frames), -1)

    a, b = features(test), features(train)
    nearest = [int(((row - b) ** 2).sum(axis=1).argmin()) for row in a]
    assert all(map(same, model.predict(test), [truth[i] for i in nearest]))


def test_rest_subtraction_ignores_a_background(rng, fitted):
    """The same press seen by a sensor with another fixed background is recognised."""
    press = rng.integers(0, 100, (20, 32, 32), dtype=np.uint8)
    backs = [np.zeros((32, 32), np.uint8), rng.integers(0, 150, (32, 32), dtype=np.uint8)]
    train, test = ([Frame(p + back, 0.0, Pose(), back) for p in press] for back in backs)
    truth = random_contacts(rng, [1] * 20)
    assert all(map(same, fitted(NearestModel, train, truth).predict(test), truth))


def test_equally_near_frames_answer_the_first(rng, fitted):
    (frame,) = random_frames(rng, 1)
    truth = random_contacts(rng, [1] * 6)
    (got,) = fitted(NearestModel, [frame] * 6, truth).predict([frame])
    assert same(got, truth[0])


@BOTH
def test_pickled_weights_are_never_read(rng, fitted, context, tmp_path, kind):
    fitted(kind, random_frames(rng, 3), random_contacts(rng, [1] * 3)).save(tmp_path)
    (path,) = tmp_path.iterdir()
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["depth"] = np.array([{"a": 1}], dtype=object)
    np.savez(path, **arrays)
    with pytest.raises(UserError, match="damaged"):
        kind(context("contacts")).load(tmp_path)
