"""Simulated TacTips whose camera, pins and plate drag were fitted to real presses.

Pictures are like the real ones: the white tips are as large at rest as in the real rest frame, and
a pin that is pressed towards the camera is seen larger.

What the labels do not say is drawn at random for every press of a plate: whether it drags the skin
along and how far, and with ``spread`` which sensor instance is pressed. All instances have the same
pins at rest. Spherical tips press as on the nominal dome, without friction.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tactibench import Scene, SensorContext, UserError
from tactibench_sim.camera import TACTIPS, optics_from
from tactibench_sim.contact import Tips, check_poses, pose_arrays
from tactibench_sim.dome import TableMechanics
from tactibench_sim.pins import layout, places_at_rest, tip_shares
from tactibench_sim.plates import (
    APEX_MM,
    INNER_MM,
    LabelFit,
    Labels,
    Rig,
    Unknowns,
    changes,
    directions,
    plate_of,
    plates_digest,
)
from tactibench_sim.renderer import Renderer, project, streams
from tactibench_sim.sensor import SimulatedSensor
from tactibench_sim.tables import shipped_dome

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]

STEEPEST_DEG = 45.0
"""Largest tilt of a plate, either way."""
_INSTANCES, _PRESSES = 7, 8
"""Streams of random numbers, beside that of the camera's noise."""


@dataclass(frozen=True)
class Calibration:
    """The fit to a recording. benchmarks/sim_against_real.py writes such files.

    Attributes:
        recording: sha256 of the recording.
        frames: Names of the frames that were fitted to.
        side: Side of the recording's frames, px.
        rest_centre: Mean place of the pins at rest, px.
        kind: Name of the dome: stiffness ratio and friction, "50_stick".
        unknowns: The fitted numbers.
        label_fit: The fit of the labels alone.
    """

    recording: str
    frames: tuple[str, ...]
    side: int
    rest_centre: tuple[float, float]
    kind: str
    unknowns: Unknowns
    label_fit: LabelFit


def calibration_of(pins: int, path: str = "") -> Calibration:
    """Return the fit of a file, or the fit to 400 presses of the public recording with the pins.

    Raises:
        UserError: The file is no calibration.
    """
    shipped = files(__package__) / "data" / f"calibration_{pins}.json"
    try:
        content = json.loads((Path(path) if path else shipped).read_text(encoding="utf-8"))
        content["unknowns"] = Unknowns(**content["unknowns"])
        content["label_fit"] = LabelFit(**content["label_fit"])
        return Calibration(**content)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{path} is no calibration ({type(error).__name__}: {error}); make one with "
            "benchmarks/sim_against_real.py."
        ) from None


@dataclass(frozen=True)
class Widths:
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


