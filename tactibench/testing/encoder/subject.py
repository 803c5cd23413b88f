"""An encoder under test, and the contacts that it is asked to show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts, Grid
from tactibench.plugins.base import Encoder
from tactibench.plugins.specs import EncoderSpec, Value
from tactibench.testing.property import NotApplicable, require

HALF_WIDTH = 6.4
"""Contacts lie in +- this, mm, as in the experiments."""
SHALLOW, DEEP = 0.5, 6.0
"""Range of depths, mm."""
MANY = 64

Maps = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class EncoderSubject:
    """spec, values: the encoder and its parameters.

    grid: of the maps. noise_cells: largest rms error of position, in cells, of contacts 2 to 6 mm
    deep on maps with white noise of 0.02.
    """

    title: str
    spec: EncoderSpec
    values: Mapping[str, Value]
    grid: Grid = field(default_factory=lambda: Grid.centred(64, 0.4))
    noise_cells: float = 1.0

    def build(self, values: Mapping[str, Value]) -> Encoder:
        encoder: Encoder = self.spec.load()(**values)
        return encoder

    @cached_property
    def encoder(self) -> Encoder:
        return self.build(self.values)

    @property
    def heat(self) -> bool:
        """Whether its maps are heat: 0 where nothing is, 1 where most is."""
        return self.spec.kind == "heat"

    @property
    def most(self) -> int:
        """Contacts that it may read from any map."""
        return self.spec.max_contacts or int(self.values.get("max_count", MANY))

    def encoded(self, contacts: Sequence[Contacts]) -> Maps:
        """(N, C, H, W) maps, one by one."""
        return np.stack([self.encoder.encode(one, self.grid) for one in contacts])

    def decoded(self, maps: Maps) -> list[Contacts]:
        """What is read from (N, C, H, W) maps."""
        return self.encoder.decode_batch(maps, self.grid)

    def must_be_heat(self) -> None:
        if not self.heat:
            raise NotApplicable(f"its maps, of kind {self.spec.kind!r}, are no heat")

    def must_show_several(self) -> None:
        if self.spec.max_contacts == 1:
            raise NotApplicable("it shows one contact only")


def single(rng: np.random.Generator, shallowest: float = SHALLOW) -> Contacts:
    """One contact, anywhere."""
    xy = rng.uniform(-HALF_WIDTH, HALF_WIDTH, (1, 2))
    return Contacts.truth(xy, rng.uniform(shallowest, DEEP, 1))


def errors(found: Contacts, truth: Contacts) -> tuple[float, float]:
    """Largest errors of position and depth, of the nearest prediction of every true contact.

    Raises Failed when two true contacts have the same nearest prediction.
    """
    require(len(found), "no contact was read")
    nearest = np.linalg.norm(found.xy[:, None] - truth.xy[None], axis=-1).argmin(axis=0)
    require(len(set(nearest.tolist())) == len(truth), "two contacts were read as one")
    depth = np.abs(found.depth[nearest] - truth.depth).max()
    return float(np.abs(found.xy[nearest] - truth.xy).max()), float(depth)


def words(contacts: Contacts) -> str:
    """``x -6.40 y 3.00 depth 0.50 mm`` of every contact."""
    rows = zip(contacts.xy.tolist(), contacts.depth.tolist(), strict=True)
    return " and ".join(f"x {x:.2f} y {y:.2f} depth {d:.2f} mm" for (x, y), d in rows)
