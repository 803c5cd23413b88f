"""Finite-element scenes that made no table: other radii, other domes, tips that moved sideways."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactibench_sim import Tips, read_file, reference_scenes

FOLDER = Path(__file__).resolve().parents[1] / "sim" / "data"
INSTANCES = read_file(FOLDER / "instances.npz")
OTHER_TIPS = reference_scenes(read_file(FOLDER / "other_tips.npz"))


@dataclass(frozen=True, eq=False)
class Slide:
    """Tips that were pressed and moved sideways, and what they did to the 127 pin bases.

    Attributes:
        tips: One scene.
        friction: Coulomb's coefficient.
        displacement: (127, 3) mm.
    """

    tips: Tips
    friction: float
    displacement: np.ndarray


def slides():
    """Return the scenes of sideways.npz."""
    rows = read_file(FOLDER / "sideways.npz").arrays
    out = []
    for k, radius in enumerate(rows["radius"]):
        exists = np.isfinite(rows["depth"][k])
        move = np.tile(rows["move"][k], (1, exists.sum(), 1))
        xy, depth = rows["xy"][k][exists][None], rows["depth"][k][exists][None]
        tips = Tips(xy, depth, np.array([radius]), move)
        out.append(Slide(tips, float(rows["friction"][k]), rows["u"][k]))
    return out
