"""What 3-D finite elements say of one to three tips: the scenes that tiers are judged by.

The file that ships holds, for every run, the tips and the displacement of the pin bases and the
outward normals of the inner skin there at a few depths. Reading it needs no finite elements.

Isolated tips (names s20_...: 20 deg from the apex) come from the runs that the tables' corrections
for the rim are made of: they tell how well a tier keeps these, not how well it foresees others.

The runs have their own error. A single contact at the apex, computed with the same elements of
1.2 mm edge, differs from the axisymmetric table (elements of 0.08 mm) by at most 0.011 mm at 3 mm
depth and 0.025 mm at 6 mm, by 0.004 and 0.009 mm in the median. The meshes of the runs, 1 mm at the
tips, break the symmetries of equal pairs and triples by at most 0.015 mm to 6 mm depth. Normals are
differences over 0.46 mm and see the elements' edges: they break those symmetries by up to 2 deg, by
0.2 deg in the median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from tactibench import Contacts, UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim import sealed
from tactibench_sim.contact import Tips
from tactibench_sim.pins import layout

Array = npt.NDArray[np.float64]
FILE = "scenes.npz"
RADIUS_MM = 3.0
LAYOUTS = (331, 127)
"""Pins of the patterns whose directions follow each other in every scene."""
STEP_MM = 0.25e-3
"""Displacements are rounded to this, to fit 16 bits up to 8 mm."""
STEP_NORMAL = 1e-4
PARAMETERS = {
    "dome": {"outer": 20.0, "skin": 1.0, "stiffness_ratio": 50.0, "penalty": 60.0},
    "indenter": {"radius": RADIUS_MM, "shape": "rod with a spherical end, moved along -z"},
    "mesh": {
        "elements": "tetrahedra, geometry of order 2",
        "near_tips": 1.0,
        "near_within": 6.0,
        "elsewhere": 4.0,
        "grading": 0.3,
    },
    "elements": "displacement order 2, pressure order 1 (one for skin, one for gel)",
    "material": "neo-Hooke, exactly incompressible",
    "contact": "frictionless penalty, smoothed over 0.01 mm",
    "newton_mm": 1e-3,
    "isolated": {
        "near_tips": 1.2,
        "elsewhere": 4.5,
        "moved": "along the normal of the skin, axis of the rod likewise",
        "read": "off a chart of 2.5 deg with cubic splines",
    },
}
"""Of the runs; lengths mm, moduli in units of the skin's."""
_RESTING_DEG = 0.6
"""By which a mm of depth turns, at most, normals 45 deg away (seen: 0.45)."""


@dataclass(frozen=True, eq=False)
class ReferenceScene:
    """One press and its field.

    name: of the run; its scenes differ in depth. tips: (K, 3) x, y of the tips' axes and depth past
    first touch, mm. directions: (P, 3) of the pins at rest. displacement: (P, 3) of their bases,
    mm. normals: (P, 3) outward, of the pressed inner skin. P: the patterns of LAYOUTS in order.
    """

    name: str
    tips: Array
    directions: Array
    displacement: Array
    normals: Array

    @cached_property
    def depth(self) -> float:
        """Of the deepest tip, mm."""
        return float(self.tips[:, 2].max())

    @property
    def label(self) -> str:
        return f"{self.name} at {self.depth:.3g} mm"

    @property
    def on_apex(self) -> bool:
        """Do the tips stand around the apex?"""
        return bool((abs(self.tips[:, :2].mean(axis=0)) < 1e-6).all())

    @property
    def equal(self) -> bool:
        """Are all tips pressed to one depth?"""
        return bool(np.ptp(self.tips[:, 2]) < 1e-9)

    @property
    def contacts(self) -> Contacts:
        return Contacts.truth(self.tips[:, :2], self.tips[:, 2])

    @property
    def asked(self) -> Tips:
        """The scene as mechanics take it: S = 1."""
        return Tips(self.tips[None, :, :2], self.tips[None, :, 2], np.array([RADIUS_MM]))


@dataclass(frozen=True, eq=False)
class Reference:
    """A file's scenes, run by run and by depth. parameters: of the runs. digest: sha256."""

    scenes: tuple[ReferenceScene, ...]
    parameters: dict[str, Any]
    digest: str


@cache
def shipped_file() -> Reference:
    """The file that ships with the package."""
    with as_file(files(__package__).joinpath(FILE)) as path:
        return read(path)


def shipped() -> tuple[ReferenceScene, ...]:
    """The scenes that ship with the package."""
    return shipped_file().scenes


def read(path: Path) -> Reference:
    """Read a file of scenes. Raises UserError where it is unreadable or its hash does not fit."""
    return sealed.read(path, "the file of reference scenes", "reinstall tactibench.", _reference)


def _reference(arrays: sealed.Arrays, parameters: dict[str, Any], digest: str) -> Reference:
    scenes = [one for name in parameters["runs"] for one in _scenes(name, arrays)]
    return Reference(tuple(scenes), parameters, digest)


