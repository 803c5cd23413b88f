"""A TacTip that was pressed in 3-D finite elements: it has the shipped scenes and no others."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.reference_frames.scenes import RADIUS_MM, ReferenceScene, shipped_file
from tactibench_sim.rendered_sensor import RenderedSensor
from tactibench_sim.sensor import SimulatedTacTip, TacTip127, TacTip331

Array = npt.NDArray[np.float64]
_SAME = 1e-9  # by which the cosine of equal directions may be off
NAMES = {1: "single", 2: "dual", 3: "triple"}
_ALONG_NORMAL = re.compile(r"(s\d+)_[\d.]+")
"""Scenes s20_1, s20_2 ... are one tip that moves along the skin's normal."""


class ReferenceTacTip(RenderedSensor):
    """The camera, pins and noise of a nominal TacTip; finite elements say where its pins are."""

    nominal: type[SimulatedTacTip]

    def __init__(
        self,
        context: SensorContext,
        *,
        instance: int = 0,
        table: str = "",
        pin_length: float | None = None,
        threads: int | None = None,
        **optical: Any,
    ) -> None:
        """Build the nominal sensor.

        Args:
            context: The seed of the noise.
            instance: Must be 0: the scenes are of the nominal dome.
            table: Must be "", likewise.
            pin_length: Length of the pins, mm; None: the nominal sensor's.
            threads: Number of threads of ``press_many``; None: ``thread_count()``.
            **optical: Parameters of the camera.

        Raises:
            UserError: ``instance`` or ``table`` is given, which would be another dome.
        """
        if instance or table:
            given = f"instance={instance}" if instance else f"table={table}"
            raise UserError(
                f"the finite-element scenes are of the nominal dome, and sensor.{given} is "
                "another; train on the nominal one, or leave --test reference out."
            )
        self._sensor = self.nominal(context, pin_length=pin_length, **optical)
        self._reference = shipped_file()
        self._scenes = {scene.label: scene_of(scene) for scene in self._reference.scenes}
        self._fields = dict(zip(self._scenes.values(), self._reference.scenes, strict=True))
        resting = (self._sensor.mechanics.inner - self._sensor.pin_length) * self._sensor.directions
        super().__init__(context, self._sensor.renderer, resting, threads)

    def scenes(self) -> dict[str, Scene]:
        """Return the scenes that ship by their labels, such as "p7_eq at 2 mm"."""
        return dict(self._scenes)

    def presses(self) -> dict[str, str]:
        """Return the run of each scene: an indenter pressed deeper and deeper is one press."""
        return {scene.label: press_of(scene) for scene in self._reference.scenes}

    def points(self, scenes: Sequence[Scene]) -> Array:
        """Return the (S, P, 3) pin tips from the dome's centre, mm.

        Raises:
            UserError: A scene is none of those that ship.
        """
        return np.stack([reference_tips(self._sensor, self._field(scene)) for scene in scenes])

    def _field(self, scene: Scene) -> ReferenceScene:
        if scene not in self._fields:
            raise UserError(
                f"the sensor has the {len(self._fields)} finite-element scenes that ship and can "
                "press no others; test on it with --test reference."
            )
        return self._fields[scene]

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        nominal = self._sensor.describe()
        for name in ("tier", "tables"):
            del nominal[name]
        return {
            **nominal,
            "sensor": f"{nominal['sensor']}-fem",
            "reference": {**self._reference.parameters, "sha256": self._reference.digest},
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
            "the sensor has pins where the reference scenes have none; take version 1 of "
            "tactip-127 or tactip-331."
        )
    base = sensor.mechanics.inner * scene.directions[pin] + scene.displacement[pin]
    tips: Array = base - sensor.pin_length * scene.normals[pin]
    return tips


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
