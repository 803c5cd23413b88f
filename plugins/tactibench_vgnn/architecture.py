"""The graph network: messages between neighbouring pins, and a token that pools them all."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import torch
from torch import nn

from tactibench_vgnn.features import NEAREST, NODE

_GEOMETRY = 3
"""Numbers about an edge: the step from a pin to its neighbour, in pitches, and its length."""
_BASIS = 6
"""Weights of an edge in a round of messages: a pin receives as many weighted sums."""
_POOLS = 16
"""Weighted sums over all pins that the global token consists of."""
_TOKEN = 256
"""Units of the dense layers between these sums and the features that pins get back."""
_WAVES = (0.5, 1.0, 2.0)
"""Half periods, over half the layout, of the sines and cosines in which a pin's place enters."""
_OUTPUTS = 7
"""Raw outputs of a pin, as ``tactibench.training.mixture_values`` reads them; the first is the
logit of presence."""
_FIRST_LOGIT = -4.0
"""First logit of presence: it expects two contacts among 127 pins before anything is learned."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The neighbours of every pin.

    Attributes:
        near: (P, K) or (B, P, K) numbers of the neighbours.
        there: (..., P, K, 1), 1 where there is a neighbour and 0 where there is none.
        apart: (..., P, K, 3) geometry of the edges at rest.
    """

    near: torch.Tensor
    there: torch.Tensor
    apart: torch.Tensor

    @classmethod
    def of(cls, table: torch.Tensor, place: torch.Tensor) -> Edges:
        """Return the edges of a table of neighbours.

        Args:
            table: (..., P, K) neighbours, -1 for none.
            place: (P, 2) places of the pins at rest, in pitches.
        """
        near = table.clamp_min(0)
        step = place[near] - place[:, None]
        apart = torch.cat([step, step.norm(dim=-1, keepdim=True)], dim=-1)
        exists = (table >= 0)[..., None].to(place.dtype)
        return cls(near, exists, apart * exists)

    def gather(self, nodes: torch.Tensor) -> torch.Tensor:
        """Return the features (B, P, K, W) of every pin's neighbours, from nodes (B, P, W)."""
        batch, pins, width = nodes.shape
        if self.near.ndim == 2:
            gathered = nodes.index_select(1, self.near.flatten())
        else:
            index = self.near.flatten(1)[..., None].expand(-1, -1, width)
            gathered = nodes.gather(1, index)
        return gathered.view(batch, pins, -1, width)


class EdgeEncoder(nn.Module):
    """Features of a pin from the steps to its neighbours, at rest and since: W sum_j f(e_ij)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.encode = nn.Linear(_GEOMETRY + NODE, width)
        self.mix = nn.Linear(width, width)

    def forward(self, nodes: torch.Tensor, edges: Edges) -> torch.Tensor:
        change = edges.gather(nodes) - nodes[:, :, None]
        apart = edges.apart.expand(*change.shape[:3], _GEOMETRY)
        steps = self.encode(torch.cat([apart, change], dim=-1)).relu() * edges.there
        mixed: torch.Tensor = self.mix(steps.sum(dim=2) / _BASIS)
        return mixed


class Messages(nn.Module):
    """One round: z_i += F(z_i, sum_j u_1(e_ij) z_j, ..., sum_j u_6(e_ij) z_j).

    The weights u are learned functions of the step e_ij from a pin to its neighbour at rest, so
    that a pin tells its neighbours apart without an order among them (Monti et al. 2017, MoNet).
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.weigh = nn.Sequential(nn.Linear(_GEOMETRY, 32), nn.Tanh(), nn.Linear(32, _BASIS))
        self.mix = nn.Sequential(
            nn.Linear((1 + _BASIS) * width, width), nn.ReLU(), nn.Linear(width, width)
        )
        self.fixed: torch.Tensor | None = None

    def weights(self, edges: Edges) -> torch.Tensor:
        """Return the weights (..., P, 6, K) of the edges."""
        if self.fixed is not None:
            return self.fixed
        weights: torch.Tensor = self.weigh(edges.apart) * edges.there / 2
        return weights.transpose(-1, -2)

    def forward(self, nodes: torch.Tensor, edges: Edges) -> torch.Tensor:
        normal = self.norm(nodes)
        sums = torch.matmul(self.weights(edges), edges.gather(normal)).flatten(2)
        updated: torch.Tensor = nodes + self.mix(torch.cat([normal, sums], dim=-1))
        return updated


