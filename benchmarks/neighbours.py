"""Fit the effect of contacts on each other to finite-element mechanics, and print its errors.

    PYTHONPATH=.:plugins python -P benchmarks/neighbours.py [--pairs 6000] [--write]

All presses are of the nominal simulated tactip-127, pins without noise. For several coefficients of
friction, single presses give the field; friction differs from press to press. Pairs and triples at
random places and depths (5.5 mm apart or more) are fitted by as many single contacts as they have
and the number of the press, and the law gives the shift of those from the true ones. Printed is the
error of both directions of the law on presses to which it was not fitted, beside that of plain
addition. ``--write`` replaces the coefficients that ship (tactibench/superposition/neighbours.npz).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import tactibench.superposition as package
from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.geometry import DOME_RADIUS_MM, tip_depths
from tactibench.protocols import draw_scenes, load_protocol
from tactibench.superposition import FieldFamily, NeighbourLaw, drag_clue, solve
from tactibench_sim import TacTip127

Array = npt.NDArray[np.float64]

HALF_MM, DEPTHS_MM, CLOSEST_MM, TIP_MM = 6.4, (0.5, 6.0), 5.5, 3.0
FARTHEST_MM, SHALLOWEST_MM = 1.5, 0.1
"""A fit that is farther from the truth, or shallower, has lost its contact and is left out."""
HELD_OUT = 5
FRICTIONS = (0.0, 0.25, 0.5, 1.0)
"""Coefficients of friction; the law is linear between them."""
WITHIN = 0.13
"""Standard deviation of the friction from press to press, as a share: that of the sensor."""
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


def displacements(sensor: TacTip127, scenes: Sequence[Scene], rng: np.random.Generator) -> Array:
    """Return the (S, 2 P) displacements of the pins, px; each press has its own friction."""
    shares = (1 + WITHIN * rng.standard_normal(len(scenes))).clip(0.1, None)
    at_rest = Scene(Indenter.single(), Pose())
    x, y, _ = sensor.renderer.project(sensor.rubbed([at_rest, *scenes], np.append(1.0, shares)))
    return np.concatenate([x[1:] - x[0], y[1:] - y[0]], axis=1)


def laws_of(friction: float, pairs: int, triples: int) -> tuple[float, dict[str, NeighbourLaw]]:
    """Return the clue of a field with this friction, and the laws "forward" and "inverse"."""
    rng = np.random.default_rng(20260101)
    sensor = TacTip127(SensorContext(np.random.SeedSequence(0)), friction=friction)
    singles = draw_scenes(load_protocol("exp1").spec, "singles").scenes[:4000]
    alone = np.array([[s.pose.x, s.pose.y, s.pose.depth] for s in singles])
    moved = displacements(sensor, singles, rng)
    moved += NOISE_PX * rng.standard_normal(moved.shape)
    nominal = np.zeros(len(moved), dtype=np.intp), np.zeros((1, 1 + moved.shape[1]))
    field = FieldFamily.learn(alone, moved, *nominal, moved.shape[1] // 2).field
    clue, sets = drag_clue(field, moved.shape[1] // 2), []
    print(f"friction {friction:g}: clue {clue:.3f}, numbers of a press: {field.ways}")
    for count, each in ((pairs, 2), (triples, 3)):
        contacts = free_contacts(count, each, rng)
        moved = displacements(sensor, [scene_of(c) for c in contacts], rng)
        weight = np.full(moved.shape[1], 1 / NOISE_PX**2)
        sets.append((contacts, solve(field, moved, contacts, weight, 20).contacts))
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
        of_pairs = NeighbourLaw.learn(given[:1], wanted[:1], NeighbourLaw.none())
        laws[name] = NeighbourLaw.learn(given, wanted, of_pairs)
        for (contacts, fitted), label in zip(sets, ("pairs", "triples"), strict=True):
            held = np.arange(len(contacts)) % HELD_OUT == 0
            ends = (contacts, fitted) if name == "forward" else (fitted, contacts)
            report(f"{name}, {label}", laws[name], ends[0][held], ends[1][held])
    return clue, laws


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=6000)
    parser.add_argument("--triples", type=int, default=4000)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    clues, laws = zip(
        *(laws_of(mu, options.pairs, options.triples) for mu in FRICTIONS), strict=True
    )
    if options.write:
        path = Path(package.__file__).with_name("neighbours.npz")
        arrays: dict[str, Any] = {"clues": np.array(clues)}
        for name in ("forward", "inverse"):
            for part in ("pair", "crowd"):
                values = [getattr(each[name], part) for each in laws]
                arrays[f"{name}_{part}"] = np.array(values, dtype=np.float32)
        np.savez_compressed(path, **arrays)
        print(f"wrote {path.name}, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
