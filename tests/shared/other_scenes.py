"""Finite-element scenes that made no table: other radii and spacings, other domes."""

from pathlib import Path

import numpy as np

from tactibench_sim import Tips, read_file, reference_scenes

FOLDER = Path(__file__).resolve().parents[1] / "sim" / "data"
INSTANCES = read_file(FOLDER / "instances.npz")
SPACINGS = reference_scenes(read_file(FOLDER / "spacings.npz"))
OTHER_TIPS = reference_scenes(read_file(FOLDER / "other_tips.npz"))


def sideways(name):
    """Return scenes of a run of scripts/fem/press_with_friction.py that goes down, then sideways.

    Each is the tips, the directions of the pins and the displacements of their bases, mm.
    """
    file = read_file(FOLDER / f"{name}.npz")
    rows, friction = file.arrays, np.array([file.parameters["friction"]])
    for tips, way, u in zip(rows["tips"], rows["way"], rows["u"], strict=True):
        xy, depth, move = tips[None, :, :2], tips[None, :, 2], np.tile(way, (1, len(tips), 1))
        scene = Tips(xy, depth, np.array([file.parameters["radius"]]), move, friction)
        yield scene, rows["directions"], u
