"""The simulated TacTip as a sensor, and the two that ship."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactibench import Grid, Scene, SensorContext, UserError, __version__
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.mechanics import tables
from tactibench_sim.mechanics.contact import Tips, tips_of
from tactibench_sim.mechanics.dome import (
    Mechanics,
    TableMechanics,
    mechanics_for,
    tips_of_pins,
)
from tactibench_sim.mechanics.tips import TipMechanics
from tactibench_sim.optics.camera import Optics, optics_from
from tactibench_sim.optics.noise import Noise, streams
from tactibench_sim.optics.renderer import Renderer
from tactibench_sim.pins import INNER_MM, layout, tip_shares
from tactibench_sim.rendered_sensor import FRAMES_PER_SECOND, BoundedSensor

if TYPE_CHECKING:
    from tactibench_sim.training_instances import TrainingInstances

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Preset:
    """A dome with pins and a camera.

    Attributes:
        name: Name of the sensor.
        pins: Number of pins.
        optics: The camera.
        pin_length_mm: The lever; 2: about the length of the pins of public TacTips.
        fitted: Whether camera and lever were fitted to a real sensor. Then the pins are where these
            optics see the real ones at rest, not where the reference optics do, and plates hold
            the skin as real ones do (``tables.holding_plates``).
        tip_square: Coefficient ``square`` of ``pins.tip_shares``, which changes the radius of the
            white tips from the centre to the rim; 0 with tip_fourth 0: all tips are alike.
        tip_fourth: Coefficient ``fourth`` of ``pins.tip_shares``.
    """

    name: str
    pins: int
    optics: Optics
    pin_length_mm: float = 2.0
    fitted: bool = False
    tip_square: float = 0.0
    tip_fourth: float = 0.0

    def layout(self) -> Array:
        """Return the (P, 3) directions of the pins."""
        if not self.fitted:
            return layout(self.pins)
        return layout(self.pins, self.optics, INNER_MM - self.pin_length_mm)

    def tip_shares(self) -> Array:
        """Return the (P,) radii of the white tips over that of the centre pin."""
        return tip_shares(self.pins, self.tip_square, self.tip_fourth)


TACTIP_127 = Preset("tactip-127", 127, Optics(marker_radius_mm=0.36))
"""Like the real 127-pin sensor of the Tac-VGNN data: with this marker radius, the discs of a
thresholded rest frame have the median area of the real frame's. Glare, where it is switched on, is
six arcs."""

TACTIP_331 = Preset(
    "tactip-331", 331, Optics(marker_radius_mm=0.47, glare_width=0.014, glare_arc_deg=80.0)
)
"""Like the real 331-pin sensor, with the marker radius found likewise. Glare is a closed ring that
is thick at the LEDs."""


FITTED_THRESHOLD = 50.0
"""Grey levels above the block (output bw): about half of a tip's light. A threshold of 5 cuts at
the foot of a tip's edge, which hides how pins grow. In the presses of the fit, the areas of the 331
set's innermost pins grow by a factor of 1.25; simulated ones by 1.21 with a threshold of 5 and by
1.24 with 50."""

TACTIP_127_FITTED = replace(
    TACTIP_127,
    optics=replace(
        TACTIP_127.optics,
        camera_distance_mm=23.352,
        lens="fisheye",
        focal=0.2897,
        gel_mm=22.852,
        window_mm=0.0,
        marker_radius_mm=0.4096,
        threshold_grey=FITTED_THRESHOLD,
    ),
    pin_length_mm=0.605,
    fitted=True,
    tip_square=0.268,
    tip_fourth=-0.275,
)
"""Version 2, fitted to the real sensor by benchmarks/fit_presets.py, on this dome. The window's
thickness counts as gel."""

TACTIP_331_FITTED = replace(
    TACTIP_331,
    optics=replace(
        TACTIP_331.optics,
        camera_distance_mm=23.486,
        lens="fisheye",
        focal=0.3388,
        gel_mm=21.486,
        window_mm=0.0,
        marker_radius_mm=0.4057,
        threshold_grey=FITTED_THRESHOLD,
    ),
    pin_length_mm=0.403,
    fitted=True,
    tip_square=0.957,
    tip_fourth=-0.685,
)
"""Version 2 of the 331-pin sensor, fitted likewise."""


class SimulatedTacTip(BoundedSensor):
    """A skin-on-gel dome with pins; single-contact fields from finite elements.

    Attributes:
        preset: Preset of the chosen version; of the class itself, that of version 1.
        versions: Presets of versions 1, 2 and so on.
    """

    preset: Preset
    versions: tuple[Preset, ...]

    def __init__(
        self,
        context: SensorContext,
        *,
        version: int = 1,
        tier: str = "coupled",
        table: str = "",
        instance: int = 0,
        instances: int = 0,
        ranges: int = 1,
        pin_length: float | None = None,
        friction: float = 0.0,
        threads: int | None = None,
        **optical: Any,
    ) -> None:
        """Build the dome, its pins and its camera.

        Args:
            context: The seed of the noise.
            version: Version of the preset, 1 or 2, whose lever, camera and pins are the defaults.
            tier: How scenes become displacement fields.
            table: Path of a file of single-contact fields; "": the one that ships.
            instance: Number of the sensor instance; 0: the nominal one.
            instances: Number of training instances over which the presses are spread; 0 or 1: all
                presses are made on ``instance``. Everything else (``rest``, ``points``, bounds) is
                that of the nominal sensor.
            ranges: Version of the ranges of ``instance``; training instances are of version 2.
            pin_length: Length of the pins, mm; None: the preset's.
            friction: Coulomb's coefficient between tips and skin; 0: moves drag nothing.
            threads: Number of threads of ``press_many``; None: ``thread_count()``.
            **optical: Parameters of ``optics_from``; the others are the preset's.

        Raises:
            UserError: Two of ``table``, ``instance`` and ``instances`` are given, there is no such
                version, or ``friction`` is given with a tier that knows no forces.
        """
        if not 1 <= version <= len(self.versions):
            raise UserError(
                f"{self.preset.name} has no version {version}; take one of 1 to "
                f"{len(self.versions)}."
            )
        self.version, self.preset = version, self.versions[version - 1]
        if instance and instances > 1:
            raise UserError(
                f"sensor.instances={instances} trains on {instances} sensor instances, so "
                f"sensor.instance={instance} says nothing; leave one of them out, or test on that "
                f"instance with --test sensor.instance={instance}."
            )
        if table and (instance or instances > 1):
            given = f"instance={instance}" if instance else f"instances={instances}"
            raise UserError(
                f"sensor.table={table} is of one dome, and sensor.{given} is of others; leave one "
                "of them out."
            )
        self._tables = tables.read(Path(table)) if table else tables.shipped()
        if self.preset.fitted:
            self._tables = tables.holding_plates(self._tables)
        self.instance = instance
        self.pin_length = self.preset.pin_length_mm if pin_length is None else pin_length
        self.optics = optics_from(self.preset.optics, optical)
        self.lost = np.zeros(self.preset.pins, dtype=np.bool_)
        if instance or self.optics.pin_loss:  # a run on the nominal sensor does not load them
            from tactibench_sim.instances import instance_tables, lost_pins, perturb

            self._tables = instance_tables(self._tables, instance, ranges)
            self.lost = lost_pins(self.preset.pins, self.optics.pin_loss, instance)
            self.optics, self.pin_length = perturb(
                self.optics, self.pin_length, instance, ranges=ranges
            )
        self.friction = friction
        self.mechanics = self._with_friction(self._mechanics(tier, ships=not table))
        self.directions = self.preset.layout()[~self.lost]
        self.shares = self.preset.tip_shares()[~self.lost]
        lift = self.optics.camera_distance_mm - DOME_RADIUS_MM
        renderer = Renderer(self.optics, lift, self.shares)
        still = np.zeros((2, *self.directions.shape))
        inner = self.mechanics.inner  # a scene would need an indenter for which there is a table
        resting = tips_of_pins(inner, self.directions, (still[0], still[1]), self.pin_length)
        super().__init__(context, renderer, resting, threads)
        self.ranges = ranges
        self.instances: TrainingInstances | None = None
        if instances > 1:
            from tactibench_sim.training_instances import TrainingInstances

            parameters = {
                "version": version,
                "tier": tier,
                "pin_length": pin_length,
                "friction": friction,
                **optical,
            }
            make = partial(type(self), context, threads=1, **parameters)
            self.instances = TrainingInstances(make, context.seed, instances)

    def _mechanics(self, tier: str, *, ships: bool) -> Mechanics:
        if not self.instance:
            mechanics = mechanics_for(tier, self._tables)
            if isinstance(mechanics, TableMechanics) and ships:
                return TipMechanics(mechanics)  # a user's table has no tips but its own
            return mechanics
        from tactibench_sim.instances import instance_mechanics

        return instance_mechanics(tier, self._tables)

    def _with_friction(self, mechanics: Mechanics) -> Mechanics:
        if not self.friction:
            return mechanics
        from tactibench_sim.mechanics.friction import FrictionMechanics

        if not isinstance(mechanics, TableMechanics | TipMechanics):
            raise UserError(
                f"sensor.tier={mechanics.tier} knows no friction; take sensor.tier=coupled, or "
                "leave sensor.friction out."
            )
        return FrictionMechanics(mechanics, self.friction)

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        if self.instances is None:
            return super()._images(scenes, first)
        return self.instances.images(scenes, first, streams(self._seed, first, len(scenes)))

    def _rest_of(self, number: int) -> Images:
        return self._rest if self.instances is None else self.instances.rest_of(number)

    @property
    def noise(self) -> Noise:
        """Noise of the camera."""
        return self.optics.noise

    def indenter_tips(self, scenes: Sequence[Scene]) -> Tips:
        """Return the tips of scenes on the dome (``contact.tips_of``)."""
        return tips_of(scenes)

    def places(self, tips: Tips) -> Array:
        """Return (S, P, 3) pin tips from the dome's centre, mm."""
        loads = self.mechanics.loads(tips)
        return self.mechanics.pin_tips(loads, self.directions, self.pin_length)

    def surface(self, scene: Scene, grid: Grid) -> Array:
        """Return the (H, W) inward displacement of the outer skin, mm; zero beside the dome."""
        x, y = (axis.ravel() for axis in np.meshgrid(*grid.axes()))
        square = x**2 + y**2
        above = square < DOME_RADIUS_MM**2
        z = np.sqrt(DOME_RADIUS_MM**2 - square[above])
        directions = np.stack([x[above], y[above], z], axis=1) / DOME_RADIUS_MM
        out = np.zeros(len(x))
        out[above] = self.mechanics.skin(self.mechanics.loads(tips_of([scene])), directions)[0]
        return out.reshape(grid.shape)

    def error_bounds(self, scenes: Sequence[Scene]) -> Array:
        """Return (S,) mm, how far a pin base may be from finite elements; inf: not measured."""
        from tactibench_sim.error_bounds import scene_bounds  # runs ask once, after the frames

        if self.instances is not None:  # measured on the nominal dome alone
            return np.full(len(scenes), np.inf)
        bounds = scene_bounds(self.mechanics.tier, self._tables.digest, tips_of(scenes))
        bounds[self._dragged(scenes) & (bounds > 0)] = np.inf  # measured without drag
        return bounds

    def _dragged(self, scenes: Sequence[Scene]) -> npt.NDArray[np.bool_]:
        return np.array([bool(self.friction) and scene.pose.moved for scene in scenes])

    def terms(self, scenes: Sequence[Scene]) -> dict[str, int]:
        """Return the terms of the field and the number of scenes that need each."""
        from tactibench_sim.error_bounds import term_counts

        tips = tips_of(scenes)
        counts = term_counts(self.mechanics.tier, tips)
        drag = int((self._dragged(scenes) & (tips.depth > 0).any(axis=1)).sum())
        return {**counts, "drag": drag} if drag else counts

    def forces(self, scene: Scene) -> Array | None:
        """Return the (K,) normal forces of the contacts, E_skin mm^2; None if the tier has none."""
        tips, forces_of = tips_of([scene]), getattr(self.mechanics, "forces", None)
        if forces_of is None:
            return None
        forces = forces_of(self.mechanics.loads(tips))
        touching: Array = forces[0, tips.depth[0] > 0]
        return touching

    def calibrated_on(self) -> Mapping[str, Sequence[str]]:
        """Return the frames of the recording that a fitted version was fitted to."""
        if not self.preset.fitted:
            return {}
        from tactibench_sim.real.calibration import calibration  # plates alone need it otherwise

        fitted = calibration(str(self.preset.pins))  # benchmarks/fit_presets.py takes its presses
        return {fitted.recording: fitted.frames}

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        return {
            "sensor": self.preset.name,
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "instance": self.instance,
            "pins": self.preset.pins,
            "lost_pins": np.flatnonzero(self.lost).tolist(),
            "pin_length_mm": self.pin_length,
            "optics": self.optics.describe(),
            "dome_radius_mm": DOME_RADIUS_MM,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
            **({"friction": self.friction} if self.friction else {}),
            **({"version": self.version} if self.version > 1 else {}),
            **({"ranges": self.ranges} if self.instance and self.ranges > 1 else {}),
            **({} if self.instances is None else {"instances": self.instances.describe()}),
        }


class TacTip127(SimulatedTacTip):
    """The simulated TacTip with 127 pins in a hexagon."""

    preset = TACTIP_127
    versions = TACTIP_127, TACTIP_127_FITTED


class TacTip331(SimulatedTacTip):
    """The simulated TacTip with 331 pins in ten rings."""

    preset = TACTIP_331
    versions = TACTIP_331, TACTIP_331_FITTED
