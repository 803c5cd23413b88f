"""The U-Net sees the sensor at rest beside the frame, where every frame brings it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from drawn_presses import presses
from silent import Epochs

from tactibench import Frame, Pose

FLAT = np.full((64, 64), 20, np.uint8)


def with_rest(frames, rest=FLAT):
    return [replace(frame, rest=rest) for frame in frames]


def trained(make_model, frames, truth, **options):
    model = make_model(size=64, epochs=1, **options)
    rng = np.random.default_rng(0)
    model.fit(frames, truth, validation=([], []), rng=rng, progress=Epochs())
    return model


@pytest.mark.parametrize(
    ("options", "seen"),
    [
        ({}, 2),
        ({"rest": "never"}, 1),
        ({"recipe": "paper"}, 1),
        ({"recipe": "paper", "rest": "auto"}, 2),
    ],
)
def test_rest_is_shown_where_the_recipe_says_so(make_model, options, seen) -> None:
    frames, truth = presses(3, 1)
    model = make_model(size=64, **options)
    model.prepare(with_rest(frames), truth)
    assert model.inputs(frames).shape == (3, seen, 64, 64)
    model.prepare([*with_rest(frames[:2]), frames[2]], truth)  # one frame without
    assert model.inputs(frames).shape == (3, 1, 64, 64)


def test_each_frame_brings_its_own_rest_and_else_the_first_is_taken(make_model):
    frames, truth = presses(2, 1)
    model = make_model(size=64)
    model.prepare(with_rest(frames), truth)
    colour = np.repeat(np.full((32, 32, 1), 90, np.uint8), 3, axis=2)
    seen = model.inputs([*with_rest(frames[:1], colour), Frame(frames[1].image, 0.0, Pose())])
    assert torch.all(seen[0, 1] == 90)
    assert torch.all(seen[1, 1] == 20)
    np.testing.assert_array_equal(seen[1, 0].numpy(), frames[1].image)
