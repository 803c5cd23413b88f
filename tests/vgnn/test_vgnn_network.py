"""The network alone: what it must not depend on."""

import numpy as np
import pytest
import torch

from tactibench.markers import pin_graph
from tactibench.training import torch_seed
from tactibench_vgnn import NEAREST, NO_PIN, NODE, GraphNetwork, neighbour_table


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
def test_the_order_of_neighbours_does_not_matter(rest_pins):
    table, x = table_of(rest_pins), examples(len(rest_pins))
    one, other = (network(rest_pins, t)(x) for t in (table, table.flip(1)))
    torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)


@torch.inference_mode()
def test_frames_that_bring_the_graph_at_rest_give_what_the_graph_at_rest_gives(rest_pins):
    table, x = table_of(rest_pins), examples(len(rest_pins))
    brought = torch.cat([x, table.float().expand(3, -1, -1)], dim=-1)
    assert brought.shape[-1] == NODE + NEAREST
    one = network(rest_pins, table)(x)
    torch.testing.assert_close(one, network(rest_pins, None)(brought), rtol=1e-4, atol=1e-4)


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


@pytest.mark.parametrize("brought", [False, True])
@torch.inference_mode()
def test_the_settled_copy_gives_the_same(rest_pins, brought):
    table, x = table_of(rest_pins), examples(len(rest_pins))
    made = network(rest_pins, None if brought else table)
    x = torch.cat([x, table.float().expand(3, -1, -1)], dim=-1) if brought else x
    torch.testing.assert_close(made.with_fixed_weights()(x), made(x), rtol=1e-5, atol=1e-5)
    assert all(messages.fixed is None for messages in made.rounds)


@torch.inference_mode()
def test_pins_without_any_neighbour_are_answered(rest_pins):
    nobody = torch.full((len(rest_pins), NEAREST), NO_PIN)
    raw = network(rest_pins, nobody)(examples(len(rest_pins)))
    assert torch.isfinite(raw).all()
