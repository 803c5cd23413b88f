"""A TacTip that was pressed in 3-D finite elements: it has the shipped scenes and no others.

The file that ships holds, for every run, the tips and the displacement of the pin bases and the
outward normals of the inner skin there at a few depths. Reading it needs no finite elements. A
sensor with friction has the runs with friction, each with its own coefficient, whatever that of the
sensor is; a sensor with ``friction=0`` has the others.

The frictionless runs were read off where earlier sensors had their pins. At the pins of today's
sensors the field is that of the tables plus what they leave of the runs, which is smooth and was
interpolated (scripts/fem/gather_scenes.py): right to .001 mm in the median, to .017 mm in 99 % of
all pins and scenes, by leaving pins out.

Isolated tips (names s20_...: 20 deg from the apex) come from the runs from which the tables'
corrections for the rim were made: they tell how well a tier keeps these runs, not how well it
predicts others.

The runs have their own error. A single contact at the apex, computed with the same elements of
1.2 mm edge, differs from the axisymmetric table (elements of 0.08 mm) by at most 0.011 mm at 3 mm
depth and 0.025 mm at 6 mm, by 0.004 and 0.009 mm in the median. The meshes of the runs, 1 mm at the
tips, break the symmetries of equal pairs and triples by at most 0.015 mm to 6 mm depth; those of
the runs with friction are finer, 0.6 mm. Normals are differences over 0.46 mm and see the elements'
edges: they break those symmetries by up to 2 deg, by 0.2 deg in the median.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.contact import Tips
from tactibench_sim.sensor import SimulatedSensor
from tactibench_sim.tables import RADIUS_MM, TableFile, shipped_file
from tactibench_sim.tactip import SimulatedTacTip, TacTip127, TacTip331

Array = npt.NDArray[np.float64]
FILE = "scenes.npz"
STEP_MM = 0.25e-3
"""Displacements are rounded to this, to fit 16 bits up to 8 mm."""
STEP_NORMAL = 1e-4
"""Normals are rounded to this, to fit 16 bits."""
_SAME = 1e-9  # by which the cosine of equal directions may be off
NAMES = {1: "single", 2: "dual", 3: "triple"}
_ALONG_NORMAL = re.compile(r"(s\d+)_[\d.]+")
"""Scenes s20_1, s20_2 ... are one tip that moves along the skin's normal."""


@dataclass(frozen=True, eq=False)
class ReferenceScene:
    """One press and its field.

    P counts the pins of the patterns with 331 and 127 pins in order, or of the latter alone.

    Attributes:
        name: Name of the run; its scenes differ in depth.
        tips: (K, 3) x, y of the tips' axes and depth past first touch, mm.
        directions: (P, 3) directions of the pins at rest.
        displacement: (P, 3) displacements of their bases, mm.
        normals: (P, 3) outward normals of the pressed inner skin there, or NaN.
        radius: Radius of the tips, mm; inf for a plate.
        friction: Coulomb's coefficient between tips and skin.
    """

    name: str
    tips: Array
    directions: Array
    displacement: Array
    normals: Array
    radius: float = RADIUS_MM
    friction: float = 0.0

    @cached_property
    def depth(self) -> float:
        """Depth of the deepest tip, mm."""
        return float(self.tips[:, 2].max())

    @property
    def label(self) -> str:
        """Name with the depth."""
        return f"{self.name} at {self.depth:.3g} mm"

    @property
    def as_tips(self) -> Tips:
        """The scene as mechanics take it: S = 1."""
        rub = np.array([self.friction]) if self.friction else None
        radius = np.array([self.radius])
        return Tips(self.tips[None, :, :2], self.tips[None, :, 2], radius, friction=rub)


@cache
def reference_scenes(file: TableFile | None = None) -> tuple[ReferenceScene, ...]:
    """Return the scenes of a file, run by run and by depth; None: of the one that ships."""
    file = file or shipped_file(FILE)
    scenes: list[ReferenceScene] = []
    radius, friction = (file.parameters.get(name, {}) for name in ("radius", "friction"))
    for name in file.parameters["runs"]:
        rub = friction.get(name, 0.0)
        scenes += _scenes(name, file.arrays, radius.get(name, RADIUS_MM), rub)
    return tuple(scenes)


def _scenes(
    name: str, content: Mapping[str, Array], radius: float, friction: float
) -> list[ReferenceScene]:
    """Return the scenes of a run.

    A file holds (P, 3) ``directions`` and for each run the (D, K, 3) ``tips``, x, y and depth, mm,
    the (D, P, 3) displacements ``u`` in units of STEP_MM, and the normals in those of STEP_NORMAL.
    """
    tips, moved = content[f"{name}_tips"], content[f"{name}_u"] * STEP_MM
    normals = np.full(moved.shape, np.nan)
    if f"{name}_normal" in content:
        normals = content[f"{name}_normal"] * STEP_NORMAL
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    at = content["directions"]
    return [
        ReferenceScene(name, tip, at, u, normal, radius, friction)
        for tip, u, normal in zip(tips, moved, normals, strict=True)
    ]