def pack(paths: Sequence[Path], out: Path | None = None) -> str:
    """Make the file (``out``; None: the one that ships) from runs, and return its sha256.

    A run is an npz: ``d`` (D,) mm; ``tips`` (K, 3) x, y and share of d; ``sym`` true where every
    tip with y > 0 has its mirror image; ``pu``, ``pn`` (D, P, 3) displacement and normal at the
    pins of ``layout``, in the order of LAYOUTS. Raises UserError for runs that are not that.
    """
    if not paths:
        raise UserError("there are no runs to pack; give their npz files.")
    directions = np.concatenate([layout(pins) for pins in LAYOUTS])
    arrays: dict[str, npt.NDArray[Any]] = {"directions": directions}
    runs = []
    for path in sorted(paths):
        name = path.stem.removeprefix("val_")
        packed = _packed(path, _run(path), directions)
        arrays |= {f"{name}_{key}": array for key, array in packed.items()}
        runs.append(name)
    parameters = {**PARAMETERS, "runs": runs, "solver": f"ngsolve {_solver()}"}
    return sealed.write(out or Path(str(files(__package__).joinpath(FILE))), arrays, parameters)


def _run(path: Path) -> dict[str, npt.NDArray[Any]]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in ("d", "tips", "sym", "pu", "pn")}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UserError(
            f"the run {path} cannot be read ({type(error).__name__}); leave it out, or wait until "
            "it is written."
        ) from None


def _packed(
    path: Path, run: Mapping[str, npt.NDArray[Any]], directions: Array
) -> dict[str, npt.NDArray[Any]]:
    u, normals, depth = run["pu"], run["pn"], np.asarray(run["d"], dtype=np.float64)
    wanted = (len(depth), *directions.shape)
    if u.shape != wanted or normals.shape != wanted:
        raise UserError(
            f"{path} has displacements {u.shape} and normals {normals.shape}; "
            f"they must be {wanted}."
        )
    if not (np.isfinite(u).all() and np.isfinite(normals).all()):
        raise UserError(f"{path} holds a value that is not finite; run it again.")
    if abs(u).max() > 32767 * STEP_MM:
        raise UserError(f"{path} moves a pin by {abs(u).max():g} mm, more than the file can hold.")
    tips = np.asarray(run["tips"], dtype=np.float64)
    if run["sym"]:
        tips = np.concatenate([tips, tips[tips[:, 1] > 1e-9] * (1.0, -1.0, 1.0)])
        u, normals = _in_the_plane(u, directions), _in_the_plane(normals, directions)
    turned = _turned_far_away(tips, directions, normals[0])
    if turned > _RESTING_DEG * depth[0]:
        raise UserError(
            f"{path} has normals {turned:.2f} deg off at pins far from its tips; it was made for "
            "other pins than those of `layout`, so run it again."
        )
    return {
        "tips": tips,
        "depth": depth,
        "u": np.rint(u / STEP_MM).astype(np.int16),
        "normal": np.rint(normals / STEP_NORMAL).astype(np.int16),
    }


def _turned_far_away(tips: Array, directions: Array, normals: Array) -> float:
    """Largest turn, deg, of normals more than 45 deg from every tip."""
    at = np.concatenate([tips[:, :2], np.zeros((len(tips), 1))], axis=1)
    at[:, 2] = np.sqrt((DOME_RADIUS_MM + RADIUS_MM) ** 2 - (at**2).sum(axis=1))
    along = directions @ at.T / (DOME_RADIUS_MM + RADIUS_MM)
    far = along.max(axis=1) < np.cos(np.pi / 4)
    turned: Array = np.degrees(np.linalg.norm(normals - directions, axis=1))
    return float(turned[far].max())


def _in_the_plane(vectors: Array, directions: Array) -> Array:
    """Vectors of pins in the plane of symmetry y = 0 without their y: there is none.

    A run sees one side of the plane only, so that its differences across it are one-sided.
    """
    out: Array = vectors.copy()
    out[:, abs(directions[:, 1]) < 1e-9, 1] = 0.0
    return out


def _scenes(name: str, content: Mapping[str, npt.NDArray[Any]]) -> list[ReferenceScene]:
    tips, normals = content[f"{name}_tips"], content[f"{name}_normal"] * STEP_NORMAL
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    found = []
    for depth, u, normal in zip(
        content[f"{name}_depth"], content[f"{name}_u"] * STEP_MM, normals, strict=True
    ):
        scene = ReferenceScene(name, tips * (1.0, 1.0, depth), content["directions"], u, normal)
        for array in (scene.tips, scene.directions, scene.displacement, scene.normals):
            array.setflags(write=False)
        found.append(scene)
    return found


def _solver() -> str:
    try:
        return version("ngsolve")
    except PackageNotFoundError:
        return "of an unknown version"
