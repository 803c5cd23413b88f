import torch
from torch import nn

from tactibench.training.statistics import measure_statistics


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
