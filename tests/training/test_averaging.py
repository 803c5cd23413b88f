import numpy as np
import torch
from torch import nn

from tactibench.training import Examples, average_weights, measure_statistics


def walk(steps, decay):
    """The mean of a weight that is 1, 2, 3, ... after the steps."""
    network = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(network.weight)
    mean = average_weights(network, decay)
    for step in range(1, steps + 1):
        nn.init.constant_(network.weight, float(step))
        mean.update_parameters(network)
    return mean.module.weight.item()


def test_the_first_step_is_the_mean():
    assert walk(1, 0.9) == 1.0


def test_it_forgets_the_start_and_then_decays_evenly():
    decay, expected = 0.8, 1.0
    for step in range(2, 101):
        kept = min(decay, step / (9 + step))
        expected = kept * expected + (1 - kept) * step
    assert abs(walk(100, decay) - expected) < 1e-3
    assert abs(walk(100, decay) - (100 - decay / (1 - decay))) < 1e-3


def test_it_is_a_network_of_its_own_that_no_gradient_reaches():
    network = nn.Sequential(nn.Linear(2, 2), nn.Dropout(0.5)).train()
    mean = average_weights(network, 0.9)
    assert not mean.module.training
    assert not any(weight.requires_grad for weight in mean.parameters())
    assert mean.module[0].weight is not network[0].weight
    assert network[0].weight.requires_grad


def test_statistics_come_from_rows_that_stand_for_all():
    rng = np.random.default_rng(3)
    depth = rng.permutation(np.linspace(0, 1, 3000)).astype(np.float32)
    images = torch.zeros(len(depth), 1, 2, 2, dtype=torch.uint8)
    examples = Examples(images, torch.from_numpy(depth)[:, None])
    rows = examples.spread_rows(100)
    assert len(set(rows.tolist())) == 100
    taken = depth[rows.numpy()]
    assert abs(taken.mean() - depth.mean()) < 1e-3
    assert abs(taken.std() - depth.std()) < 1e-2
    assert sorted(examples.spread_rows(5000).tolist()) == list(range(3000))


def test_measured_statistics_are_means_over_the_batches():
    network = nn.Sequential(nn.BatchNorm2d(1))
    torch.nn.init.constant_(network[0].running_mean, 7.0)
    generator = torch.Generator().manual_seed(1)
    batches = [k + torch.rand(4, 1, 3, 3, generator=generator) for k in range(3)]
    measure_statistics(network, batches, lambda module, images: module(images))
    mean = torch.stack([batch.mean() for batch in batches]).mean()
    variance = torch.stack([batch.var() for batch in batches]).mean()
    torch.testing.assert_close(network[0].running_mean[0], mean)
    torch.testing.assert_close(network[0].running_var[0], variance)
    assert network[0].momentum == 0.1


def test_nothing_is_computed_where_nothing_normalises():
    measure_statistics(nn.Sequential(nn.Linear(2, 2)), [torch.rand(1, 2)], lambda *_: 1 / 0)
