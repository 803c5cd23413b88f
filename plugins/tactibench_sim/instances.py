"""Other sensors of the same kind: a nominal sensor with small errors of manufacture.

The random draw is of the sensor instance, not of the press: instance N is the same in every run,
whatever seed the run's noise has. Instance 0 is the nominal sensor, 0 to 9 are there to be tested
on, and a training on several instances takes 10 and on (``training_instance``).

There are two versions of the ranges. Those of version 1, ``Spread``, are assumed; instances of
stored runs were drawn from them. Those of version 2 have their sources in ``tolerances``; training
instances are always drawn from them.

Axisymmetric fields were computed for nine domes, three stiffness ratios times three skins, the
middle one being nominal. The file that ships holds the differences of the other eight from it. A
dome between them is the nominal table plus differences, quadratic in log ratio and in log skin:

    T(x, y) = T(0, 0) + sum_ij L_i(x) L_j(y) (T_ij - T(0, 0)),      i, j in -1, 0, 1

with x, y in -1..1 from ``dome_of`` and Lagrange's polynomials L. So x = y = 0 gives exactly the
nominal table.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import UserError
from tactibench_sim import data_file, tolerances
from tactibench_sim.mechanics.dome import Mechanics, mechanics_for
from tactibench_sim.mechanics.tables import QUANTITIES, Table, Tables, shape_name
from tactibench_sim.optics.camera import Optics

Array = npt.NDArray[np.float64]
FILE = "domes.npz"
SCRIPT = "scripts/fem/tabulate_instances.py"
"""Script that makes the file; it is in the repository and not in the package."""
QUANTUM = 1e-4
"""Step, mm and rad: the fields' differences are stored as whole multiples of it."""
RESERVED = 10
"""Number of instances, 0 to 9, that are for tests and never for training."""
FIRST_RANGES, TRAINING_RANGES = 1, 2
"""Versions of the ranges: the assumed ones, and those with sources."""
KEPT = 64
"""Number of domes that stay in memory, 7 MB each with their mechanics; others are made again when
needed."""


@dataclass(frozen=True)
class Spread:
    """Half-widths of the uniform ranges around the nominal values (all assumed).

    Attributes:
        camera_distance_mm: Seat of the camera.
        principal_x: Axis of the camera in the frame, sides.
        principal_y: Likewise.
        roll_deg: Turn of the camera; the real rest frames are turned by up to 2 deg.
        gel_mm: Fill level.
        pin_length_mm: Moulding of the pins.
        edge_px: Focus.
        vignetting: Fall-off of the light, absolute.
        focal: Lens, relative to the nominal value.
        marker_radius_mm: Paint of the tips, relative.
        brightness: LEDs on the pins, relative.
        background: LEDs on the gel, relative.
    """

    camera_distance_mm: float = 0.5
    principal_x: float = 0.01
    principal_y: float = 0.01
    roll_deg: float = 2.0
    gel_mm: float = 0.5
    pin_length_mm: float = 0.1
    edge_px: float = 0.2
    vignetting: float = 0.2
    focal: float = 0.02
    marker_radius_mm: float = 0.05
    brightness: float = 0.1
    background: float = 0.2


SPREAD = Spread()
RATIO_FACTOR = 2.0
"""Stiffness ratio of skin and gel: log-uniform between half and twice the nominal 50 (another
batch of silicone; ratios 10 to 300 describe real plate presses equally well)."""
SKIN_FACTOR = 1.25
"""Skin thickness: log-uniform between 0.8 and 1.25 times the nominal 1 mm (printing)."""
_RELATIVE = ("focal", "marker_radius_mm", "brightness", "background")


def stream(instance: int, purpose: str) -> np.random.Generator:
    """Return the random generator of an instance for one purpose; a new purpose changes no other.

    Args:
        instance: Number of the instance.
        purpose: Any text.
    """
    return np.random.default_rng([instance, *purpose.encode()])


def training_instance(number: int) -> int:
    """Return the instance of a training at place 0, 1, ...; it is never a reserved one."""
    return RESERVED + number


