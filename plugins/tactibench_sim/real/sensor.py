"""Simulated TacTips whose camera, pins and plate drag were fitted to real presses.

Version 2 has pictures like the real ones: the white tips are as large at rest as in the real rest
frame, and a pin that is pressed towards the camera is seen larger. In version 1 all tips are of one
size, and a plate never changes the size of the discs.

What the labels do not say is drawn at random for every press of a plate: whether it drags the skin
along and how far, and with ``spread`` which sensor instance is pressed. All instances have the same
pins at rest. Spherical tips press as on the nominal dome.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tactibench import Scene, SensorContext, UserError
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.contact import tips_of
from tactibench_sim.mechanics.dome import TableMechanics
from tactibench_sim.optics.camera import optics_from
from tactibench_sim.optics.lens import project
from tactibench_sim.optics.noise import streams
from tactibench_sim.optics.renderer import Renderer
from tactibench_sim.pins import places_at_rest
from tactibench_sim.real import plate
from tactibench_sim.real.calibration import Calibration, Unknowns
from tactibench_sim.real.calibration import calibration as fit_of
from tactibench_sim.real.plate import APEX_MM, INNER_MM, Labels, Rig, changes, directions
from tactibench_sim.rendered_sensor import RenderedSensor
from tactibench_sim.sensor import TACTIP_127_FITTED, TACTIP_331_FITTED, Preset

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

STEEPEST_DEG = 45.0
"""Largest tilt of a plate, either way."""
VERSIONS = (1, 2)
_INSTANCES, _PRESSES = 7, 8
"""Streams of random numbers, beside that of the camera's noise."""
_MARKER_MM = {127: 0.36, 331: 0.47}
"""Radius of the white tips, as in the presets of ``sensor``."""


@dataclass(frozen=True)
class Spread:
    """Half-widths of the instances' ranges around the calibration at ``spread`` 1 (assumed).

    Attributes:
        yaw_deg: Turn of the camera.
        pin_length_mm: Effective lever of the pins.
        gel_mm: Distance from the window to the apex.
        air_share: Distance from the camera to the window, as a share of the calibrated one.
        focal_share: Focal length, likewise.
    """

    yaw_deg: float = 2.0
    pin_length_mm: float = 0.2
    gel_mm: float = 1.0
    air_share: float = 0.2
    focal_share: float = 0.05


