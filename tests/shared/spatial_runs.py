"""Three-dimensional finite-element runs on a way of depths, for the tests."""

import numpy as np

from tactibench_sim.fem.press import SPATIAL, SpatialPress


def press_scene(dome, tips, depths, *, mirror=False, fineness=None, settings=SPATIAL):
    """Yield the equilibria at each of ``depths`` (N, K), from tips that do not touch."""
    press = SpatialPress(dome, tips, depths, mirror=mirror, fineness=fineness, settings=settings)
    for row in np.asarray(depths, dtype=np.float64):
        press.move(row)
        yield press.field()