class ReferenceTacTip(SimulatedSensor):
    """The camera, pins and noise of a nominal TacTip; finite elements say where its pins are."""

    nominal: ClassVar[type[SimulatedTacTip]]
    nuisances = ()  # between the scenes nothing is known

    def __init__(
        self,
        context: SensorContext,
        *,
        instance: int = 0,
        table: str = "",
        **parameters: Any,
    ) -> None:
        """Build the nominal sensor.

        Args:
            context: The seed of the noise.
            instance: Must be 0: the scenes are of the nominal dome.
            table: Must be "", likewise.
            **parameters: Length of the pins, friction and parameters of the camera.

        Raises:
            UserError: ``instance`` or ``table`` is given, which would be another dome.
        """
        if instance or table:
            given = f"instance={instance}" if instance else f"table={table}"
            raise UserError(
                f"the finite-element scenes are of the nominal dome, and sensor.{given} is "
                "another; train on the nominal one, or leave --test reference out."
            )
        self._sensor = self.nominal(context, **parameters)
        rubs = bool(self._sensor.friction)
        references = [one for one in reference_scenes() if bool(one.friction) == rubs]
        self._scenes = {scene.label: scene_of(scene) for scene in references}
        self._fields = dict(zip(self._scenes.values(), references, strict=True))
        resting = (self._sensor.mechanics.inner - self._sensor.pin_length) * self._sensor.directions
        super().__init__(context, self._sensor.renderer, resting)

    def scenes(self) -> dict[str, Scene]:
        """Return the scenes that ship by their labels, such as "p7_eq at 2 mm"."""
        return dict(self._scenes)

    def presses(self) -> dict[str, str]:
        """Return the run of each scene: an indenter pressed deeper and deeper is one press."""
        return {scene.label: press_of(scene) for scene in self._fields.values()}

    def points(self, scenes: Sequence[Scene]) -> Array:
        """Return the (S, P, 3) pin tips from the dome's centre, mm.

        Raises:
            UserError: A scene is none of those that ship.
        """
        return np.stack([reference_tips(self._sensor, self._field(scene)) for scene in scenes])

    def _field(self, scene: Scene) -> ReferenceScene:
        if scene not in self._fields:
            rubs = "with" if self._sensor.friction else "without"
            raise UserError(
                f"the sensor has the {len(self._fields)} finite-element scenes {rubs} friction "
                "that ship and can press no others; test on it with --test reference."
            )
        return self._fields[scene]

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        nominal, file = self._sensor.describe(), shipped_file(FILE)
        for name in ("tier", "tables"):
            del nominal[name]
        return {
            **nominal,
            "sensor": f"{nominal['sensor']}-fem",
            "reference": {**file.parameters, "sha256": file.digest},
        }


class Reference127(ReferenceTacTip):
    """The TacTip with 127 pins in a hexagon, by finite elements."""

    nominal = TacTip127


class Reference331(ReferenceTacTip):
    """The TacTip with 331 pins in ten rings, by finite elements."""

    nominal = TacTip331


def reference_tips(sensor: SimulatedTacTip, scene: ReferenceScene) -> Array:
    """Return the (P, 3) tips of a sensor's pins in a reference scene, from the centre, mm.

    Raises:
        UserError: The sensor has pins where the scene has none.
    """
    along = sensor.directions @ scene.directions.T
    pin = along.argmax(axis=1)
    if (along[np.arange(len(pin)), pin] < 1 - _SAME).any():
        raise UserError(
            "the sensor has pins where the reference scenes have none; take tactip-127 or "
            "tactip-331."
        )
    base = sensor.mechanics.inner * scene.directions[pin] + scene.displacement[pin]
    return np.asarray(base - sensor.pin_length * scene.normals[pin])


def scene_of(reference: ReferenceScene) -> Scene:
    """Return the scene as a rigid indenter that brings every tip to its depth.

    Tip k touches first at the height h_k = sqrt((R_d + R)^2 - rho_k^2). So it reaches further by
    d_k - h_k, up to a constant.
    """
    xy, depth = reference.tips[:, :2], reference.tips[:, 2]
    reach = depth - np.sqrt((DOME_RADIUS_MM + RADIUS_MM) ** 2 - (xy**2).sum(axis=1))
    middle = xy.mean(axis=0)
    offsets = np.column_stack([xy - middle, reach - reach.min()])
    indenter = Indenter(RADIUS_MM, tuple(map(tuple, offsets.tolist())), NAMES[len(xy)])
    x, y = middle.tolist()
    return Scene(indenter, Pose(x, y, 0.0, 0.0, float(depth.max())))


def press_of(reference: ReferenceScene) -> str:
    """Return the name of the press that a scene is a moment of."""
    match = _ALONG_NORMAL.fullmatch(reference.name)
    return match[1] if match else reference.name