def perturb(
    optics: Optics,
    pin_length_mm: float,
    instance: int,
    spread: Spread = SPREAD,
    ranges: int = FIRST_RANGES,
) -> tuple[Optics, float]:
    """Return optics and pin length of instance N of a nominal sensor.

    Shares stay within 0..1, lengths above a tenth of the nominal ones.

    Args:
        optics: Optics of the nominal sensor.
        pin_length_mm: Pin length of the nominal sensor.
        instance: Number N; 0 is the nominal sensor.
        spread: Ranges of version 1.
        ranges: Version of the ranges, 1 or 2.

    Returns:
        The optics, and the pin length, mm.
    """
    if instance == 0:
        return optics, pin_length_mm
    if ranges != FIRST_RANGES:
        return tolerances.apply_optics(optics, pin_length_mm, _shares(instance))
    draws = stream(instance, "optics").uniform(-1.0, 1.0, len(fields(spread)))
    steps = {
        field.name: float(share) * getattr(spread, field.name)
        for field, share in zip(fields(spread), draws, strict=True)
    }
    length = max(pin_length_mm + steps.pop("pin_length_mm"), 0.1 * pin_length_mm)
    values = {}
    for name, step in steps.items():
        nominal = getattr(optics, name)
        values[name] = nominal * (1 + step) if name in _RELATIVE else nominal + step
    values["vignetting"] = min(max(values["vignetting"], 0.0), 1.0)
    values["edge_px"] = max(values["edge_px"], 0.1 * optics.edge_px)
    nearest = tolerances.nearest_camera(optics, values["gel_mm"])
    values["camera_distance_mm"] = max(values["camera_distance_mm"], nearest)
    return replace(optics, **values), length


def dome_of(instance: int, ranges: int = FIRST_RANGES) -> tuple[float, float]:
    """Return logarithms (x, y) of the dome of instance N, each in -1..1; (0, 0): nominal.

    Its stiffness ratio is RATIO_FACTOR**x times the nominal one, its skin SKIN_FACTOR**y times.

    Args:
        instance: Number N.
        ranges: Version of the ranges, 1 or 2.
    """
    if instance == 0:
        return 0.0, 0.0
    if ranges != FIRST_RANGES:
        ratio, skin = tolerances.dome_factors(_shares(instance))
        return math.log(ratio, RATIO_FACTOR), math.log(skin, SKIN_FACTOR)
    x, y = stream(instance, "dome").uniform(-1.0, 1.0, 2)
    return float(x), float(y)


def _shares(instance: int) -> dict[str, float]:
    """Return the place of instance N in every range of version 2.

    Every field has random numbers of its own, so that a new field would not change the others.

    Returns:
        Field of ``Tolerances`` -> place in its range, -1..1.
    """
    return {
        field.name: float(stream(instance, f"tolerance {field.name}").uniform(-1.0, 1.0))
        for field in fields(tolerances.Tolerances)
    }


def lost_pins(pins: int, share: float, instance: int) -> npt.NDArray[np.bool_]:
    """Return (pins,) True for the pins of an instance that have no white tip.

    These are round(share * pins) pins. A greater share loses the same pins and more.

    Args:
        pins: Number of pins.
        share: Share of the pins that are lost, 0..1.
        instance: Number of the instance.
    """
    lost = np.zeros(pins, dtype=np.bool_)
    lost[stream(instance, "pin loss").permutation(pins)[: round(share * pins)]] = True
    return lost


