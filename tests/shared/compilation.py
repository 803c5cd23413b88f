"""Compile numba's loops once, before the test processes start; each would compile them anew.

Two processes share the work: mechanics take about as long as all that reads frames.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MECHANICS = """
import numpy as np
from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.plugins.host import PluginHost
from tactibench.superposition import Field, solve

sensors = PluginHost().sensors
several = (Indenter.single(), Indenter.dual(7.0), Indenter.triple((0.0, 0.5, 1.0)))
spec = sensors["tactip-127"]
with spec.build(SensorContext(np.random.SeedSequence(1)), **spec.settings({})) as sensor:
    for frame in sensor.press_many(Scene(indenter, Pose(depth=2.0)) for indenter in several):
        pass
    sensor.bound(Scene(several[0], Pose(depth=2.0)))
rough = spec.settings({"friction": "0.5"})
with spec.build(SensorContext(np.random.SeedSequence(1)), **rough) as sensor:
    sensor.press(Scene(several[0], Pose(depth=2.0, dx=1.0)))
for name, indenter in (("planar-grid", Indenter.dual(7.0)), ("fitted-127", Indenter.plate())):
    spec = sensors[name]
    with spec.build(SensorContext(np.random.SeedSequence(1)), **spec.settings({})) as sensor:
        sensor.press(Scene(indenter, Pose(depth=2.0)))
rng = np.random.default_rng(1)
field = Field.learn(rng.uniform(1, 5, (20, 3)), rng.normal(size=(20, 8)))
solve(field, rng.normal(size=(1, 8)), np.ones((1, 1, 3)), np.ones(8))
"""
READERS = """
import numpy as np
from drawn_pins import presses
from tactibench import Contacts, Grid
from tactibench.markers import PinTracker, pin_graph
from tactibench.plugins.host import PluginHost

grid = Grid.centred(64, 0.4)
contacts = Contacts.truth([[0.0, 1.0]], [2.0])
for spec in PluginHost().encoders:
    for parameter in spec.parameters:
        for choice in parameter.choices or (parameter.default,):
            encoder = spec.build(**spec.settings({parameter.name: str(choice)}))
            maps = np.stack([encoder.encode(contacts, grid)] * 2)
            encoder.decode_batch(maps, grid)
frames, _ = presses(4, seed=1)
tracker = PinTracker(frames[0].rest)
images = tracker.images(frames)
xy, _ = tracker.track(images)
pin_graph(tracker.rest)
tracker.retrack(images, xy)
"""

SCRIPTS = {
    MECHANICS: ("plugins/tactibench_sim", "tactibench/superposition"),
    READERS: ("plugins/tactibench_heatmaps", "tactibench/markers"),
}
"""A script -> packages whose loops it compiles."""


def drop_stale_loops(package: Path) -> bool:
    """Remove numba's cache of a package with a newer module; return whether there is none now.

    numba looks at the file of a loop only: one that calls loops of a changed file would stay.
    """
    cached = [*(package / "__pycache__").glob("*.nb[ic]")]
    changed = max(source.stat().st_mtime for source in package.glob("*.py"))
    if cached and min(file.stat().st_mtime for file in cached) > changed:
        return False
    for file in cached:
        file.unlink()
    return True


def compile_loops() -> None:
    """Compile what is not in the cache; tests do not depend on it, they only start sooner."""
    path = os.pathsep.join([str(ROOT / "tests" / "shared"), *filter(None, sys.path)])
    running = [
        subprocess.Popen(
            [sys.executable, "-c", script],
            env={**os.environ, "PYTHONPATH": path},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for script, packages in SCRIPTS.items()
        if [name for name in packages if drop_stale_loops(ROOT / name)]  # each is looked at
    ]
    for process in running:
        process.wait()