class Token(nn.Module):
    """A global token: it pools the features of all pins and gives some back to each.

    The token is made of sums over the pins, weighted by learned functions of their place at rest;
    its features are handed back with such weights.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.weigh = nn.Sequential(nn.Linear(2, 64), nn.Tanh(), nn.Linear(64, 2 * _POOLS))
        self.think = nn.Sequential(
            nn.Linear(_POOLS * width, _TOKEN),
            nn.ReLU(),
            nn.Linear(_TOKEN, _TOKEN),
            nn.ReLU(),
            nn.Linear(_TOKEN, _POOLS * width),
        )
        self.fixed: torch.Tensor | None = None

    def weights(self, place: torch.Tensor) -> torch.Tensor:
        """Return the weights (P, 32) of pins at places (P, 2), half of them for the way back."""
        if self.fixed is not None:
            return self.fixed
        weights: torch.Tensor = self.weigh(place)
        return weights

    def forward(self, nodes: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        into, out_of = self.weights(place).chunk(2, dim=-1)
        sums = torch.matmul(into.t(), self.norm(nodes)) / math.sqrt(len(place))
        token = self.think(sums.flatten(1)).view_as(sums)
        updated: torch.Tensor = nodes + torch.matmul(out_of, token) / math.sqrt(_POOLS)
        return updated


class GraphNetwork(nn.Module):
    """(B, P, F) features of pins -> (B, 7, P) raw outputs of a mixture with one anchor a pin.

    Every second round of messages is followed by the token.

    Args:
        place: (P, 2) places of the pins at rest, any unit.
        pitch: Distance of neighbouring pins, in the same unit.
        table: (P, K) neighbours at rest, -1 for none; None: every frame brings its own neighbours
            after the features of its pins.
        width: Features of a pin.
        layers: Rounds of messages.
    """

    place: torch.Tensor
    waves: torch.Tensor
    table: torch.Tensor

    def __init__(
        self,
        place: torch.Tensor,
        pitch: float,
        table: torch.Tensor | None,
        width: int,
        layers: int,
    ) -> None:
        super().__init__()
        middle = place - place.mean(dim=0)
        self.pitches = float(middle.abs().max()) / pitch  # half the layout, in pitches
        unit = middle / middle.abs().max().clamp_min(1e-6)
        self.register_buffer("place", unit.float(), persistent=False)
        angle = torch.cat([wave * math.pi * unit for wave in _WAVES], dim=-1).float()
        waves = torch.cat([angle.sin(), angle.cos()], dim=-1)
        self.register_buffer("waves", waves, persistent=False)
        none = torch.empty(0, NEAREST, dtype=torch.long)
        self.register_buffer("table", none if table is None else table, persistent=False)
        self.embed = nn.Sequential(
            nn.Linear(NODE + waves.shape[1], width), nn.ReLU(), nn.Linear(width, width)
        )
        self.encode = EdgeEncoder(width)
        self.rounds = nn.ModuleList(Messages(width) for _ in range(layers))
        self.tokens = nn.ModuleList(Token(width) for _ in range(max(1, layers // 2)))
        self.head = nn.Sequential(
            nn.LayerNorm(width),
            nn.Linear(width, width),
            nn.ReLU(),
            nn.Linear(width, _OUTPUTS),
        )
        last = self.head[-1]
        assert isinstance(last, nn.Linear)  # noqa: S101
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        nn.init.constant_(last.bias[:1], _FIRST_LOGIT)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        nodes = features[..., :NODE]
        edges = self._edges(features)
        waves = self.waves.expand(len(nodes), -1, -1)
        hidden = self.embed(torch.cat([nodes, waves], dim=-1)) + self.encode(nodes, edges)
        for number, messages in enumerate(self.rounds):
            hidden = messages(hidden, edges)
            if number % 2 or len(self.rounds) == 1:
                hidden = self.tokens[number // 2](hidden, self.place)
        raw: torch.Tensor = self.head(hidden).transpose(1, 2)
        return raw

    def with_fixed_weights(self) -> GraphNetwork:
        """Return a copy for inference, in which weights that depend on the rest alone are fixed."""
        copied = copy.deepcopy(self).eval()
        with torch.no_grad():
            for token in copied.tokens:
                assert isinstance(token, Token)  # noqa: S101
                token.fixed = token.weights(copied.place)
            for messages in copied.rounds if len(copied.table) else ():
                assert isinstance(messages, Messages)  # noqa: S101
                messages.fixed = messages.weights(Edges.of(copied.table, copied._place()))
        return copied

    def _place(self) -> torch.Tensor:
        return self.place * self.pitches

    def _edges(self, features: torch.Tensor) -> Edges:
        table = self.table if len(self.table) else features[..., NODE:].long()
        return Edges.of(table, self._place())
