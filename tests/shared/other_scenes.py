"""Finite-element scenes that made no table: other radii, other domes."""

from pathlib import Path

from tactibench_sim import read_file, reference_scenes

FOLDER = Path(__file__).resolve().parents[1] / "sim" / "data"
INSTANCES = read_file(FOLDER / "instances.npz")
OTHER_TIPS = reference_scenes(read_file(FOLDER / "other_tips.npz"))
