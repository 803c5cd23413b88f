"""Penetration of tips along the dome's normal: another way to the depth, for comparison."""

from __future__ import annotations

import math

import numpy as np

from tactibench.contacts import FloatArray, Scene
from tactibench.geometry import DOME_RADIUS_MM, tip_depths, tip_positions


def normal_penetration(scene: Scene, dome_radius: float = DOME_RADIUS_MM) -> FloatArray:
    """Return (K,) delta = R_d + R - |c - O| mm of every tip, for the tip depths of the scene.

    A plate's penetration along its normal is its depth, and so is that of a tip on a flat pad.
    """
    if scene.indenter.is_plate or math.isinf(dome_radius):
        return tip_depths(scene, dome_radius)
    tips = tip_positions(scene)
    reach = dome_radius + scene.indenter.radius
    rho_squared = (tips[:, :2] ** 2).sum(axis=1)
    height = np.sqrt(np.maximum(reach**2 - rho_squared, 0.0)) - tip_depths(scene, dome_radius)
    penetration: FloatArray = reach - np.sqrt(rho_squared + height**2)
    return penetration
