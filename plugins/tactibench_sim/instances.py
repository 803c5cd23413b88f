"""Sensor instances: what differs between sensors of one make, their domes, trainings on many.

The random draw is of the instance, not of the press: instance N is the same in every run, whatever
seed the run's noise has. Instance 0 is the nominal sensor. 0 to 9 are there to be tested on; they
lie in assumed ranges, ``Spread``. A training on several instances takes 10 and on; they lie in
``Tolerances``, whose ranges have a source each, or are said to be assumed.

A width is that of a uniform distribution around the nominal value: a tolerance says how far off a
part may be and not how often. Where one cause moves two numbers they move together:

* more gel between window and apex is a longer tip, so the apex lies as much farther from the
  camera; the air between camera and window varies beside that;
* the same LEDs light pins and gel, so both grow brighter together;
* a stiffer skin and a softer gel change one number, the ratio of their stiffnesses.

That skin and gain go together (a skin of 1.15 mm spreads a press wider and moves the pins 7 % more
on the mean, a stiffness ratio of 80 moves them 3 % more, 3 mm deep at the apex) comes from the
mechanics. docs/simulator-method.md lists the sources.

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
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from tactibench import Scene
from tactibench_sim.camera import Optics
from tactibench_sim.dome import TableMechanics
from tactibench_sim.tables import Table, Tables, digest_of, shape_name, shipped_file

if TYPE_CHECKING:
    from tactibench_sim.tactip import SimulatedTacTip

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
FILE = "domes.npz"
QUANTUM = 1e-4
"""Step, mm and rad: the fields' differences are stored as whole multiples of it."""
KEPT = 64
"""Number of domes that stay in memory, 7 MB each with their mechanics; others are made again when
needed."""
STREAM = 9
"""Stream of random numbers that choose the instance of a press. It differs from those of the noise
and of the fitted sensors (7 and 8)."""
RESERVED = 10
"""Number of instances, 0 to 9, that are for tests and never for training."""
RATIO_FACTOR = 2.0
"""Stiffness ratio of skin and gel, tests: log-uniform between half and twice the nominal 50
(another batch of silicone; ratios 10 to 300 describe real plate presses equally well)."""
SKIN_FACTOR = 1.25
"""Skin thickness, tests: log-uniform between 0.8 and 1.25 times the nominal 1 mm (printing)."""
SHORE_A = 30.0
"""Hardness of a printed skin (assumed); a moulded one of 60 gives the same factors to 2 %."""
_RELATIVE = ("air_mm", "focal", "marker_radius_mm", "brightness", "background")


@dataclass(frozen=True)
class Spread:
    """Half-widths of the uniform ranges around the nominal values (all but the lever's assumed).

    Attributes:
        air_mm: Distance from the camera to the window, relative.
        principal_x: Axis of the camera in the frame, sides.
        principal_y: Likewise.
        roll_deg: Turn of the camera; the real rest frames are turned by up to 2 deg.
        gel_mm: Fill level.
        pin_length_mm: Lever: fits to blocks of the 331 set's presses find 0.14 to 0.47 mm where
            all of them give 0.40.
        edge_px: Focus.
        vignetting: Fall-off of the light, absolute.
        focal: Lens, relative to the nominal value.
        marker_radius_mm: Paint of the tips, relative.
        brightness: LEDs on the pins, relative.
        background: LEDs on the gel, relative.
    """

    air_mm: float = 0.2
    principal_x: float = 0.01
    principal_y: float = 0.01
    roll_deg: float = 2.0
    gel_mm: float = 0.5
    pin_length_mm: float = 0.27
    edge_px: float = 0.2
    vignetting: float = 0.2
    focal: float = 0.02
    marker_radius_mm: float = 0.05
    brightness: float = 0.1
    background: float = 0.2


