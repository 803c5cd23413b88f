"""Frames of a folder that knows what was pressed, for a protocol that draws its presses.

A recorded press belongs to a draw when the protocol could have drawn it. The presses of one kind of
indenter are divided by press: of those of the split's draw the same shares train, validate and test
as in the protocol, and other tested draws of that kind are taken from the tested share. A kind that
is both trained on and tested otherwise is halved. A recording with a split of its own is divided by
that instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactibench.contacts import Scene
from tactibench.protocols.draws import TIPS, fits
from tactibench.protocols.schema import Draw, Protocol, Split, Workspace
from tactibench.protocols.split import SPLIT_STREAM

_SAME_MM = 1e-6

Rows = dict[str, list[int]]
"""Draw -> rows of the recording."""


@dataclass(frozen=True)
class Matched:
    """Rows by draw and role. lacking: draws that the protocol needs and nothing was recorded for.

    left_out: rows that are of no draw.
    """

    fit: Rows
    validation: Rows
    test: Rows
    lacking: tuple[str, ...]
    left_out: int


def matches(scene: Scene, draw: Draw, workspace: Workspace) -> bool:
    """Whether the protocol could have drawn this press."""
    tips = np.array(scene.indenter.offsets)
    wanted = TIPS[draw.indenter]
    if len(tips) != wanted or abs(scene.indenter.radius - draw.radius_mm) > _SAME_MM:
        return False
    if scene.pose.tilt or not fits(scene, workspace):
        return False
    apart = np.linalg.norm(tips[:, None, :2] - tips[None, :, :2], axis=2)[
        np.triu_indices(wanted, 1)
    ]
    if draw.indenter == "dual":
        flat = abs(float(tips[0, 2] - tips[1, 2])) < _SAME_MM
        return flat and _among(float(apart[0]), draw.distances_mm)
    return all(_among(float(d), [draw.side_mm or 0.0]) for d in apart) and (
        draw.indenter == "single" or all(_among(float(h), draw.heights_mm) for h in tips[:, 2])
    )


def match(
    keys: Protocol,
    split: Split,
    regime: str,
    scenes: Sequence[Scene],
    presses: Sequence[str],
    parts: Sequence[str] | None = None,
) -> Matched:
    """Divide recorded presses between what a protocol trains on and tests.

    presses: of every scene, the press that it belongs to. parts: of every scene, the part of the
    recording's own split.
    """
    extra, tested = keys.regimes[regime], keys.test.sets
    needed = list(dict.fromkeys([split.draw, *extra, *tested]))
    pools = {
        name: [
            row
            for row, scene in enumerate(scenes)
            if matches(scene, keys.draw(name), keys.workspace)
        ]
        for name in needed
    }
    order = _order(sorted(set(presses)), keys.data_seed)
    whole = keys.draw(split.draw).count or 1
    end, start = split.test / whole, (split.test + split.validation) / whole
    main = keys.draw(split.draw).indenter

    def share(name: str, low: float, high: float, part: str) -> list[int]:
        """The rows whose press lies in this share of the pool's presses, or is of this part."""
        if parts is not None:
            return [row for row in pools[name] if parts[row] == part]
        ranks = {
            press: k
            for k, press in enumerate(
                sorted({presses[row] for row in pools[name]}, key=order.__getitem__)
            )
        }
        first, last = (_edge(edge, len(ranks)) for edge in (low, high))
        return [row for row in pools[name] if first <= ranks[presses[row]] < last]

    fit = {split.draw: share(split.draw, start, 1.0, "train")}
    validation = {split.draw: share(split.draw, end, start, "validation")}
    test = {}
    for name in tested:
        of_main = keys.draw(name).indenter == main
        also_trained = any(keys.draw(e).indenter == keys.draw(name).indenter for e in extra)
        high = end if of_main else 0.5 if also_trained else 1.0
        test[name] = share(name, 0.0, high, "test")
    for name in extra:
        both = any(keys.draw(t).indenter == keys.draw(name).indenter for t in tested)
        fit[name] = share(name, 0.5 if both else 0.0, 1.0, "train")
    kept = {presses[row] for rows in test.values() for row in rows}
    for name in extra:  # pools of one kind need not be alike
        fit[name] = [row for row in fit[name] if presses[row] not in kept]
    lacking = [name for rows in (fit, validation, test) for name in rows if not rows[name]]
    used = {row for name in needed for row in pools[name]}
    return Matched(fit, validation, test, tuple(dict.fromkeys(lacking)), len(scenes) - len(used))


def _among(value: float, allowed: Sequence[float]) -> bool:
    return any(abs(value - one) < _SAME_MM for one in allowed)


def _edge(share: float, count: int) -> int:
    """At least one press on either side of an edge inside, where there are so many."""
    inside = 0 < share < 1
    return min(max(round(share * count), int(inside)), count)


def _order(presses: Sequence[str], data_seed: int) -> Mapping[str, int]:
    """Press -> place in a seeded permutation."""
    seed = np.random.SeedSequence(data_seed, spawn_key=(SPLIT_STREAM,))
    places = np.random.default_rng(seed).permutation(len(presses))
    return dict(zip(presses, places.tolist(), strict=True))


def needs(draw: Draw) -> str:
    """What a draw is made of, in words."""
    tips = {"single": "one spherical tip", "dual": "two tips", "triple": "three tips"}
    text = f"{tips[draw.indenter]} of radius {draw.radius_mm:g} mm"
    if draw.distances_mm:
        text += f" {min(draw.distances_mm):g} to {max(draw.distances_mm):g} mm apart"
    if draw.side_mm is not None and not math.isclose(draw.side_mm, 0):
        text += f" {draw.side_mm:g} mm apart"
    return text
