"""How fast the simulated TacTip makes frames, stage by stage, on one core.

    PYTHONPATH=.:plugins python benchmarks/generate.py

Prints the median of several rounds for both pin patterns, single and dual presses at 128 x 128:
scenes to loads and pin tips (field), tips to grey levels (render), noise to uint8 (noise), and
``press_many`` as a whole. The last line is the figure that matters: seconds for 5,000 presses.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim.contact import tips_of
from tactibench_sim.sensor import BATCH, SimulatedTacTip, TacTip127, TacTip331


def scenes(kind: str, count: int) -> list[Scene]:
    rng = np.random.default_rng(0)
    reach, deepest = (6.4, 6.0) if kind == "single" else (3.0, 4.0)
    indenter = Indenter.single() if kind == "single" else Indenter.dual(7.0)
    return [
        Scene(
            indenter,
            Pose(
                *rng.uniform(-reach, reach, 2), rng.uniform(-180, 180), 0, rng.uniform(0.5, deepest)
            ),
        )
        for _ in range(count)
    ]


def median_seconds(work: Callable[[], object], rounds: int) -> float:
    work()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def stages(sensor: SimulatedTacTip, several: list[Scene]) -> dict[str, Callable[[], object]]:
    batches = [several[k : k + BATCH] for k in range(0, len(several), BATCH)]
    mechanics, camera = sensor.mechanics, sensor.camera

    def field(batch: list[Scene]) -> np.ndarray:
        return mechanics.pin_tips(
            mechanics.loads(tips_of(batch)), sensor.directions, sensor.pin_length
        )

    tips = [field(batch) for batch in batches]
    clean = [camera.render(tip).astype(np.float32) for tip in tips]
    seed = np.random.SeedSequence(0)
    return {
        "field": lambda: [field(batch) for batch in batches],
        "render": lambda: [camera.render(tip).astype(np.float32) for tip in tips],
        "noise": lambda: [sensor.noise.expose(i, seed, k) for b in clean for k, i in enumerate(b)],
        "total": lambda: sum(1 for _ in sensor.press_many(several)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1024, help="presses a round")
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    print(f"{'sensor':12}{'scene':8}" + "".join(f"{s + ' us':>11}" for s in ("field", "render",
          "noise", "total")) + f"{'frames/s':>11}{'5,000 in s':>12}")  # fmt: skip
    for kind in (TacTip127, TacTip331):
        sensor = kind(SensorContext(np.random.SeedSequence(0)))
        for name in ("single", "dual"):
            work = stages(sensor, scenes(name, asked.count))
            each = {s: median_seconds(w, asked.rounds) / asked.count for s, w in work.items()}
            row = "".join(f"{1e6 * seconds:11.0f}" for seconds in each.values())
            print(
                f"tactip-{kind.pins:<5}{name:8}{row}{1 / each['total']:11.0f}"
                f"{5000 * each['total']:12.2f}"
            )
    limited = scenes("single", 200)
    sensor = TacTip127(SensorContext(np.random.SeedSequence(0)))
    seconds = median_seconds(lambda: [sensor.bound(s) for s in limited], asked.rounds) / 200
    print(f"bound, tactip-127, single: {1e3 * seconds:.2f} ms a scene")


if __name__ == "__main__":
    main()
