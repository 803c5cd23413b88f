"""Fit the effect of contacts on each other to finite-element mechanics, and print its errors.

    python benchmarks/neighbours.py [--pairs 3000] [--triples 2000] [--write]

All presses are of the nominal simulated tactip-127 without noise; its tips rub, and friction
differs from press to press. Single presses give the field. Pairs and triples at random places and
depths (5.5 mm apart or more) are fitted by as many single contacts as they have and a number for
friction, and the law gives the shift of those from the true ones. Printed is the error
of both directions of the law on presses to which it was not fitted, beside that of plain addition.
``--write`` replaces the coefficients that ship (tactibench/superposition/neighbours.npz).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import tactibench.superposition as package
from tactibench import Frame, Indenter, Pose, Scene, SensorContext
from tactibench.geometry import DOME_RADIUS_MM, tip_depths
from tactibench.markers import PinTracker
from tactibench.plugins import PluginHost
from tactibench.protocols import draw_scenes, load_protocol
from tactibench.superposition import FieldFamily, NeighbourLaw, solve

Array = npt.NDArray[np.float64]

HALF_MM, DEPTHS_MM, CLOSEST_MM, TIP_MM = 6.4, (0.5, 6.0), 5.5, 3.0
FARTHEST_MM, SHALLOWEST_MM = 1.5, 0.1
"""A fit that is farther from the truth, or shallower, has lost its contact and is left out."""
HELD_OUT = 5
NOISE_PX = 0.02
"""Noise of a displacement, beside which the number of a press is found."""


def scene_of(contacts: Array) -> Scene:
    """Return a press of rigid tips whose heights give every contact its depth.

    Args:
        contacts: (K, 3) x, y and depth of the contacts, mm.
    """
    reach = DOME_RADIUS_MM + TIP_MM
    height = np.sqrt(reach**2 - (contacts[:, :2] ** 2).sum(axis=1)) - contacts[:, 2]
    middle = contacts[:, :2].mean(axis=0)
    offsets = np.column_stack([contacts[:, :2] - middle, height.max() - height])
    indenter = Indenter(TIP_MM, tuple(map(tuple, offsets.tolist())), "free")
    x, y = middle
    depth = contacts[0, 2] - tip_depths(Scene(indenter, Pose(x, y)))[0]
    return Scene(indenter, Pose(x, y, depth=float(depth)))


def free_contacts(
    count: int, each: int, rng: np.random.Generator, closest: float = CLOSEST_MM
) -> Array:
    """Return (count, each, 3) contacts at random places and depths, mm.

    Args:
        count: Number of presses.
        each: Number of contacts of each press.
        rng: Source of places and depths.
        closest: Least distance of two contacts of a press, mm.
    """
    contacts: list[Array] = []
    while len(contacts) < count:
        xy = rng.uniform(-HALF_MM, HALF_MM, (each, 2))
        apart = np.linalg.norm(xy[:, None] - xy[None], axis=-1)[np.triu_indices(each, 1)]
        if apart.min() >= closest:
            contacts.append(np.column_stack([xy, rng.uniform(*DEPTHS_MM, each)]))
    return np.array(contacts)


def report(name: str, law: NeighbourLaw, given: Array, wanted: Array) -> None:
    for kind, predicted in (("added", given), ("law", given + law.shift(given))):
        off = predicted - wanted
        place = np.hypot(off[..., 0], off[..., 1])
        print(
            f"{name:22s} {kind:6s} place: mean {place.mean():.3f}, median {np.median(place):.3f}, "
            f"95 % {np.quantile(place, 0.95):.3f} mm; depth: {np.abs(off[..., 2]).mean():.3f} mm"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=3000)
    parser.add_argument("--triples", type=int, default=2000)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    rng = np.random.default_rng(20260101)
    spec = PluginHost().sensors["tactip-127"]
    sensor = spec.load()(
        SensorContext(np.random.SeedSequence(0)), **spec.settings({"noise": "false"})
    )
    singles = draw_scenes(load_protocol("exp1").spec, "singles").scenes
    with sensor:
        pins = PinTracker.of([sensor.rest()])

        def watched(scenes: list[Scene]) -> tuple[Array, Array]:
            frames: list[Frame] = list(sensor.press_many(scenes))
            moved, sure = pins.track(pins.images(frames))
            return moved, np.tile(sure, (1, 2)).astype(np.float64)

        alone = np.array([[s.pose.x, s.pose.y, s.pose.depth] for s in singles])
        moved, count = watched(list(singles[:4000]))[0], len(pins.rest)
        nominal = np.zeros(len(moved), dtype=np.intp), np.zeros((1, 1 + 2 * count))
        field = FieldFamily.learn(alone[:4000], moved, *nominal, count).field
        print(f"fields vary in {field.ways} way from press to press")
        sets = []
        for count, each in ((options.pairs, 2), (options.triples, 3)):
            contacts = free_contacts(count, each, rng)
            moved, weight = watched([scene_of(c) for c in contacts])
            fitted = solve(field, moved, contacts, weight / NOISE_PX**2, 20).contacts
            sets.append((contacts, fitted))
    laws = {}
    for name in ("forward", "inverse"):
        given, wanted = [], []
        for contacts, fitted in sets:
            used = np.abs(fitted - contacts).max(axis=(1, 2)) < FARTHEST_MM
            used &= fitted[..., 2].min(axis=1) > SHALLOWEST_MM
            used &= np.arange(len(used)) % HELD_OUT > 0
            start, end = (contacts, fitted) if name == "forward" else (fitted, contacts)
            given.append(start[used])
            wanted.append(end[used] - start[used])
        # The effect of a third contact is read from the law of pairs, which therefore comes first.
        pairs = NeighbourLaw.learn(given[:1], wanted[:1], NeighbourLaw.none())
        laws[name] = NeighbourLaw.learn(given, wanted, pairs)
        for (contacts, fitted), label in zip(sets, ("pairs", "triples"), strict=True):
            held = np.arange(len(contacts)) % HELD_OUT == 0
            ends = (contacts, fitted) if name == "forward" else (fitted, contacts)
            report(f"{name}, {label}", laws[name], ends[0][held], ends[1][held])
    if options.write:
        path = Path(package.__file__).with_name("neighbours.npz")
        arrays: dict[str, Any] = {
            **{f"{n}_pair": law.pair.astype(np.float32) for n, law in laws.items()},
            **{f"{n}_crowd": law.crowd.astype(np.float32) for n, law in laws.items()},
        }
        np.savez_compressed(path, **arrays)
        print(f"wrote {path.name}, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
