"""An encoder: contacts <-> maps."""

import numpy as np

from tactibench import Contacts, Encoder

MAX_DEPTH_MM = 6.0


class Cell(Encoder):
    channels = 1
    separation = 1.0
    tolerance = 0.3

    def encode(self, contacts, grid):
        x, y = grid.axes()
        maps = np.zeros((1, *grid.shape), np.float32)
        for (cx, cy), depth in zip(contacts.xy, contacts.depth, strict=True):
            maps[0, np.abs(y - cy).argmin(), np.abs(x - cx).argmin()] = depth / MAX_DEPTH_MM
        return maps

    def decode(self, maps, grid):
        x, y = grid.axes()
        rows, columns = np.nonzero(maps[0] > 0.05)
        heat = maps[0, rows, columns].astype(float)
        best = np.argsort(-heat)
        xy = np.column_stack([x[columns], y[rows]])[best]
        return Contacts(xy, heat[best] * MAX_DEPTH_MM, heat[best])
