"""Measure the time that the recipes ``default`` and ``paper`` of the U-Net need to reach one error.

    python benchmarks/time_to_accuracy.py [--presses 3600] [--target-mm 0.06] [--epochs-cap N]

The error is that of exp1, the mean of |error| over x, y and depth, here of 200 presses that are not
in the training; with a frame without an answer it is infinite. Both recipes are trained in one run
on the same simulated presses, seeds and threads, one after the other, ``paper`` in eager float32;
the time of each epoch includes its validation. The complete ``paper`` recipe takes a good half hour
on two cores: ``--epochs-cap`` ends it early, and then its time is a lower bound. The last lines are
the ratios of the two times, by the clock and by the processor's time, which other jobs on the
machine disturb less. The encoder is ``hertz`` with its default decoder.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from unittest import mock

import numpy as np
import torch

from tactibench import (
    Answer,
    Contacts,
    Frame,
    Grid,
    Indenter,
    ModelContext,
    Pose,
    Scene,
    SensorContext,
)
from tactibench.geometry import true_contacts
from tactibench.training import learned
from tactibench_heatmaps import HertzGaussian
from tactibench_sim import TacTip127
from tactibench_unet import UNet

Labelled = tuple[list[Frame], list[Contacts]]


class Reached(Exception):  # noqa: N818
    """Ends a training: the validation error is at the target, or the epoch at the cap."""


def exp1_error_mm(found: Sequence[Answer | None], truth: Sequence[Answer]) -> float:
    """Return the mean of |error| over x, y and depth of the best contacts, mm.

    It is inf where a frame has no contact.
    """
    errors = []
    for answer, true in zip(found, truth, strict=True):
        assert isinstance(answer, Contacts)  # noqa: S101 - the model is asked for contacts
        assert isinstance(true, Contacts)  # noqa: S101
        if not len(answer):
            return float("inf")
        errors.append([*(answer.xy[0] - true.xy[0]), answer.depth[0] - true.depth[0]])
    return float(np.abs(errors).mean())


class Watch:
    """A Progress that prints epochs, keeps their times and stops at a target or a cap."""

    def __init__(self, target_mm: float, cap: int | None) -> None:
        self.target_mm, self.cap = target_mm, cap
        self.began = self.began_cpu = 0.0
        self.reached = False
        self.last_s = self.last_cpu_s = 0.0
        self.best_mm = float("inf")

    def start(self, epochs: int, steps: int) -> None:  # noqa: ARG002
        self.began, self.began_cpu = time.perf_counter(), time.process_time()

    def step(self, loss: float) -> None: ...

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        self.last_s = time.perf_counter() - self.began
        self.last_cpu_s = time.process_time() - self.began_cpu
        error = float("inf") if validation_mm is None else validation_mm
        self.best_mm = min(self.best_mm, error)
        print(
            f"  epoch {epoch:2d}  {self.last_s:7.1f} s  processor {self.last_cpu_s:7.1f} s  "
            f"loss {loss:.5f}  {error:8.4f} mm",
            flush=True,
        )
        if error <= self.target_mm:
            self.reached = True
            raise Reached
        if epoch == self.cap:
            raise Reached

    def __str__(self) -> str:
        took = f"{self.last_s:.0f} s, {self.last_cpu_s:.0f} s of the processor"
        return took if self.reached else f"more than {took} (best {self.best_mm:.4f} mm)"


def presses(count: int, seed: int) -> Labelled:
    """Return frames and truth of single presses, x and y in +-6.4 mm, depth 0.5 to 6 mm."""
    rng = np.random.default_rng(seed)
    values = rng.uniform([-6.4, -6.4, 0.5], [6.4, 6.4, 6.0], (count, 3))
    scenes = [Scene(Indenter.single(), Pose(x, y, depth=depth)) for x, y, depth in values]
    with TacTip127(SensorContext(np.random.SeedSequence(seed))) as sensor:
        frames = list(sensor.press_many(scenes))
    return frames, [true_contacts(scene) for scene in scenes]


def measure(
    recipe: str,
    data: Labelled,
    held_out: Labelled,
    target_mm: float,
    cap: int | None,
    seed: int,
) -> Watch:
    """Train one recipe until it reaches the target, its end or the cap.

    Args:
        recipe: Name of the recipe.
        data: Frames and truth of the training.
        held_out: Frames and truth of the validation.
        target_mm: Error at which the training ends, mm.
        cap: Number of epochs after which the training ends; None: those of the recipe.
        seed: Seed of the training.
    """
    grid = Grid.centred(64, 0.4)
    model = UNet(ModelContext("contacts", grid, 6.0, encoder=HertzGaussian()), recipe=recipe)
    print(f"{recipe}: {model.recipe}")
    watch = Watch(target_mm, cap)
    try:
        rng = np.random.default_rng(seed)
        with mock.patch.object(learned, "position_error_mm", exp1_error_mm):
            model.fit(*data, validation=held_out, rng=rng, progress=watch)
    except Reached:
        pass
    print(f"{recipe}: mean error of {target_mm} mm after {watch}")
    return watch


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presses", type=int, default=3600)
    parser.add_argument("--target-mm", type=float, default=0.06)
    parser.add_argument("--epochs-cap", type=int, default=None, help="end each training here")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(
        f"{torch.get_num_threads()} threads, torch {torch.__version__}, {options.presses} presses"
    )
    data, held_out = presses(options.presses, options.seed), presses(200, options.seed + 1)
    watches = [
        measure(recipe, data, held_out, options.target_mm, options.epochs_cap, options.seed)
        for recipe in ("default", "paper")
    ]
    fast, slow = watches
    if not fast.reached:
        print("default did not reach the target: no ratio")
        return
    bound = "" if slow.reached else "at least "
    for name, ratio in (
        ("by the clock", slow.last_s / fast.last_s),
        ("by processor time", slow.last_cpu_s / fast.last_cpu_s),
    ):
        print(f"time to {options.target_mm} mm, paper / default, {name}: {bound}{ratio:.1f}")


if __name__ == "__main__":
    main()