class FittedSensor(RenderedSensor):
    """A TacTip that plates press: depth is the indentation along the plate's normal.

    A plate's yaw is the direction on the frame in which a positive tilt moves the contact; 90:
    down.
    """

    pins = 331
    preset: ClassVar[Preset] = TACTIP_331_FITTED

    def __init__(
        self,
        context: SensorContext,
        size: int = 256,
        drag: float = 5.0,
        dragged: float = 0.6,
        spread: float = 0.0,
        individuals: int = 16,
        calibration: str = "",
        version: int = 1,
        threads: int | None = None,
        **optical: Any,
    ) -> None:
        """Read the calibration and draw the sensor instances.

        Args:
            context: The seed of the noise and of what is drawn for each press.
            size: Side of the frames, px.
            drag: Half the range of a plate's sideways travel, mm.
            dragged: Share of the presses in which the plate takes the skin along.
            spread: Width of the instances' ranges; 0: the calibrated sensor alone.
            individuals: Number of sensor instances, where spread is not 0.
            calibration: Name of a fit that ships (``calibration.SHIPPED``), or path of a file of
                `sim real --keep`.
            version: Version of the pictures, 1 or 2.
            threads: Number of threads of ``press_many``; None: ``thread_count()``.
            **optical: Parameters of ``optics_from``: format of the frames, and glare.

        Raises:
            UserError: ``version`` is neither 1 nor 2, or ``calibration`` is no calibration or is of
                a dome without tables.
        """
        if version not in VERSIONS:
            raise UserError(f"fitted-{self.pins} has no version {version}; take 1 or 2.")
        fitted = fit_of(calibration)
        if fitted.kind not in plate.kinds():
            raise UserError(
                f"the calibration is of a dome {fitted.kind!r}, but there are tables of "
                f"{', '.join(plate.kinds())}; make it again with `tactibench sim real`."
            )
        self.calibration, self.size = fitted, size
        self.version = version
        self.drag, self.dragged, self.spread = drag, dragged, spread
        self.individuals = individuals if spread else 1
        scale = size / fitted.side
        nominal = _as_indentation(fitted, scale)
        rest = size * places_at_rest(self.pins) + scale * np.array(fitted.rest_centre)
        self.rig = Rig(plate.plate(fitted.kind), rest, size)
        optics = replace(self.rig.optics(nominal), marker_radius_mm=_MARKER_MM[self.pins])
        if version > 1:
            optics = replace(optics, threshold_grey=self.preset.optics.threshold_grey)
        optics, lift = optics_from(optics, optical), optics.camera_distance_mm - APEX_MM
        renderer = Renderer(optics, lift)
        self._pins, self._length = directions(self.rig, nominal), nominal.pin_length_mm
        tips = (INNER_MM - self._length) * self._pins
        if version > 1:
            alike = renderer.project(tips[None])[2][0]
            renderer = Renderer(optics, lift, _rest_radii(self.preset, size) / alike)
        super().__init__(context, renderer, tips, threads)
        self._discs = np.stack([axis[0] for axis in renderer.project(tips[None])])
        self._unknowns = self._instances(nominal)

    @cached_property
    def mechanics(self) -> TableMechanics:
        """Mechanics of spherical tips, on the nominal dome."""
        return TableMechanics(tables.shipped(), "coupled")

    def points(self, scenes: Sequence[Scene]) -> Array:
        """Return the (S, P, 3) pin tips under spherical tips, mm.

        Under a plate only the places in the frame are known (``moved``).

        Raises:
            UserError: A scene cannot be pressed.
        """
        loads = self.mechanics.loads(tips_of(scenes))
        return self.mechanics.pin_tips(loads, self._pins, self._length)

    def calibrated_on(self) -> Mapping[str, Sequence[str]]:
        """Return the frames of the recording to which camera, pins and drag were fitted."""
        return {self.calibration.recording: self.calibration.frames}

    def moved(self, scenes: Sequence[Scene], first: int = 0) -> Array:
        """Return the (S, P, 2) displacements of the pins in presses by a plate, px.

        Args:
            scenes: S presses by a plate.
            first: Number of the first press, on which the drawn drag and instance depend.

        Raises:
            UserError: A pose is not finite or too steep, or its depth is negative or beyond the
                tables.
        """
        return self._changes(scenes, range(first, first + len(scenes)))[..., :2]

    def _changes(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> Array:
        """Return (S, P, 3): displacements of the pins, px, and the factor on their size."""
        for scene in scenes:
            _refuse(scene, self.rig.plate.deepest)
        drawn = np.array([self._drawn(number) for number in numbers])
        instance = np.minimum((drawn[:, 0] * self.individuals).astype(int), self.individuals - 1)
        yaw = np.array([scene.pose.yaw for scene in scenes])
        depth = np.array([scene.pose.depth for scene in scenes])
        tilt = np.array([scene.pose.tilt for scene in scenes])
        travel = self.drag * (2 * drawn[:, 2] - 1) * (drawn[:, 1] < self.dragged)
        out = np.empty((len(scenes), len(self.rig.rest), 3))
        for number, turn in sorted(set(zip(instance.tolist(), yaw.tolist(), strict=True))):
            rows = np.flatnonzero((instance == number) & (yaw == turn))
            x = self._unknowns[number]
            x = replace(x, yaw_deg=x.yaw_deg + turn)
            labels = Labels(depth[rows], tilt[rows], travel[rows], np.zeros(len(rows)))
            out[rows] = changes(self.rig, x, labels, np.ones(len(rows)))
        out[depth == 0] = 0.0, 0.0, 1.0  # a plate that does not touch drags nothing
        return out

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        return {
            "sensor": f"fitted-{self.pins}",
            "size": self.size,
            "drag_mm": self.drag,
            "dragged": self.dragged,
            "spread": self.spread,
            "individuals": self.individuals,
            "calibration": self.calibration.content(),
            "optics": self.renderer.optics.describe(),
            "tables": {"tips": tables.shipped().digest, "plates": plate.digest()},
            **({"version": self.version} if self.version > 1 else {}),
        }

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        for scene in scenes:
            _refuse_move(scene)
        discs = np.repeat(self._discs[:, None], len(scenes), axis=1)
        plates = [k for k, scene in enumerate(scenes) if scene.indenter.is_plate]
        spheres = [k for k, scene in enumerate(scenes) if not scene.indenter.is_plate]
        if plates:
            pressed = self._changes([scenes[k] for k in plates], [first + k for k in plates])
            x, y, larger = pressed.transpose(2, 0, 1)
            discs[0, plates] += x
            discs[1, plates] += y
            if self.version > 1:
                discs[2, plates] *= larger
        if spheres:
            discs[:, spheres] = self.renderer.project(self.points([scenes[k] for k in spheres]))
        x, y, radius = discs
        return self.renderer.disc_frames(x, y, radius, streams(self._seed, first, len(scenes)))

    def _drawn(self, number: int) -> Array:
        """Return (3,) random numbers in 0..1 of a press: for instance, whether dragged, how far."""
        return self._stream(_PRESSES, number).uniform(size=3)

    def _instances(self, nominal: Unknowns) -> tuple[Unknowns, ...]:
        instances = [nominal]
        widths = Spread()
        for number in range(1, self.individuals):
            yaw, pin, gel, air, focal = self.spread * self._stream(_INSTANCES, number).uniform(
                -1.0, 1.0, 5
            )
            instances.append(
                replace(
                    nominal,
                    yaw_deg=nominal.yaw_deg + widths.yaw_deg * yaw,
                    # As in ``instances.perturb``: a wide spread leaves a tenth of the lever.
                    pin_length_mm=max(
                        nominal.pin_length_mm + widths.pin_length_mm * pin,
                        0.1 * nominal.pin_length_mm,
                    ),
                    gel_mm=nominal.gel_mm + widths.gel_mm * gel,
                    air_mm=nominal.air_mm * (1 + widths.air_share * air),
                    focal_px=nominal.focal_px * (1 + widths.focal_share * focal),
                )
            )
        return tuple(instances)

    def _stream(self, purpose: int, number: int) -> np.random.Generator:
        """Return a random generator.

        Those of instances are the same in every run, those of presses depend on the seed.
        """
        if purpose == _INSTANCES:
            return np.random.default_rng([purpose, number])
        key = (*self._seed.spawn_key, purpose, number)
        return np.random.default_rng(np.random.SeedSequence(self._seed.entropy, spawn_key=key))


class Fitted127(FittedSensor):
    """The fitted TacTip with 127 pins in a hexagon."""

    pins = 127
    preset = TACTIP_127_FITTED


class Fitted331(FittedSensor):
    """The fitted TacTip with 331 pins in ten rings."""


def _rest_radii(preset: Preset, size: int) -> Array:
    """Return the (P,) radii, px, of the white tips at rest, as in the real rest frame."""
    tips = (INNER_MM - preset.pin_length_mm) * preset.layout()
    optics = replace(preset.optics, size=size)
    radius = project(optics, tips, optics.camera_distance_mm - APEX_MM)[2]
    out: Array = radius * preset.tip_shares()
    return out


def _as_indentation(fitted: Calibration, scale: float) -> Unknowns:
    """Return the unknowns for labels that are indentation and tilt.

    Indentation is that of ``Calibration.label_fit``. The yaw that remains is the camera's roll; a
    plate's own yaw is added to it.
    """
    x, labels = fitted.unknowns, fitted.label_fit or fitted.unknowns
    return replace(
        x,
        depth_offset_mm=x.depth_offset_mm - labels.depth_offset_mm,
        pivot_mm=x.pivot_mm - labels.pivot_mm,
        pivot_side_mm=x.pivot_side_mm - labels.pivot_side_mm,
        rest_x=0.0,
        rest_y=0.0,
        yaw_deg=x.yaw_deg - 90.0,
        focal_px=scale * x.focal_px,
        centre_x=scale * x.centre_x,
        centre_y=scale * x.centre_y,
    )


def _refuse_move(scene: Scene) -> None:
    if scene.pose.moved:
        raise UserError(
            "the pose went sideways (dx, dy, dyaw), but fitted sensors draw how far a plate drags "
            "the skin (sensor.drag, sensor.dragged); leave dx, dy and dyaw out, or take a sensor "
            "tactip-127 or tactip-331 with sensor.friction."
        )


def _refuse(scene: Scene, deepest: float) -> None:
    pose = scene.pose
    if not all(map(math.isfinite, (pose.yaw, pose.tilt, pose.depth))):
        raise UserError("the plate's yaw, tilt and depth must be finite.")
    if not 0 <= pose.depth <= deepest:
        raise UserError(
            f"the plate is {pose.depth:g} mm deep; the tables reach from 0 to {deepest:g} mm."
        )
    if abs(pose.tilt) > STEEPEST_DEG:
        raise UserError(
            f"the plate's tilt is {pose.tilt:g} deg; it must be within +-{STEEPEST_DEG:g}."
        )