class FittedSensor(SimulatedSensor):
    """A TacTip that plates press: depth is the indentation along the plate's normal.

    A plate's yaw is the direction on the frame in which a positive tilt moves the contact; 90:
    down.
    """

    pins: ClassVar[int]
    nuisances = ()  # the drag of a press is drawn, so its frame has no derivatives

    def __init__(
        self,
        context: SensorContext,
        *,
        size: int = 256,
        drag: float = 5.0,
        dragged: float = 0.6,
        spread: float = 0.0,
        individuals: int = 16,
        calibration: str = "",
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
            calibration: Path of a file of benchmarks/sim_against_real.py; "": the fit to the
                public recording with as many pins.
            **optical: Parameters of ``optics_from``: format of the frames, and glare.

        Raises:
            UserError: ``calibration`` is no calibration or is of a dome without tables.
        """
        self.calibration = calibration_of(self.pins, calibration)
        self.size, self.drag, self.dragged, self.spread = size, drag, dragged, spread
        self.individuals = individuals if spread else 1
        scale = size / self.calibration.side
        nominal = _as_indentation(self.calibration, scale)
        rest = size * places_at_rest(self.pins) + scale * np.array(self.calibration.rest_centre)
        self.rig = Rig(plate_of(self.calibration.kind), rest, size)
        preset = TACTIPS[self.pins].optics
        optics = optics_from(
            replace(
                nominal.optics(size),
                marker_radius_mm=preset.marker_radius_mm,
                threshold_grey=preset.threshold_grey,
                glare_width=preset.glare_width,
                glare_arc_deg=preset.glare_arc_deg,
            ),
            optical,
        )
        lift = optics.camera_distance_mm - APEX_MM
        self._pins, self._length = directions(self.rig, nominal), nominal.pin_length_mm
        tips = (INNER_MM - self._length) * self._pins
        alike = Renderer(optics, lift).project(tips[None])[2][0]
        renderer = Renderer(optics, lift, radii_at_rest(self.pins, size) / alike)
        super().__init__(context, renderer, tips)
        self._discs = np.stack([axis[0] for axis in renderer.project(tips[None])])
        self._unknowns = self._instances(nominal)

    @cached_property
    def mechanics(self) -> TableMechanics:
        """Mechanics of spherical tips, on the nominal dome."""
        return TableMechanics(shipped_dome(), "coupled")

    def places(self, tips: Tips) -> Array:
        """Return the (S, P, 3) pin tips under spherical tips, mm.

        Under a plate only the places in the frame are known (``moved``).
        """
        return self.mechanics.pin_tips(self.mechanics.loads(tips), self._pins, self._length)

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
        pose, deepest = pose_arrays(scenes)[1], self.rig.plate.deepest
        check_poses(
            scenes,
            pose,
            (
                pose[:, 4] > deepest,
                f"the plate is {{depth:g}} mm deep; the tables reach from 0 to {deepest:g} mm.",
            ),
            (
                abs(pose[:, 3]) > STEEPEST_DEG,
                f"the plate's tilt is {{tilt:g}} deg; it must be within +-{STEEPEST_DEG:g}.",
            ),
        )
        yaw, tilt, depth = pose[:, 2:5].T
        drawn = np.array([self._drawn(number) for number in numbers])
        instance = np.minimum((drawn[:, 0] * self.individuals).astype(int), self.individuals - 1)
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
            "calibration": asdict(self.calibration),
            "optics": self.renderer.optics.describe(),
            "tables": {"tips": shipped_dome().digest, "plates": plates_digest()},
        }

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        if any(scene.pose.moved for scene in scenes):
            raise UserError(
                "the pose went sideways (dx, dy, dyaw), but fitted sensors draw how far a plate "
                "drags the skin (sensor.drag, sensor.dragged); leave dx, dy and dyaw out, or take "
                "a sensor tactip-127 or tactip-331 with sensor.friction."
            )
        discs = np.repeat(self._discs[:, None], len(scenes), axis=1)
        plates = [k for k, scene in enumerate(scenes) if scene.indenter.is_plate]
        spheres = [k for k, scene in enumerate(scenes) if not scene.indenter.is_plate]
        if plates:
            pressed = self._changes([scenes[k] for k in plates], [first + k for k in plates])
            x, y, larger = pressed.transpose(2, 0, 1)
            discs[0, plates] += x
            discs[1, plates] += y
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
        widths = Widths()
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


class Fitted331(FittedSensor):
    """The fitted TacTip with 331 pins in ten rings."""

    pins = 331


def radii_at_rest(pins: int, size: int) -> Array:
    """Return the (P,) radii of the white tips in the rest frame of the preset, px.

    Args:
        pins: 127 or 331.
        size: Side of the frame, px.
    """
    preset = TACTIPS[pins]
    optics = replace(preset.optics, size=size)
    tips = (INNER_MM - preset.pin_length_mm) * layout(pins)
    return project(optics, tips, optics.camera_distance_mm - APEX_MM)[2] * tip_shares(pins)


def _as_indentation(fitted: Calibration, scale: float) -> Unknowns:
    """Return the unknowns for labels that are indentation and tilt.

    Indentation is that of ``Calibration.label_fit``. The yaw that remains is the camera's roll; a
    plate's own yaw is added to it.
    """
    x, labels = fitted.unknowns, fitted.label_fit
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
