"""The VGNN: what it learns, and what its network must not depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactibench import Contacts
from tactibench.markers import pin_graph
from tactibench.training import torch_seed
from tactibench_vgnn import NO_PIN, NODE, GraphNetwork, neighbour_table


def flat(answers):
    return np.array(
        [[*contacts.xy[0], contacts.depth[0], *contacts.std[0]] for contacts in answers]
    )


@pytest.fixture(scope="module")
def taught(make_vgnn, fit):
    model = make_vgnn(epochs=24)
    return model, *fit(model, count=200)


@pytest.mark.long
def test_it_learns_where_and_how_deep_and_how_sure_it_is(taught, make_presses):
    model, report, progress = taught
    assert report.history[-1]["loss"] < report.history[0]["loss"] - 3
    assert progress.epochs[-1][2] < 0.4
    frames, truth = make_presses(60, 8)
    found = model.predict(frames)
    assert all(len(contacts) >= 1 for contacts in found)
    true = np.array([[*contacts.xy[0], contacts.depth[0]] for contacts in truth])
    got = flat(found)
    error = got[:, :3] - true
    assert (np.median(np.abs(error), axis=0) < [0.3, 0.3, 1.0]).all()
    z = np.median(np.abs(error / got[:, 3:]), axis=0)
    assert ((z > 0.05) & (z < 2)).all()


@pytest.mark.long
def test_the_sensor_at_rest_has_no_contact(taught, rest_frame):
    assert len(taught[0].predict([rest_frame])[0]) == 0


def test_frames_without_a_rest_image_take_the_least_pressed(make_vgnn, make_presses, rest_frame):
    frames, truth = make_presses(32, 5)
    frames = [replace(frame, rest=None) for frame in [*frames, rest_frame]]
    model = make_vgnn()
    model.prepare(frames, [*truth, Contacts.none()])
    assert model.inputs([frames[-1]])[..., :4].abs().max() < 1e-6


def network(rest, table, layers=3):
    with torch_seed(5):
        made = GraphNetwork(torch.from_numpy(rest), 8.0, table, 16, layers)
        for weight in made.parameters():  # the head starts at zero
            torch.nn.init.normal_(weight, std=0.2)
    return made.eval()


def examples(pins, count=3):
    return torch.from_numpy(
        np.random.default_rng(0).normal(size=(count, pins, NODE)).astype(np.float32)
    )


def table_of(rest):
    return torch.from_numpy(neighbour_table(pin_graph(rest).edges, rest))


@torch.inference_mode()
def test_the_order_of_pins_does_not_matter(rest_pins):
    order = np.random.default_rng(1).permutation(len(rest_pins))
    x = examples(len(rest_pins))
    one = network(rest_pins, table_of(rest_pins))(x)
    other = network(rest_pins[order], table_of(rest_pins[order]))(x[:, order])
    assert one.shape == (3, 7, 37)
    assert one.std() > 0.01
    torch.testing.assert_close(one[:, :, order], other, rtol=1e-4, atol=1e-4)


@torch.inference_mode()
def test_a_pin_hears_its_neighbours_only_but_for_the_token(rest_pins):
    made, x = network(rest_pins, table_of(rest_pins), layers=1), examples(len(rest_pins), 1)
    for token in made.tokens:
        for weight in token.think[-1].parameters():
            torch.nn.init.zeros_(weight)
    changed = x.clone()
    changed[0, 0] += 1
    heard = (made(x) != made(changed)).any(dim=1)[0].numpy()
    table = table_of(rest_pins).numpy()
    near = {0} | set(table[0]) | {int(pin) for n in table[0] if n != NO_PIN for pin in table[n]}
    assert set(np.flatnonzero(heard).tolist()) <= near
    assert heard.sum() > 4


@torch.inference_mode()
def test_the_settled_copy_gives_the_same(rest_pins):
    made, x = network(rest_pins, table_of(rest_pins)), examples(len(rest_pins))
    torch.testing.assert_close(made.with_fixed_weights()(x), made(x), rtol=1e-5, atol=1e-5)
    assert all(messages.fixed is None for messages in made.rounds)
