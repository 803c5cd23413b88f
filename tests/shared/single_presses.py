"""Single presses on the simulated sensor, at random within a range."""

import numpy as np

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.geometry import true_contacts
from tactibench_sim import TacTip127


def single_presses(count, seed, reach=4.0, depths=(1.0, 3.0), **parameters):
    """Frames and truth of presses up to ``reach`` mm from the middle, either way."""
    rng = np.random.default_rng(seed)
    scenes = [
        Scene(Indenter.single(), Pose(*rng.uniform(-reach, reach, 2), depth=rng.uniform(*depths)))
        for _ in range(count)
    ]
    sensor = TacTip127(SensorContext(np.random.SeedSequence(seed)), **parameters)
    return list(sensor.press_many(scenes)), [true_contacts(scene) for scene in scenes]