@dataclass(frozen=True, eq=False)
class DomeDifferences:
    """Differences of other domes from the nominal one.

    Attributes:
        parameters: Parameters of the file; ``dome`` is the nominal dome.
        digest: Checksum of the file.
        delta: (D,) penetrations, mm, coarser than those of the tables.
        polar: (T,) polar angles, rad, coarser than those of the tables.
        by_shape: Name of an indenter -> quantity -> (3, 3, D, T) differences by ratio, skin, depth
            and angle, ``force`` (3, 3, D). Those at [1, 1], the nominal dome, are zero.
    """

    parameters: dict[str, Any]
    digest: str
    delta: Array
    polar: Array
    by_shape: Mapping[str, Mapping[str, Array]]

    def tables(self, nominal: Tables, x: float, y: float, **description: Any) -> Tables:
        """Return the tables of the dome at (x, y) of ``dome_of``, on the grid of the nominal ones.

        The corrections for the rim and for pairs are those of the nominal dome: they are small
        beside the single fields, and how another dome changes them was not computed.

        Args:
            nominal: The tables of the nominal dome.
            x: Logarithm of the stiffness ratio, -1..1.
            y: Logarithm of the skin's thickness, -1..1.
            **description: Further parameters that describe the dome.

        Raises:
            UserError: ``nominal`` has other indenters or another dome than the file.
        """
        if (x, y) == (0.0, 0.0):
            return nominal
        ours = self.parameters["dome"], sorted(self.by_shape)
        theirs = nominal.parameters["dome"], sorted(shape_name(r) for r in nominal.by_radius)
        if ours != theirs:
            raise UserError(
                f"the other domes are around {ours} and the nominal table is of {theirs}; "
                f"make them again with {SCRIPT}."
            )
        dome = dict(nominal.parameters["dome"])
        dome["stiffness_ratio"] *= RATIO_FACTOR**x
        dome["skin"] *= SKIN_FACTOR**y
        weight = np.outer(_lagrange(x), _lagrange(y))
        by_radius = {r: self._table(table, weight) for r, table in nominal.by_radius.items()}
        parameters = {**nominal.parameters, "dome": dome, "between": self.digest, **description}
        identity = json.dumps({**parameters, "nominal": nominal.digest}, sort_keys=True)
        digest = data_file.digest_of({}, identity)
        return Tables(parameters, digest, by_radius, nominal.corrections)

    def _table(self, nominal: Table, weight: Array) -> Table:
        changes = self.by_shape[shape_name(nominal.radius)]
        fields = {}
        for name, field in nominal.fields.items():
            change = np.tensordot(weight, changes[name], 2)
            change = CubicSpline(self.delta, change, axis=0)(nominal.delta)
            if name != "force":
                change = CubicSpline(self.polar, change, axis=1)(nominal.polar)
            fields[name] = field + change
        return Table(nominal.radius, nominal.delta, nominal.polar, fields)


@lru_cache(maxsize=KEPT)
def instance_tables(nominal: Tables, instance: int, ranges: int = FIRST_RANGES) -> Tables:
    """Return the tables of instance N of the nominal dome; instance 0 has ``nominal`` itself.

    Args:
        nominal: The tables of the nominal dome.
        instance: Number N.
        ranges: Version of the ranges, 1 or 2.

    Raises:
        UserError: ``nominal`` has other indenters or another dome than the shipped differences.
    """
    if instance == 0:
        return nominal
    return shipped().tables(nominal, *dome_of(instance, ranges), instance=instance)


@lru_cache(maxsize=KEPT)
def instance_mechanics(tier: str, tables: Tables) -> Mechanics:
    """Return the mechanics of an instance's tables, the same object for all sensors that need it.

    A run opens a sensor for every 250 presses, and most of the time of making an instance is spent
    here.

    Raises:
        UserError: ``tier`` is no tier.
    """
    return mechanics_for(tier, tables)


def _lagrange(x: float) -> Array:
    """Return the (3,) weights of nodes -1, 0, 1."""
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2])


def _differences(
    arrays: data_file.Arrays, parameters: dict[str, Any], digest: str
) -> DomeDifferences:
    delta, polar = (arrays[name].astype(np.float64) for name in ("delta", "polar"))
    shapes = [name.removesuffix("_force") for name in arrays if name.endswith("_force")]
    by_shape = {s: {q: _unpack(arrays, s, q) for q in QUANTITIES} for s in shapes}
    return DomeDifferences(parameters, digest, delta, polar, by_shape)


def _unpack(content: Mapping[str, npt.NDArray[Any]], shape: str, quantity: str) -> Array:
    values: Array = content[f"{shape}_{quantity}"].astype(np.float64)
    return values if quantity == "force" else QUANTUM * values


DATA = data_file.DataFile(__package__, FILE, "the tables of other domes", _differences, SCRIPT)
read, shipped = DATA.read, DATA.shipped
