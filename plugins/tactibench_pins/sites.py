"""The models ``kernel`` and ``pins`` where named places are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy.linalg import cho_factor, cho_solve, eigh

from tactibench import ModelContext
from tactibench.training import Seeds, SiteModel, torch_seed
from tactibench_pins.model import Members

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
"""Deviation of the noise on components of unit deviation."""
_LAYERS = 2


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
    """Averaged networks (``Members``) on components of the squashed channels."""

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
        """Return the components and the state of the networks."""
        seeds, components = Seeds.draw(rng), _components(inputs)
        values = torch.from_numpy(inputs @ components)
        targets = torch.from_numpy(touched.astype(np.float32))[:, None]
        steps = -(-len(values) // _BATCH)
        with torch_seed(seeds.init):
            networks = self._networks(values.shape[1], touched.shape[1])
            networks.basis.copy_(torch.eye(values.shape[1]))
            networks.noise.fill_(_NOISE)
            adam = torch.optim.AdamW(networks.parameters(), _RATE, weight_decay=_DECAY)
            total = steps * self._epochs
            rates = torch.optim.lr_scheduler.OneCycleLR(adam, _RATE, total_steps=total)
            for epoch in range(self._epochs):
                order = torch.from_numpy(seeds.permutation(len(values), epoch))
                for rows in order.tensor_split(steps):
                    loss = (networks(values[rows])[..., :-1] - targets[rows]).square().mean()
                    adam.zero_grad()
                    loss.backward()
                    adam.step()
                    rates.step()
        state = {name: value.numpy() for name, value in networks.state_dict().items()}
        return {"components": components, **state}

    @torch.inference_mode()
    def scores(self, learned: Mapping[str, npt.NDArray[Any]], inputs: Inputs) -> Array:
        """Return the (N, K) mean answers of the networks, less those to channels at rest."""
        rest = np.zeros_like(inputs, shape=(1, inputs.shape[1]))
        values = np.concatenate([rest, inputs]) @ learned["components"]
        networks = self._networks(values.shape[1], learned[f"weights.{_LAYERS}"].shape[2])
        networks.load_state_dict({n: torch.from_numpy(learned[n]) for n in networks.state_dict()})
        raw = networks.eval()(torch.from_numpy(values))[..., :-1].mean(dim=1).double().numpy()
        scores: Array = raw[1:] - raw[0]
        return scores

    def _networks(self, components: int, places: int) -> Members:
        sizes = [components, *[self._width] * _LAYERS, places]
        return Members(components, sizes, self._members)


def _components(inputs: Inputs) -> Inputs:
    """Return the basis (C, P) of the strongest components, each of mean square 1."""
    count = min(_COMPONENTS, *inputs.shape)
    last = len(inputs) - 1
    power, rows = eigh(inputs @ inputs.T, subset_by_index=(last + 1 - count, last))
    basis: Inputs = (inputs.T @ (rows / np.maximum(power, 1e-6))) * len(inputs) ** 0.5
    return basis.astype(np.float32)