@dataclass(frozen=True)
class Tolerances:
    """Half-widths of the uniform ranges.

    Attributes:
        air: Share of the distance from the camera to the window (assumed).
        fill_mm: Level of the gel (assumed: the tip is filled by syringe until it is full).
        principal_x: Axis of the camera beside the frame's middle, sides.
        principal_y: Likewise. The pins of the two real rest frames lie 0.004 to 0.014 sides off it
            in x and in y; a maker of board cameras allows far more (5 deg, 0.08 sides).
        roll_deg: Turn of the camera; 3 deg by the same maker, 2 deg in the real rest frames.
        pin_length_mm: Lever, as of ``Spread``; printers alone leave 0.1 mm at either end.
        marker_radius_mm: 0.1 mm on the diameter.
        focal: Share; the usual tolerance of a small lens.
        edge_px: Focus, set by hand (assumed).
        vignetting: Share of the natural fall-off (assumed).
        light: Share, of pins and gel alike: a bin of LEDs spans a factor of 1.26.
        background: Share, of the gel beside that (assumed: clearness of gel and paint).
        skin_mm: Thickness of the skin; the far end of what is stated for such printers.
        hardness: Shore A of the skin, by which its modulus follows (``modulus``).
        gel: Factor of the gel's modulus either way (assumed; with the skin's it just stays within
            the tables).
    """

    air: float = 0.2
    fill_mm: float = 0.5
    principal_x: float = 0.02
    principal_y: float = 0.02
    roll_deg: float = 3.0
    pin_length_mm: float = 0.27
    marker_radius_mm: float = 0.05
    focal: float = 0.05
    edge_px: float = 0.2
    vignetting: float = 0.2
    light: float = 0.12
    background: float = 0.2
    skin_mm: float = 0.15
    hardness: float = 5.0
    gel: float = 1.6


def modulus(shore_a: float) -> float:
    """Return Young's modulus of a rubber in MPa from its hardness, Shore A.

    Gent, On the relation between indentation hardness and Young's modulus, Rubber Chemistry and
    Technology 31 (1958), 896: E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S)).
    """
    return 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def stream(instance: int, purpose: str) -> np.random.Generator:
    """Return the random generator of an instance for one purpose; a new purpose changes no other.

    Args:
        instance: Number of the instance.
        purpose: Any text.
    """
    return np.random.default_rng([instance, *purpose.encode()])


def perturb(
    optics: Optics, pin_length_mm: float, instance: int, spread: Spread | None = None
) -> tuple[Optics, float]:
    """Return optics and pin length of instance N of a nominal sensor.

    Shares stay within 0..1, lengths above a tenth of the nominal ones.

    Args:
        optics: Optics of the nominal sensor.
        pin_length_mm: Pin length of the nominal sensor.
        instance: Number N; 0 is the nominal sensor.
        spread: Ranges of all instances; None: those of the number.

    Returns:
        The optics, and the pin length, mm.
    """
    if instance == 0:
        return optics, pin_length_mm
    values: dict[str, Any] = {}
    if instance >= RESERVED and spread is None:
        off = _differences(instance)
        for name in ("principal_x", "principal_y", "roll_deg", "edge_px", "vignetting"):
            values[name] = getattr(optics, name) + getattr(off, name)
        light, gel = 1 + off.light, 1 + off.background
        values |= {
            "gel_mm": max(optics.gel_mm + off.fill_mm, 0.0),
            "air_mm": optics.air_mm * (1 + off.air),
            "marker_radius_mm": max(
                optics.marker_radius_mm + off.marker_radius_mm, 0.5 * optics.marker_radius_mm
            ),
            "focal": optics.focal * (1 + off.focal),
            "brightness": optics.brightness * light,
            "background": optics.background * light * gel,
        }
        length = pin_length_mm + off.pin_length_mm
    else:
        spread = spread or Spread()
        draws = stream(instance, "optics").uniform(-1.0, 1.0, len(fields(spread)))
        steps = {
            field.name: float(share) * getattr(spread, field.name)
            for field, share in zip(fields(spread), draws, strict=True)
        }
        length = pin_length_mm + steps.pop("pin_length_mm")
        for name, step in steps.items():
            nominal = getattr(optics, name)
            values[name] = nominal * (1 + step) if name in _RELATIVE else nominal + step
    values["vignetting"] = min(max(values["vignetting"], 0.0), 1.0)
    values["edge_px"] = max(values["edge_px"], 0.1 * optics.edge_px)
    # More gel is a longer tip, whose apex is farther from the camera.
    values["camera_distance_mm"] = values.pop("air_mm") + optics.window_mm + values["gel_mm"]
    return replace(optics, **values), max(length, 0.1 * pin_length_mm)


