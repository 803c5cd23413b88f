"""The model ``vgnn``: frames -> pins -> graph -> any number of contacts, each with its std.

The graph network: messages between neighbouring pins, and a token that pools them all.

Tracked pins as numbers that a graph network reads.

The layout of a sensor's pins, learned from training frames: the place of each pin in mm.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from tactibench import Answer, Contacts, Frame, ModelContext, UserError
from tactibench.markers import Tracks, pin_graph
from tactibench.training import (
    MixtureModel,
    MixtureReader,
    Recipe,
    resting_frames,
)

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
        near: (P, K) numbers of the neighbours.
        there: (P, K, 1), 1 where there is a neighbour and 0 where there is none.
        apart: (P, K, 3) geometry of the edges at rest.
    """

    near: torch.Tensor
    there: torch.Tensor
    apart: torch.Tensor

    @classmethod
    def of(cls, table: torch.Tensor, place: torch.Tensor) -> Edges:
        """Return the edges of a table of neighbours.

        Args:
            table: (P, K) neighbours, -1 for none.
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
        return nodes.index_select(1, self.near.flatten()).view(batch, pins, -1, width)


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
        """Return the weights (P, 6, K) of the edges."""
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
    """(B, P, 5) features of pins -> (B, 7, P) raw outputs of a mixture with one anchor a pin.

    Every second round of messages is followed by the token.

    Args:
        place: (P, 2) places of the pins at rest, any unit.
        pitch: Distance of neighbouring pins, in the same unit.
        table: (P, K) neighbours at rest, -1 for none.
        width: Features of a pin.
        layers: Rounds of messages.
    """

    place: torch.Tensor
    waves: torch.Tensor
    table: torch.Tensor

    def __init__(
        self, place: torch.Tensor, pitch: float, table: torch.Tensor, width: int, layers: int
    ) -> None:
        super().__init__()
        middle = place - place.mean(dim=0)
        self.pitches = float(middle.abs().max()) / pitch  # half the layout, in pitches
        unit = middle / middle.abs().max().clamp_min(1e-6)
        self.register_buffer("place", unit.float(), persistent=False)
        angle = torch.cat([wave * math.pi * unit for wave in _WAVES], dim=-1).float()
        waves = torch.cat([angle.sin(), angle.cos()], dim=-1)
        self.register_buffer("waves", waves, persistent=False)
        self.register_buffer("table", table, persistent=False)
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
        edges = self._edges()
        waves = self.waves.expand(len(features), -1, -1)
        hidden = self.embed(torch.cat([features, waves], dim=-1)) + self.encode(features, edges)
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
            for messages in copied.rounds:
                assert isinstance(messages, Messages)  # noqa: S101
                messages.fixed = messages.weights(copied._edges())
        return copied

    def _edges(self) -> Edges:
        return Edges.of(self.table, self.place * self.pitches)


Floats = npt.NDArray[np.float32]
Table = npt.NDArray[np.int64]

NODE = 5
"""Features of a pin: displacement in x and y, growth of its Voronoi cell and of its own picture,
and whether it was seen."""
NEAREST = 8
"""Most neighbours of a pin: in a Delaunay graph of pins it has 6 on average."""
NO_PIN = -1
_LONGEST = 2.0
"""Edges beyond this multiple of the median are long."""


def node_features(tracks: Tracks, layout: PinLayout) -> Floats:
    """Return the features (N, P, 5) of the pins of N frames.

    Displacement and growths are divided by their rms over the training frames; a growth is the
    logarithm of an area or a radius over that at rest.

    Args:
        tracks: Tracked pins of the frames.
        layout: Layout of the pins.
    """
    features = np.zeros((len(tracks), len(layout.rest), NODE), np.float32)
    areas = np.array([pin_graph(xy).area for xy in tracks.xy]).reshape(features.shape[:2])
    features[..., :2] = (tracks.xy - layout.rest) / layout.moved_px
    features[..., 2] = layout.growth(areas) / layout.grown
    radius = np.where(tracks.seen, tracks.radius, np.nan)  # a fit to no light has shrunk
    features[..., 3] = layout.swelling(radius) / layout.swollen
    features[..., 4] = tracks.seen
    return features


def neighbour_table(edges: Table, xy: npt.NDArray[np.float64]) -> Table:
    """Return the neighbours (P, 8) of each pin, nearest first; -1 for none.

    Long edges run along the hull between pins that are no neighbours on the skin; a pin keeps one
    of them where it has no other edge.

    Args:
        edges: (E, 2) numbers of the pins that an edge joins.
        xy: (P, 2) places of the pins, px.
    """
    table = np.full((len(xy), NEAREST), NO_PIN, dtype=np.int64)
    directed = np.concatenate([edges, edges[:, ::-1]])
    length = np.linalg.norm(xy[directed[:, 0]] - xy[directed[:, 1]], axis=1)
    order = np.lexsort((directed[:, 1], length, directed[:, 0]))
    pin, neighbour = directed[order].T
    rank = np.arange(len(pin)) - np.searchsorted(pin, pin)
    short = length[order] <= _LONGEST * np.median(length)
    listed = (rank < NEAREST) & (short | (rank == 0))
    table[pin[listed], rank[listed]] = neighbour[listed]
    return table


Array = npt.NDArray[np.float64]

_SHARPNESS = 3
"""Power of a pin's displacement that is its weight in the centre of a press: at 3 the centre tells
the contact best (0.21 mm on the default sensor; 0.29 mm at 1, 0.25 mm at 4)."""
_REACH = 2.5
"""A pin may report contacts this many times farther away than any contact is from its nearest
pin."""
_SMALLEST_AREA = 1e-3
"""Smallest area of a Voronoi cell, as a share of the median: pins on one spot have none."""


@dataclass(frozen=True, eq=False)
class PinLayout:
    """Pins of a sensor at rest, and the scales of their motion over the training frames.

    Attributes:
        rest: (P, 2) places of the pins at rest, px.
        radius: (P,) radii of the pins' pictures at rest, px; 0 where unknown.
        affine: (3, 2) map from [x, y, 1], px, to mm.
        moved_px: Rms displacement of a pin.
        grown: Rms logarithm of the change of a Voronoi cell's area.
        swollen: Rms logarithm of the change of a picture's radius.
        reach_mm: Greatest distance from a pin of the contacts that it reports.
    """

    rest: Array
    radius: Array
    affine: Array
    moved_px: float = 1.0
    grown: float = 1.0
    swollen: float = 1.0
    reach_mm: float = 1.0

    @classmethod
    def learn(cls, tracks: Tracks, rest: Tracks, truth: Sequence[Contacts]) -> Self:
        """Return the layout that is fitted to tracked frames; ``affine`` to single contacts alone.

        Args:
            tracks: Tracked pins of the frames.
            rest: Tracked pins of the one frame of the sensor at rest.
            truth: Contacts of the frames.

        Raises:
            UserError: Fewer than three frames have a single contact that moves pins.
        """
        pins = rest.xy[0]
        radius = np.nan_to_num(rest.radius[0])
        layout = cls(pins, radius, _affine(tracks.xy, pins, truth))
        contacts = np.concatenate([contacts.xy for contacts in truth])
        away = np.linalg.norm(contacts[:, None] - layout.anchors, axis=-1).min(axis=1)
        areas = np.stack([pin_graph(xy).area for xy in tracks.xy])
        return replace(
            layout,
            moved_px=_rms(tracks.xy - pins),
            grown=_rms(layout.growth(areas)),
            swollen=_rms(layout.swelling(np.where(tracks.seen, tracks.radius, np.nan))),
            reach_mm=max(1.0, _REACH * float(away.max())),
        )

    @property
    def anchors(self) -> Array:
        """Places (P, 2) of the pins at rest, mm: where a press on each is centred."""
        places: Array = np.c_[self.rest, np.ones(len(self.rest))] @ self.affine
        return places

    def growth(self, areas: Array) -> Array:
        """Return the logarithm (N, P) of Voronoi areas (N, P), px^2, over those at rest."""
        usual = pin_graph(self.rest).area
        least = _SMALLEST_AREA * float(np.median(usual))
        ratio: Array = np.log(np.maximum(areas, least) / np.maximum(usual, least))
        return ratio

    def swelling(self, radius: Array) -> Array:
        """Return the logarithm (N, P) of radii (N, P), px, over those at rest; 0 where unknown."""
        measured = (radius > 0) & (self.radius > 0)  # false for NaN
        ratio: Array = np.where(measured, radius, 1.0) / np.where(measured, self.radius, 1.0)
        return np.asarray(np.log(ratio), dtype=np.float64)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values from which ``from_json`` makes the same layout."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Return the layout of ``to_json``."""
        arrays = {name: np.array(values[name]) for name in ("rest", "radius", "affine")}
        return cls(**(values | arrays))


