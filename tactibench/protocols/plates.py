"""Drawing plate presses for a sensor that makes its own frames."""

from __future__ import annotations

import numpy as np

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.protocols.draws import Drawn
from tactibench.protocols.schema import Plates, Protocol


def draw_plates(keys: Protocol, plates: Plates) -> Drawn:
    """All training presses: the same for equal keys and data seed, on every machine."""
    seed = np.random.SeedSequence(keys.data_seed, spawn_key=(plates.stream,))
    rng = np.random.default_rng(seed)
    space = keys.workspace
    depth = rng.uniform(space.depth_min_mm, space.depth_max_mm, plates.count)
    tilt = rng.uniform(-plates.tilt_deg, plates.tilt_deg, plates.count)
    return Drawn(
        tuple(
            Scene(Indenter.plate(), Pose(yaw=plates.yaw_deg, tilt=t, depth=d))
            for d, t in zip(depth.tolist(), tilt.tolist(), strict=True)
        ),
        0,
    )


def draw_shots(keys: Protocol, pool: int) -> tuple[int, ...]:
    """Numbers of the labelled frames among ``pool`` frames, in an order of which the first k are
    given for k shots. Empty where the protocol transfers nothing."""
    if keys.transfer is None:
        return ()
    seed = np.random.SeedSequence(keys.data_seed, spawn_key=(keys.transfer.stream,))
    order = np.random.default_rng(seed).permutation(pool)
    return tuple(order[: max(keys.transfer.shots)].tolist())