def dome_of(instance: int) -> tuple[float, float]:
    """Return logarithms (x, y) of the dome of instance N, each in -1..1; (0, 0): nominal.

    Its stiffness ratio is RATIO_FACTOR**x times the nominal one, its skin SKIN_FACTOR**y times.
    """
    if instance == 0:
        return 0.0, 0.0
    if instance >= RESERVED:
        off = _differences(instance)
        skin = modulus(SHORE_A + off.hardness) / modulus(SHORE_A)
        gel = math.exp(_share(instance, "gel") * math.log(Tolerances().gel))
        return math.log(skin / gel, RATIO_FACTOR), math.log(1 + off.skin_mm, SKIN_FACTOR)
    x, y = stream(instance, "dome").uniform(-1.0, 1.0, 2)
    return float(x), float(y)


def _differences(instance: int) -> Tolerances:
    """Return how far instance N is off the nominal sensor, in every range."""
    widths = asdict(Tolerances())
    return Tolerances(**{name: _share(instance, name) * wide for name, wide in widths.items()})


def _share(instance: int, name: str) -> float:
    """Return the place of instance N in one of the ranges of ``Tolerances``, -1..1.

    Every range has random numbers of its own, so that a new one would not change the others.
    """
    return float(stream(instance, f"tolerance {name}").uniform(-1.0, 1.0))


def instance_friction(friction: float, between: float, instance: int) -> float:
    """Return the coefficient of friction of instance N; that of instance 0 is the nominal one.

    Args:
        friction: The nominal coefficient.
        between: Greatest factor either way; the logarithm is uniform.
        instance: Number N.
    """
    return friction * between ** _share(instance, "friction") if instance else friction


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


def tables_between(nominal: Tables, x: float, y: float, **description: Any) -> Tables:
    """Return the tables of the dome at (x, y) of ``dome_of``, on the grid of the nominal ones.

    The corrections for the rim and for pairs are those of the nominal dome: they are small beside
    the single fields, and how another dome changes them was not computed.

    Args:
        nominal: The tables of the nominal dome.
        x: Logarithm of the stiffness ratio, -1..1.
        y: Logarithm of the skin's thickness, -1..1.
        **description: Further parameters that describe the dome.
    """
    if (x, y) == (0.0, 0.0):
        return nominal
    file = shipped_file(FILE)
    weight = np.outer(_lagrange(x), _lagrange(y))
    by_radius = {}
    for radius, table in nominal.by_radius.items():
        changed = {}
        for name, field in table.fields.items():
            # (3, 3, D, T) by ratio, skin, depth and angle; the nominal dome's, at [1, 1], are 0
            stored = file.arrays[f"{shape_name(radius)}_{name}"]
            change = np.tensordot(weight, stored if name == "force" else QUANTUM * stored, 2)
            change = CubicSpline(file.arrays["delta"], change, axis=0)(table.delta)
            if name != "force":
                change = CubicSpline(file.arrays["polar"], change, axis=1)(table.polar)
            changed[name] = field + change
        by_radius[radius] = Table(radius, table.delta, table.polar, changed)
    dome = dict(nominal.parameters["dome"])
    dome["stiffness_ratio"] *= RATIO_FACTOR**x
    dome["skin"] *= SKIN_FACTOR**y
    parameters = {**nominal.parameters, "dome": dome, "between": file.digest, **description}
    identity = json.dumps({**parameters, "nominal": nominal.digest}, sort_keys=True)
    return Tables(parameters, digest_of({}, identity), by_radius, nominal.corrections)


