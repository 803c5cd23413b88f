"""A sensor: scenes -> frames."""

import numpy as np

from tactibench import Frame, Pose, Sensor, UserError
from tactibench.geometry import tip_positions

SIDE_PX, HALF_WIDTH_MM = 64, 10.0


class Lamp(Sensor):
    def __init__(self, context):
        self.frames = 0

    def rest(self):
        return Frame(np.zeros((SIDE_PX, SIDE_PX), np.uint8), 0.0, Pose(), None)

    def press(self, scene):
        tips = tip_positions(scene)
        if np.abs(tips[:, :2]).max() > HALF_WIDTH_MM:
            raise UserError(f"sensor 'lamp' sees +-{HALF_WIDTH_MM:g} mm, not {scene.pose}.")
        x = (np.arange(SIDE_PX) + 0.5) / SIDE_PX * 2 * HALF_WIDTH_MM - HALF_WIDTH_MM
        image = np.zeros((SIDE_PX, SIDE_PX), np.uint8)
        for tip in tips:
            image[np.hypot(x[None, :] - tip[0], x[:, None] - tip[1]) < 1.5] = 255
        self.frames += 1
        return Frame(image, self.frames / 30, scene.pose, self.rest().image)

    def describe(self):
        return {"sensor": "lamp", "version": 1}
