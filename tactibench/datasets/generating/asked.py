"""A data set that is asked for by names: what is pressed, and what presses it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactibench.datasets.generating.press import Source, source_of
from tactibench.datasets.generating.protocol import from_protocol
from tactibench.datasets.generating.stretches import Pressing, from_file
from tactibench.errors import UserError
from tactibench.plugins.base import SensorContext
from tactibench.plugins.host import PluginHost
from tactibench.protocols.loader import LoadedProtocol, load_protocol
from tactibench.run.request import read_parameters

SENSOR = "tactip-127"
"""Where no protocol names one."""


@dataclass(frozen=True)
class Asked:
    """The options of ``tactibench data generate``, all but the folder."""

    protocol: str | None = None
    plan: Path | None = None
    sensor: str | None = None
    params: tuple[str, ...] = ()
    count: int | None = None
    seed: int | None = None

    def found(self) -> tuple[Pressing, Source]:
        """What is pressed, and what presses it. Raises UserError."""
        if (self.protocol is None) == (self.plan is None):
            raise UserError(
                "name what is to be pressed: either a protocol, such as exp1, or --plan FILE."
            )
        loaded = self._loaded()
        source = self.source()
        asked: dict[str, Any] = {"importer": "tactibench data generate", "count": self.count}
        if loaded is None:
            assert self.plan is not None, "checked above"  # noqa: S101
            pressing = from_file(self.plan, self.seed or 0, self.count)
            asked |= {"plan": self.plan.name, "seed": self.seed or 0}
        else:
            built = source.build(SensorContext(np.random.SeedSequence(0)))
            pressing = from_protocol(loaded.keys, built, self.count)
            seed = loaded.keys.data_seed
            asked |= {"protocol": loaded.label, "sha256": loaded.hash, "seed": seed}
        return pressing, source.with_asked(asked)

    def source(self) -> Source:
        """The sensor with its parameters. Raises UserError for one that needs data."""
        loaded = self._loaded()
        name = self.sensor or (SENSOR if loaded is None else loaded.keys.defaults.sensor)
        spec = PluginHost().sensors[name]
        if spec.needs_data:
            raise UserError(
                f"sensor {name!r} presses nothing, it reads what was recorded; take "
                "`tactibench data import`."
            )
        given = read_parameters(self.params)
        for kind in set(given) - {"sensor"}:
            raise UserError(
                f"only the sensor has parameters here, --param names {kind}; leave it out."
            )
        return source_of(spec, spec.settings(given.get("sensor", {})))

    def _loaded(self) -> LoadedProtocol | None:
        """The protocol, with another seed of its presses where one is given."""
        if self.protocol is None:
            return None
        loaded = load_protocol(self.protocol)
        if self.seed is None:
            return loaded
        return replace(loaded, keys=loaded.keys.model_copy(update={"data_seed": self.seed}))
