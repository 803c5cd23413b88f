"""Losses on saturated logits, in float32 and bf16: finite where the formula is, else not hidden."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from tactibench import Grid, ModelContext
from tactibench.plugins import PluginHost
from tactibench.training import MixtureScale, mixture_loss, mixture_values

GRID = Grid.centred(16, 1.6)
HUGE = 1e4
SCALE = MixtureScale(reach_mm=2.0, max_depth_mm=6.0)
ANCHORS = torch.tensor([[-4.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
KINDS = [torch.float32, torch.bfloat16]


@pytest.fixture(scope="module")
def models() -> dict[str, Any]:
    host = PluginHost()
    hertz = host.encoders["hertz"].build()
    return {
        name: host.models[name].build(ModelContext("contacts", GRID, 6.0, encoder))
        for name, encoder in (("unet", hertz), ("cnn", None), ("pins", None))
    }


def raw(value: float, kind: torch.dtype = torch.float32) -> torch.Tensor:
    return torch.full((2, 7, 3), value, dtype=kind, requires_grad=True)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("logit", [HUGE, -HUGE])
@pytest.mark.parametrize("heat", [0.0, 1.0])
def test_cross_entropy_of_saturated_logits_is_linear(
    models: Any, kind: torch.dtype, logit: float, heat: float
) -> None:
    """max(x, 0) - x t: from a sigmoid it would be -log 0."""
    logits = torch.full((1, 1, 4, 4), logit, dtype=kind, requires_grad=True)
    loss = models["unet"].loss(logits.float(), torch.full((1, 1, 4, 4), heat))
    target = 0.7 * heat  # of its headroom
    held = float(logits.detach()[0, 0, 0, 0])
    assert loss.item() == pytest.approx(max(held, 0.0) - held * target, rel=1e-6)
    loss.backward()
    assert torch.isfinite(logits.grad).all()
    steep = (1.0 if logit > 0 else 0.0) - target
    np.testing.assert_allclose(logits.grad.float().numpy(), steep / 16, rtol=0.01, atol=1e-9)


@pytest.mark.parametrize("name", ["unet", "cnn", "pins"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_an_output_that_is_not_finite_makes_the_loss_so(models: Any, name: str, bad: float) -> None:
    shape = {"unet": (2, 1, 4, 4), "cnn": (2, 4), "pins": (2, 4, 4)}[name]
    wanted = torch.zeros(shape if name == "unet" else (2, 3))
    outputs = torch.zeros(shape)
    assert math.isfinite(float(models[name].loss(outputs, wanted)))
    outputs[(0,) * len(shape)] = bad
    assert not math.isfinite(float(models[name].loss(outputs, wanted)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", [HUGE, -HUGE, 0.0])
def test_the_likelihood_of_saturated_outputs_is_finite(kind: torch.dtype, value: float) -> None:
    """All seven outputs at once: probability, place, depth and log std (std is cut off)."""
    outputs = raw(value, kind)
    contacts = torch.tensor([[[0.0, 0.0, 3.0]], [[math.nan] * 3]])
    loss = mixture_loss(outputs, ANCHORS, contacts, SCALE)
    assert torch.isfinite(loss)
    loss.backward()
    assert torch.isfinite(outputs.grad).all()


@pytest.mark.parametrize("logit", [HUGE, -HUGE])
def test_the_likelihood_of_a_saturated_probability_in_closed_form(logit: float) -> None:
    """One anchor on the contact with the std s: 3 log s + 3/2 log 2 pi of the place, and the
    Gaussian of the count with variance 1/12 around 1 or 0."""
    outputs = torch.zeros(1, 7, 1)
    outputs[0, 0] = logit
    outputs[0, 4:] = math.log(0.5)
    contact = torch.tensor([[[0.0, 0.0, 3.0]]])
    loss = float(mixture_loss(outputs, torch.zeros(1, 2), contact, SCALE))
    std = math.hypot(0.5, SCALE.floor_mm)
    place = 3 * math.log(std) + 1.5 * math.log(2 * math.pi)
    missed = 0.0 if logit > 0 else 1.0
    count = 0.5 * (missed * 12 + math.log(1 / 12) + math.log(2 * math.pi))
    assert loss == pytest.approx(place + count, rel=1e-5)


@pytest.mark.parametrize("channel", range(7))
def test_no_channel_of_the_mixture_hides_a_nan(channel: int) -> None:
    outputs = torch.zeros(1, 7, 3)
    outputs[0, channel, 1] = math.nan
    contact = torch.tensor([[[0.0, 0.0, 3.0]]])
    assert torch.isnan(mixture_loss(outputs, ANCHORS, contact, SCALE))
    values = torch.cat([v.reshape(-1) for v in mixture_values(outputs, ANCHORS, SCALE)])
    assert torch.isnan(values).any()
