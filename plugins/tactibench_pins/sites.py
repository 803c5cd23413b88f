"""The models ``kernel`` and ``pins`` where named places are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.linalg import cho_factor, cho_solve, eigh
from torch.nn import functional

from tactibench import ModelContext
from tactibench.training import Seeds, SiteModel, torch_seed

Array = npt.NDArray[np.float64]
Inputs = npt.NDArray[np.float32]
Places = npt.NDArray[np.bool_]
Arrays = dict[str, npt.NDArray[Any]]

_RIDGE = 1.0
"""Ridge, as a share of the mean squared distance of a trial from the mean trial."""
_COMPONENTS = 200
"""Most components of the channels that the networks see."""
_BATCH, _RATE, _DECAY = 64, 3e-3, 1e-2
_NOISE = 0.5
"""Deviation of the noise on components of unit deviation, and share of hidden units left out."""


class KernelSites(SiteModel):
    """Ridge regression of the touched places on squashed channels, by the kernel of the trials."""

    name = "kernel"

    def learn(self, inputs: Inputs, touched: Places, rng: np.random.Generator) -> Arrays:
        """Return the weights (C, K)."""
        del rng
        apart = inputs - inputs.mean(axis=0)
        gram = (apart @ apart.T).astype(np.float64)
        gram[np.diag_indices(len(gram))] += _RIDGE * np.trace(gram) / len(gram)
        return {"weight": apart.T @ cho_solve(cho_factor(gram), touched - touched.mean(axis=0))}

    def scores(self, learned: Mapping[str, npt.NDArray[Any]], inputs: Inputs) -> Array:
        """Return the (N, K) scores."""
        scores: Array = inputs @ learned["weight"]
        return scores


class PinsSites(SiteModel):
    """Averaged networks on components of the squashed channels; a score is their mean."""

    name = "pins"

    def __init__(
        self,
        context: ModelContext,
        mixing: bool = True,
        members: int = 4,
        width: int = 128,
        epochs: int = 30,
    ) -> None:
        super().__init__(context, mixing)
        self._members, self._width, self._epochs = members, width, epochs

    def learn(self, inputs: Inputs, touched: Places, rng: np.random.Generator) -> Arrays:
        """Return the basis of the components, and weights and biases of the layers."""
        seeds, device = Seeds.draw(rng), self.context.device
        basis = _components(inputs)
        values = torch.from_numpy(inputs @ basis).to(device)
        targets = torch.from_numpy(touched.astype(np.float32)).to(device)
        sizes = (values.shape[1], self._width, self._width, targets.shape[1])
        steps = -(-len(values) // _BATCH)
        with torch_seed(seeds.init, device):
            layers = [
                torch.randn(self._members, first + 1, last, device=device) / first**0.5
                for first, last in pairwise(sizes)
            ]
            for layer in layers:
                layer.requires_grad_()
            adam = torch.optim.AdamW(layers, _RATE, weight_decay=_DECAY)
            rates = torch.optim.lr_scheduler.OneCycleLR(
                adam, _RATE, total_steps=steps * self._epochs
            )
            for epoch in range(self._epochs):
                order = torch.from_numpy(seeds.permutation(len(values), epoch))
                for rows in order.to(device).tensor_split(steps):
                    shown = values[rows].expand(self._members, -1, -1)
                    raw = _forward(layers, shown + _NOISE * torch.randn_like(shown), drop=_NOISE)
                    loss = functional.binary_cross_entropy_with_logits(
                        raw, targets[rows].expand_as(raw)
                    )
                    adam.zero_grad()
                    loss.backward()  # type: ignore[no-untyped-call]
                    adam.step()
                    rates.step()
        arrays = {f"layer{k}": layer.detach().cpu().numpy() for k, layer in enumerate(layers)}
        return {"basis": basis, **arrays}

    @torch.inference_mode()
    def scores(self, learned: Mapping[str, npt.NDArray[Any]], inputs: Inputs) -> Array:
        """Return the (N, K) mean answers of the networks, less those to channels at rest."""
        layers = [torch.from_numpy(learned[f"layer{k}"]) for k in range(3)]
        values = torch.from_numpy(np.concatenate([0 * inputs[:1], inputs]) @ learned["basis"])
        raw = _forward(layers, values.expand(len(layers[0]), -1, -1)).mean(dim=0).double().numpy()
        scores: Array = raw[1:] - raw[0]
        return scores


def _components(inputs: Inputs) -> Inputs:
    """Return the basis (C, P) of the strongest components, each of mean square 1."""
    count = min(_COMPONENTS, *inputs.shape)
    last = len(inputs) - 1
    power, rows = eigh(inputs @ inputs.T, subset_by_index=(last + 1 - count, last))
    basis: Inputs = (inputs.T @ (rows / np.maximum(power, 1e-6))) * len(inputs) ** 0.5
    return basis.astype(np.float32)


def _forward(
    layers: list[torch.Tensor], values: torch.Tensor, *, drop: float = 0.0
) -> torch.Tensor:
    """Return the answers (M, N, K) to values (M, N, P) by M networks of fully connected layers."""
    for number, layer in enumerate(layers):
        if number:
            values = functional.dropout(functional.gelu(values), drop, training=drop > 0)
        values = torch.baddbmm(layer[:, -1:], values, layer[:, :-1])
    return values
