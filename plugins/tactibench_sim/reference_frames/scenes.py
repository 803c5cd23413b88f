"""Displacement fields of one to three tips by 3-D finite elements: the scenes that judge tiers.

The file that ships holds, for every run, the tips and the displacement of the pin bases and the
outward normals of the inner skin there at a few depths. Reading it needs no finite elements.

Isolated tips (names s20_...: 20 deg from the apex) come from the runs from which the tables'
corrections for the rim were made: they tell how well a tier keeps these runs, not how well it
predicts others.

The runs have their own error. A single contact at the apex, computed with the same elements of
1.2 mm edge, differs from the axisymmetric table (elements of 0.08 mm) by at most 0.011 mm at 3 mm
depth and 0.025 mm at 6 mm, by 0.004 and 0.009 mm in the median. The meshes of the runs, 1 mm at the
tips, break the symmetries of equal pairs and triples by at most 0.015 mm to 6 mm depth. Normals are
differences over 0.46 mm and see the elements' edges: they break those symmetries by up to 2 deg, by
0.2 deg in the median.

Tips of other radii than 3 mm have a file of their own (scripts/fem/press_other_tips.py), at the 127
pins of one pattern and without normals. No table was made from its runs. Tips and plates that moved
sideways and dragged the skin have a file of their own, too (scripts/fem/press_sideways.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench_sim import data_file
from tactibench_sim.mechanics.contact import Tips
from tactibench_sim.pins import layout

Array = npt.NDArray[np.float64]
FILE, OTHER_TIPS, SIDEWAYS = "scenes.npz", "other_tips.npz", "sideways.npz"
RADIUS_MM = 3.0
"""Radius of the tips of FILE."""
LAYOUTS = (331, 127)
"""Numbers of pins of the patterns, whose directions follow each other in every scene."""
STEP_MM = 0.25e-3
"""Displacements are rounded to this, to fit 16 bits up to 8 mm."""
STEP_NORMAL = 1e-4
"""Normals are rounded to this, to fit 16 bits."""


@dataclass(frozen=True, eq=False)
class ReferenceScene:
    """One press and its field.

    P counts the pins of the patterns of LAYOUTS in order, or of the last of them.

    Attributes:
        name: Name of the run; its scenes differ in depth.
        tips: (K, 3) x, y of the tips' axes and depth past first touch, mm.
        directions: (P, 3) directions of the pins at rest.
        displacement: (P, 3) displacements of their bases, mm.
        normals: (P, 3) outward normals of the pressed inner skin there, or NaN.
        radius: Radius of the tips, mm; inf for a plate.
        friction: Coulomb's coefficient.
        move: Way sideways after first touch, to where the tips are, mm.
    """

    name: str
    tips: Array
    directions: Array
    displacement: Array
    normals: Array
    radius: float = RADIUS_MM
    friction: float = 0.0
    move: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def depth(self) -> float:
        """Depth of the deepest tip, mm."""
        return float(self.tips[:, 2].max())

    @property
    def spacing(self) -> float:
        """Distance between the axes of the nearest two tips, mm; NaN for a single one."""
        apart = [math.dist(a[:2], b[:2]) for a, b in combinations(self.tips, 2)]
        return min(apart, default=math.nan)

    @property
    def label(self) -> str:
        """Name with the depth."""
        return f"{self.name} at {self.depth:.3g} mm"

    @property
    def on_apex(self) -> bool:
        """True where the tips stand around the apex."""
        return bool((abs(self.tips[:, :2].mean(axis=0)) < 1e-6).all())

    @property
    def equal(self) -> bool:
        """True where all tips are pressed to one depth."""
        return bool(np.ptp(self.tips[:, 2]) < 1e-9)

    @property
    def as_tips(self) -> Tips:
        """The scene as mechanics take it: S = 1."""
        move = np.tile(self.move, (1, len(self.tips), 1)) if self.friction else None
        return Tips(self.tips[None, :, :2], self.tips[None, :, 2], np.array([self.radius]), move)


@dataclass(frozen=True, eq=False)
class Reference:
    """The content of a file of scenes.

    Attributes:
        scenes: The scenes, run by run and by depth.
        parameters: Parameters of the runs.
        digest: sha256 of the file's content.
    """

    scenes: tuple[ReferenceScene, ...]
    parameters: dict[str, Any]
    digest: str


def _reference(arrays: data_file.Arrays, parameters: dict[str, Any], digest: str) -> Reference:
    if "move" in arrays:
        return Reference(tuple(_slides(arrays)), parameters, digest)
    radius = parameters.get("radius", {})
    scenes = [
        scene
        for name in parameters["runs"]
        for scene in _scenes(name, arrays, radius.get(name, RADIUS_MM))
    ]
    return Reference(tuple(scenes), parameters, digest)


def _slides(arrays: data_file.Arrays) -> Iterator[ReferenceScene]:
    """Yield the scenes of dragged skin, one for each state."""
    pins = layout(LAYOUTS[-1])
    for k, radius in enumerate(arrays["radius"]):
        exists = np.isfinite(arrays["depth"][k])
        tips = np.column_stack([arrays["xy"][k], arrays["depth"][k]])[exists]
        u = arrays["u"][k].astype(np.float64)
        x, y = arrays["move"][k].tolist()
        unknown, friction = np.full(u.shape, np.nan), float(arrays["friction"][k])
        yield ReferenceScene(f"drag{k}", tips, pins, u, unknown, float(radius), friction, (x, y))


def _scenes(
    name: str, content: Mapping[str, npt.NDArray[Any]], radius: float
) -> list[ReferenceScene]:
    tips, moved = content[f"{name}_tips"], content[f"{name}_u"] * STEP_MM
    normals = np.full(moved.shape, np.nan)
    if f"{name}_normal" in content:
        normals = content[f"{name}_normal"] * STEP_NORMAL
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    scenes = []
    for depth, u, normal in zip(content[f"{name}_depth"], moved, normals, strict=True):
        at = tips * (1.0, 1.0, depth)
        scene = ReferenceScene(name, at, content["directions"], u, normal, radius)
        for array in (scene.tips, scene.directions, scene.displacement, scene.normals):
            array.setflags(write=False)
        scenes.append(scene)
    return scenes


DATA, DATA_OTHER_TIPS, DATA_SIDEWAYS = (
    data_file.DataFile(__package__, name, "the file of reference scenes", _reference)
    for name in (FILE, OTHER_TIPS, SIDEWAYS)
)
read, shipped_file = DATA.read, DATA.shipped
shipped_other_tips, shipped_sideways = DATA_OTHER_TIPS.shipped, DATA_SIDEWAYS.shipped


def shipped() -> tuple[ReferenceScene, ...]:
    """Return the scenes of R = 3 mm that ship with the package."""
    return shipped_file().scenes
