"""Train on one session of a skin and test on another day's, to measure the effect of drift.

    tactibench data import path/to/eflesh/20250316_155729_probe first ...     # docs/data.md
    tactibench data import path/to/eflesh/20250317_134149_probe second ...
    python benchmarks/skin_drift.py first second kernel pins

The first session is divided by place: a fifth of its places is for the test, a twelfth of the rest
for validation, and all others for training. In the second session the same test places are tested,
so that no place was learned. The error at the depths of the second session is printed for both
days.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tactibench import Contacts, Frame, Grid, ModelContext
from tactibench.datasets import Recording, open_recording, own_workspace
from tactibench.geometry import true_contacts
from tactibench.plugins import PluginHost
from tactibench.run import NullProgress

NEAR_MM = 0.5
"""Presses of the first session count where they are at most this far outside of the depths of the
second."""


def presses(recording: Recording, rows: list[int]) -> tuple[list[Frame], list[Contacts]]:
    scenes = [recording.scenes[row] for row in rows]
    known_scenes = [scene for scene in scenes if scene is not None]
    frames = [
        Frame(recording.signal(row), float(row), scene.pose)
        for row, scene in zip(rows, known_scenes, strict=True)
    ]
    return frames, [
        true_contacts(scene, recording.dome_radius_mm or np.inf) for scene in known_scenes
    ]


def errors(found: list[Contacts], truth: list[Contacts]) -> np.ndarray:
    """Return the (N, 3) absolute errors of x, y and depth, mm; NaN for a miss."""
    return np.array(
        [
            np.abs([*(answer.xy[0] - true.xy[0]), answer.depth[0] - true.depth[0]])
            if len(answer)
            else [np.nan] * 3
            for answer, true in zip(found, truth, strict=True)
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("models", nargs="+")
    given = parser.parse_args()
    first, second = open_recording(given.first), open_recording(given.second)
    places = np.random.default_rng(1).permutation(sorted(set(first.presses)))
    held, stop = set(places[: len(places) // 5]), set(places[len(places) // 5 :: 12])

    def rows(recording: Recording, wanted: set[str]) -> list[int]:
        labelled = zip(recording.presses, recording.scenes, strict=True)
        return [
            row
            for row, (press, scene) in enumerate(labelled)
            if press in wanted and scene is not None
        ]

    second_scenes = [scene for scene in second.scenes if scene is not None]
    low, high = (f(scene.pose.depth for scene in second_scenes) for f in (min, max))
    same_day = [
        row
        for row in rows(first, held)
        if (scene := first.scenes[row]) is not None
        and low - NEAR_MM <= scene.pose.depth <= high + NEAR_MM
    ]
    space = own_workspace([s for s in first.scenes if s is not None], np.inf, always=True)
    assert space is not None  # noqa: S101 - the first session has presses
    context = ModelContext(
        "contacts", Grid.centred(64, space.half_width_mm / 16), space.depth_max_mm
    )
    host = PluginHost()
    print(f"depth {low:.2f} to {high:.2f} mm, {len(held)} places; mean absolute error, mm")
    print("model      day          x      y  depth   mean  missed  n")
    for name in given.models:
        spec = host.models[name]
        model = spec.build(context, **spec.settings({}))
        training = presses(first, rows(first, set(places) - held - stop))
        model.fit(
            *training,
            validation=presses(first, rows(first, stop)),
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )
        for day, recording, tested in (
            ("the same", first, same_day),
            ("another", second, rows(second, held)),
        ):
            frames, truth = presses(recording, tested)
            answers = [answer for answer in model.predict(frames) if isinstance(answer, Contacts)]
            error = errors(answers, truth)
            x, y, depth = np.nanmean(error, axis=0)
            missed = np.isnan(error[:, 0]).mean()
            print(
                f"{name:10} {day:9} {x:6.3f} {y:6.3f} {depth:6.3f} {(x + y + depth) / 3:6.3f} "
                f"{missed:7.1%}  {len(tested)}"
            )


if __name__ == "__main__":
    main()
