"""The simulated TacTip as a sensor, and the two that ship."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from tactibench import Grid, Scene, SensorContext, UserError, __version__
from tactibench.geometry import DOME_RADIUS_MM
from tactibench_sim.camera import TACTIPS, optics_from
from tactibench_sim.contact import Tips, tips_of
from tactibench_sim.dome import TableMechanics, tips_of_pins
from tactibench_sim.pins import layout, tip_shares
from tactibench_sim.renderer import Renderer, normal_table, streams
from tactibench_sim.sensor import FRAMES_PER_SECOND, SimulatedSensor
from tactibench_sim.tables import dome_tables, read_file, shipped_dome

if TYPE_CHECKING:
    from tactibench_sim.instances import TrainingInstances

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
FRICTION = 0.5
"""Coulomb's coefficient of the skin and a smooth plastic. In two public recordings of TacTips (Fan
et al., ICRA 2023) a plate slips where the skin has followed it as far as 0.43 to 0.62 (331 pins)
and 0.48 to 0.52 (127) allow, 2 to 5 mm deep. Clean silicone of Shore 50 A on PLA, without dust:
0.6 to 1.0 (github.com/tolstoys19/Friction-Measurements-Between-PLA-and-Silicone, "Sil 950")."""
FRICTION_BETWEEN = 1.5
"""Factor either way between instances (assumed): 0.33 to 0.75."""
FRICTION_WITHIN = 0.13
"""Standard deviation from press to press, as a share. The drag at which the plate slips scatters by
0.13 (331 pins) and 0.22 (127) in the same recordings, trends with depth, tilt and move taken out;
the smaller number, because the error of the fit is among both."""
_STREAM = 10
"""Stream of random numbers that choose the friction of a press, beside that of the training
instances (9)."""


class SimulatedTacTip(SimulatedSensor):
    """A skin-on-gel dome with pins; single-contact fields from finite elements.

    Attributes:
        pins: Number of pins.
    """

    pins: ClassVar[int]

    def __init__(
        self,
        context: SensorContext,
        *,
        tier: str = "coupled",
        table: str = "",
        instance: int = 0,
        instances: int = 0,
        pin_length: float | None = None,
        friction: float = FRICTION,
        friction_between: float = FRICTION_BETWEEN,
        friction_within: float = FRICTION_WITHIN,
        modulus: float = 0.0,
        **optical: Any,
    ) -> None:
        """Build the dome, its pins and its camera.

        Args:
            context: The seed of the noise.
            tier: How scenes become displacement fields.
            table: Path of a file of single-contact fields; "": the one that ships.
            instance: Number of the sensor instance; 0: the nominal one.
            instances: Number of training instances over which the presses are spread; 0 or 1: all
                presses are made on ``instance``. Everything else (``rest``, ``points``, bounds) is
                that of the nominal sensor.
            pin_length: Effective lever of the pins, mm; None: the preset's.
            friction: Coulomb's coefficient between tips and skin of the nominal sensor; 0: without
                friction.
            friction_between: Factor either way by which the coefficient differs between instances.
            friction_within: Standard deviation from press to press, as a share of the coefficient.
            modulus: Young's modulus of the skin, MPa, of every instance; 0: forces are not told.
            **optical: Parameters of ``optics_from``; the others are the preset's.

        Raises:
            UserError: Two of ``table``, ``instance`` and ``instances`` are given.
        """
        given = {"table": table, "instance": instance, "instances": instances > 1 and instances}
        chosen = [f"sensor.{name}={value}" for name, value in given.items() if value]
        if len(chosen) > 1:
            raise UserError(
                f"{' and '.join(chosen)} name different sensors; give one of them. Test on another "
                "instance with --test sensor.instance=N."
            )
        self._tables = dome_tables(read_file(Path(table))) if table else shipped_dome()
        preset = TACTIPS[self.pins]
        length = preset.pin_length_mm if pin_length is None else pin_length
        self.instance, self.pin_length, self.friction = instance, length, friction
        self.optics = optics_from(preset.optics, optical)
        lost = np.zeros(self.pins, dtype=np.bool_)
        if instance or self.optics.pin_loss:
            from tactibench_sim.instances import (  # the nominal sensor needs none
                instance_friction,
                instance_mechanics,
                instance_tables,
                lost_pins,
                perturb,
            )

            self._tables = instance_tables(self._tables, instance)
            lost = lost_pins(self.pins, self.optics.pin_loss, instance)
            self.optics, self.pin_length = perturb(self.optics, length, instance)
            self.friction = instance_friction(friction, friction_between, instance)
        if instance:
            mechanics = instance_mechanics(tier, self._tables)
        else:  # a user's table has no tips but its own
            mechanics = TableMechanics(self._tables, tier, other_tips=not table)
        self.mechanics: Any = mechanics  # Any: either of the two takes the loads that it made
        self._spreads: dict[str, float] = {}
        if friction:
            from tactibench_sim.friction import FrictionMechanics

            self.nuisances = (*type(self).nuisances, "friction")
            self.mechanics = FrictionMechanics(mechanics, self.friction)
            self._spreads = {
                "friction_between": friction_between,
                "friction_within": friction_within,
            }
        self.lost, self.modulus = lost, modulus
        self.directions = layout(self.pins)[~lost]
        still = np.zeros(self.directions.shape)
        resting = tips_of_pins(mechanics.inner, self.directions, (still, still), self.pin_length)
        lift = self.optics.camera_distance_mm - DOME_RADIUS_MM
        renderer = Renderer(self.optics, lift, tip_shares(self.pins)[~lost])
        super().__init__(context, renderer, resting)
        self.instances: TrainingInstances | None = None
        self._measured = tier == "coupled" and not table and instances <= 1
        if instances > 1:
            from tactibench_sim.instances import TrainingInstances

            shared = {"tier": tier, "pin_length": length, "friction": friction, **optical}
            make = partial(type(self), context, **shared | self._spreads)
            self.instances = TrainingInstances(make, context.seed, instances)

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        states, shares = streams(self._seed, first, len(scenes)), self._shares(first, len(scenes))
        if self.instances is not None:
            return self.instances.images(scenes, first, states, shares)
        return self.renderer.frames(self.rubbed(scenes, shares), states)

    def _shares(self, first: int, count: int) -> Array | None:
        """Return the (count,) coefficients of friction over that of the sensor; None: all 1."""
        within = self._spreads.get("friction_within")
        return friction_shares(self._seed, within, first, count) if within else None

    def _force_of(self, scene: Scene, number: int) -> Array | None:
        """Return the (K, 3) forces of the true contacts of press ``number``, N."""
        if not self.modulus:
            return None
        used = self if self.instances is None else self.instances.sensor_of(number)
        tips = used.rubbing_tips([scene], self._shares(number, 1))
        forces = used.mechanics.contact_forces(used.mechanics.loads(tips))
        touching: Array = self.modulus * forces[0, tips.depth[0] > 0]
        return touching

    def rubbed(self, scenes: Sequence[Scene], shares: Array | None) -> Array:
        """Return the (S, P, 3) pin tips in presses that each have their own friction, mm.

        Args:
            scenes: S scenes.
            shares: (S,) coefficients over that of the sensor; None: all have that of the sensor.

        Raises:
            UserError: A scene cannot be pressed.
        """
        return self.places(self.rubbing_tips(scenes, shares))

    def rubbing_tips(self, scenes: Sequence[Scene], shares: Array | None) -> Tips:
        """Return the tips of scenes with their own coefficients of friction (``rubbed``)."""
        tips = self.indenter_tips(scenes)
        return tips if shares is None else replace(tips, friction=self.friction * shares)

    def _rest_of(self, number: int) -> Images:
        return self._rest if self.instances is None else self.instances.rest_of(number)

    def indenter_tips(self, scenes: Sequence[Scene]) -> Tips:
        """Return the tips of scenes with the coefficient of friction of the sensor.

        Raises:
            UserError: A scene cannot be pressed.
        """
        tips = tips_of(scenes)
        return replace(tips, friction=np.full(len(tips), self.friction)) if self.friction else tips

    def places(self, tips: Tips) -> Array:
        """Return (S, P, 3) pin tips from the dome's centre, mm."""
        loads = self.mechanics.loads(tips)
        tips_mm: Array = self.mechanics.pin_tips(loads, self.directions, self.pin_length)
        return tips_mm

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
        """Return (S,) mm, how far a pin may be from finite elements; inf: nobody measured it.

        Nothing is known of tier ``superpose``, of a user's table, of plates, and of tips that move
        sideways with friction. Tips rub with the coefficient of the sensor.
        """
        from tactibench_sim.error_bounds import shipped_bounds  # runs ask once, after the frames

        if not self._measured:
            return np.full(len(scenes), np.inf)
        tips = self.indenter_tips(scenes)
        bounds = shipped_bounds().bound(tips, self.pin_length, instance=bool(self.instance))
        bounds[self._dragged(scenes) & (bounds > 0)] = np.inf
        return bounds

    def _dragged(self, scenes: Sequence[Scene]) -> npt.NDArray[np.bool_]:
        return np.array([bool(self.friction) and scene.pose.moved for scene in scenes])

    def terms(self, scenes: Sequence[Scene]) -> dict[str, int]:
        """Return the terms of the field and the number of scenes that need each.

        ``depth missed`` counts scenes whose final field misses the depth of a tip.
        """
        from tactibench_sim.error_bounds import MISSED_MM, missed_depths, term_counts

        tips = tips_of(scenes)
        counts = term_counts(self.mechanics.tier, tips)
        drag = int((self._dragged(scenes) & (tips.depth > 0).any(axis=1)).sum())
        missed = int((missed_depths(self.mechanics, tips) > MISSED_MM).sum())
        counted = {**counts, "drag": drag, "depth missed": missed}
        return {name: count for name, count in counted.items() if count}

    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, except the seed."""
        return {
            "sensor": f"tactip-{self.pins}",
            "plugin": f"tactibench_sim {__version__}",
            "tier": self.mechanics.tier,
            "instance": self.instance,
            "pins": self.pins,
            "lost_pins": np.flatnonzero(self.lost).tolist(),
            "pin_length_mm": self.pin_length,
            "optics": self.optics.describe(),
            "dome_radius_mm": DOME_RADIUS_MM,
            "tables": {**self._tables.parameters, "sha256": self._tables.digest},
            "frames_per_second": FRAMES_PER_SECOND,
            **({"friction": self.friction, **self._spreads} if self.friction else {}),
            **({"modulus_mpa": self.modulus} if self.modulus else {}),
            **({} if self.instances is None else {"instances": self.instances.describe()}),
        }


class TacTip127(SimulatedTacTip):
    """The simulated TacTip with 127 pins in a hexagon."""

    pins = 127


class TacTip331(SimulatedTacTip):
    """The simulated TacTip with 331 pins in ten rings."""

    pins = 331


def friction_shares(seed: np.random.SeedSequence, within: float, first: int, count: int) -> Array:
    """Return the (count,) coefficients of friction of presses over that of their sensor.

    They are log-normal with mean 1, and depend on the seed and the number of the press alone.

    Args:
        seed: Seed of the sensor.
        within: Standard deviation.
        first: Number of the first press.
        count: Number of presses.
    """
    own = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, _STREAM))
    words = streams(own, first, count)[:, 2] >> np.uint64(48)  # the table has 2**16 values
    variance = np.log1p(within**2)
    out: Array = np.exp(np.sqrt(variance) * normal_table()[words] - variance / 2)
    return out