@lru_cache(maxsize=KEPT)
def instance_tables(nominal: Tables, instance: int) -> Tables:
    """Return the tables of instance N of the nominal dome; instance 0 has ``nominal`` itself."""
    return tables_between(nominal, *dome_of(instance), instance=instance)


@lru_cache(maxsize=KEPT)
def instance_mechanics(tier: str, tables: Tables) -> TableMechanics:
    """Return the mechanics of an instance's tables, the same object for all sensors that need it.

    A run opens a sensor for every 250 presses, and most of the time of making an instance is spent
    here.

    Raises:
        UserError: ``tier`` is no tier.
    """
    return TableMechanics(tables, tier)


def _lagrange(x: float) -> Array:
    """Return the (3,) weights of nodes -1, 0, 1."""
    return np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2])


class TrainingInstances:
    """The sensor instances of a training, each made when the first press needs it.

    At most ``KEPT`` of them stay in memory; the rest frames of all of them do.
    """

    def __init__(
        self,
        make: Callable[..., SimulatedTacTip],
        seed: np.random.SeedSequence,
        count: int,
    ) -> None:
        """Prepare the instances; none is made yet.

        Args:
            make: Makes the sensor of an ``instance``.
            seed: Seed of the sensor.
            count: Number of instances.
        """
        self.count = count
        self._seed = seed
        self._rests: dict[int, Images] = {}
        self._sensor = lru_cache(maxsize=KEPT)(lambda number: make(instance=number))

    def number_of(self, press: int) -> int:
        """Return the number of the instance on which a press is made, 10 or more.

        It depends on the seed of the sensor and the number of the press alone.
        """
        key = (*self._seed.spawn_key, STREAM, press)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed.entropy, spawn_key=key))
        return RESERVED + int(rng.integers(self.count))

    def sensor_of(self, press: int) -> Any:
        """Return the sensor of a press's instance."""
        return self._sensor(self.number_of(press))

    def rest_of(self, press: int) -> Images:
        """Return the rest frame of a press's instance, the same array for all its presses."""
        number = self.number_of(press)
        if number not in self._rests:
            self._rests[number] = self._sensor(number).rest().image
        return self._rests[number]

    def images(
        self,
        scenes: Sequence[Scene],
        first: int,
        states: npt.NDArray[np.uint64],
        friction: Array | None,
    ) -> Images:
        """Return the images of consecutive presses, uint8.

        Args:
            scenes: S scenes.
            first: Number of the first press.
            states: (S, 4) states of the noise.
            friction: (S,) coefficients of friction over that of the instance; None: all 1.

        Raises:
            UserError: A scene cannot be pressed.
        """
        numbers = np.array([self.number_of(first + k) for k in range(len(scenes))])
        out: Images | None = None
        for number in np.unique(numbers).tolist():
            rows, sensor = np.flatnonzero(numbers == number).tolist(), self._sensor(number)
            shares = None if friction is None else friction[rows]
            points = sensor.rubbed([scenes[row] for row in rows], shares)
            images = sensor.renderer.frames(points, states[rows])
            if out is None:
                out = np.empty((len(scenes), *images.shape[1:]), dtype=np.uint8)
            out[rows] = images
        assert out is not None  # noqa: S101 - a batch holds a press
        return out

    def describe(self) -> dict[str, Any]:
        """Return all that determines the instances."""
        return {
            "count": self.count,
            "numbers": [RESERVED, RESERVED + self.count - 1],
            "tolerances": asdict(Tolerances()),
            "domes": shipped_file(FILE).digest,
        }