def _affine(xy: Array, rest: Array, truth: Sequence[Contacts]) -> Array:
    """Return the least-squares map (3, 2) from the centre of a press, px, to its contact, mm.

    Only frames with a single contact are used.

    Raises:
        UserError: Fewer than three frames have a single contact that moves pins.
    """
    single = np.array([len(contacts) == 1 for contacts in truth])
    centre, moved = press_centres(xy[single], rest)
    if np.count_nonzero(moved) < 3:
        raise UserError(
            f"model 'vgnn' needs at least 3 training frames in which one contact moves pins, but "
            f"has {np.count_nonzero(moved)}; raise the training count."
        )
    contact = np.concatenate([contacts.xy for contacts in truth if len(contacts) == 1])
    places = np.c_[centre[moved], np.ones(int(moved.sum()))]
    return np.asarray(np.linalg.lstsq(places, contact[moved], rcond=None)[0], dtype=np.float64)


def press_centres(xy: Array, rest: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return the centres (N, 2) of presses, px, and whether any pin moved (N,).

    A centre is the mean place of the pins at rest, weighted by their displacement cubed; it is the
    middle of the layout where no pin moved.

    Args:
        xy: (N, P, 2) places of the pins, px.
        rest: (P, 2) places of the pins at rest, px.
    """
    weight = np.linalg.norm(xy - rest, axis=-1) ** _SHARPNESS
    total = weight.sum(axis=1, keepdims=True)
    moved = total[:, 0] > 0
    weight = np.where(moved[:, None], weight / np.where(total > 0, total, 1.0), 1 / len(rest))
    return np.asarray(weight @ rest, dtype=np.float64), moved


def _rms(values: Array) -> float:
    """Return the root mean square of values; 1 where nothing ever changes."""
    rms = float(np.sqrt(np.square(values).mean())) if values.size else 0.0
    return rms if rms > 1e-6 else 1.0


RECIPE = Recipe(epochs=20, batch=32, learning_rate=3e-3, warmup=0.2, weight_decay=1e-2)
_THRESHOLD = 0.05
"""Expected number of contacts from which a contact is reported. It is low because between two pins
each may leave a contact to the other. Of 400 validation presses of exp1 none is missed and none
seen twice from 0.01 to 0.1; at 0.2 one is missed, at 0.5 four."""
_MERGE_MM = 3.0
"""Pins whose contacts lie closer than a tip's radius report the same contact."""
_READER = MixtureReader(_THRESHOLD, _MERGE_MM)
_SCALE_FRAMES = 400
"""Training frames, spread evenly, from which the scales of the layout are learned."""
_RESTING_SHARE = 0.02
"""Frames at rest that are added to a training, as a share of its frames."""
_NO_PINS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Places of pins that stand for the layout until there is one."""


class VGNN(MixtureModel):
    """Voronoi graph network (compare Fan et al. 2023, Tac-VGNN) that gives a set of contacts.

    Every pin is an anchor of a mixture of Gaussians: it gives the probability that it reports a
    contact, and where and how deep that contact is. The pins and the graph of the undeformed sensor
    are taken from the rest image of the first training frame, or from the frame that is pressed
    least. Pins of other sensors are mapped to this layout (``AlignedSensors``).
    """

    name = "vgnn"

    def __init__(
        self,
        context: ModelContext,
        width: int = 32,
        layers: int = 4,
        epochs: int = 0,
        precision: str = "recipe",
        mixing: float = 0.0,
    ) -> None:
        architecture = {"width": width, "layers": layers, "answer": context.answer}
        super().__init__(context, RECIPE.with_choices(epochs, precision), architecture, mixing)
        self._use_layout(PinLayout(_NO_PINS, np.zeros(3), np.zeros((3, 2))))

    def empty_frames(self, frames: Sequence[Frame]) -> list[Frame]:
        """Return frames of the sensor at rest, without contact; none for plates."""
        if self.context.answer == "plate":
            return []
        return resting_frames(frames, _RESTING_SHARE)

    def prepare(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> None:
        super().prepare(frames, truth)
        assert self._sensors is not None  # noqa: S101
        rows = np.unique(
            np.linspace(0, len(frames) - 1, min(len(frames), _SCALE_FRAMES)).astype(int)
        )
        tracks = self._tracks([frames[row] for row in rows])
        contacts = [self._plate.contacts(truth[row]) for row in rows]
        first = self._sensors.first
        rest = first.tracker.track(first.rest_image[None])
        self._use_layout(PinLayout.learn(tracks, rest, contacts))

    def build(self) -> GraphNetwork:
        rest, shape = self._layout.rest, self.architecture
        edges = pin_graph(rest).edges
        pitch = float(np.median(np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)))
        table = neighbour_table(edges, rest)
        most = int((table != NO_PIN).sum(axis=1).max())
        return GraphNetwork(
            torch.from_numpy(rest),
            pitch,
            torch.from_numpy(table[:, :most]),
            shape["width"],
            shape["layers"],
        )

    def inputs(self, frames: Sequence[Frame]) -> torch.Tensor:
        return torch.from_numpy(node_features(self._tracks(frames), self._layout))

    def read(self, outputs: npt.NDArray[Any]) -> list[Contacts]:
        probability, mean, std = np.split(outputs.astype(np.float64), [1, 4], axis=-1)
        return _READER.read_all(probability[..., 0], mean, std)

    def extra(self) -> dict[str, Any]:
        return {"layout": self._layout.to_json(), **super().extra()}

    def restore(self, extra: dict[str, Any]) -> None:
        super().restore(extra)
        self._use_layout(PinLayout.from_json(extra["layout"]))

    def fold(self, network: nn.Module) -> nn.Module:
        assert isinstance(network, GraphNetwork)  # noqa: S101
        return network.with_fixed_weights()

    def _use_layout(self, layout: PinLayout) -> None:
        self._layout = layout
        self._use_anchors(layout.anchors, layout.reach_mm)
