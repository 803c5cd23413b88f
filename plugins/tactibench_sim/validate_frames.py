"""The reference scenes as frames: pins where finite elements put them, seen by a camera."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.noise import streams
from tactibench_sim.reference import ReferenceScene, shipped_file
from tactibench_sim.sensor import SimulatedTacTip

Images = npt.NDArray[np.uint8]
IMAGES, CONTACTS, SENSOR = "images", "contacts.csv", "sensor.json"
COLUMNS = ("sensor_image", "contact", "x_mm", "y_mm", "depth_mm", "radius_mm", "scene")
_SAME = 1e-9


def frames(
    sensor: SimulatedTacTip, scenes: Sequence[ReferenceScene], seed: np.random.SeedSequence
) -> Images:
    """(S, H, W) or (S, H, W, 3) frames with the sensor's noise, one for each scene.

    Raises UserError for a sensor with other pins than the scenes have.
    """
    points = np.stack([_tips(sensor, scene) for scene in scenes])
    return sensor.renderer.frames(points, streams(seed, 0, len(scenes)))


def _tips(sensor: SimulatedTacTip, scene: ReferenceScene) -> npt.NDArray[np.float64]:
    """(P, 3) tips of the sensor's pins, from the dome's centre, mm."""
    along = sensor.directions @ scene.directions.T
    pin = along.argmax(axis=1)
    if (along[np.arange(len(pin)), pin] < 1 - _SAME).any():
        raise UserError(
            "the sensor has pins where the reference scenes have none; take tactip-127 or "
            "tactip-331."
        )
    base = sensor.mechanics.inner * scene.directions[pin] + scene.displacement[pin]
    tips: npt.NDArray[np.float64] = base - sensor.pin_length * scene.normals[pin]
    return tips


def write(
    folder: Path, sensor: SimulatedTacTip, scenes: Sequence[ReferenceScene], seed: int
) -> int:
    """Write images/*.png, contacts.csv and sensor.json into a new or empty folder; count frames.

    contacts.csv has a row for each contact: image, number, x, y, depth past first touch and radius,
    mm, scene. images/init_0.png is the untouched sensor. Raises UserError for a folder in use.
    """
    import cv2

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"{folder} is there already and is no empty folder; give a new one.")
    images = frames(sensor, scenes, np.random.SeedSequence(seed))
    names = [f"{scene.name}_d{scene.depth:.3g}.png" for scene in scenes]
    (folder / IMAGES).mkdir(parents=True, exist_ok=True)
    resting = sensor.rest().image
    for name, image in zip(("init_0.png", *names), (resting, *images), strict=True):
        stored = image[..., ::-1] if image.ndim == 3 else image  # OpenCV stores BGR
        if not cv2.imwrite(str(folder / IMAGES / name), stored):
            raise UserError(f"{folder / IMAGES / name} cannot be written.")
    with (folder / CONTACTS).open("w", newline="") as out:
        table = csv.writer(out)
        table.writerow(COLUMNS)
        for name, scene in zip(names, scenes, strict=True):
            for k, (x, y, depth) in enumerate(scene.tips.tolist()):
                row = (f"{x:.6f}", f"{y:.6f}", f"{depth:.6f}", f"{scene.asked.radius[0]:g}")
                table.writerow((name, k, *row, scene.name))
    about = {"sensor": sensor.describe(), "seed": seed, "reference_sha256": shipped_file().digest}
    (folder / SENSOR).write_text(json.dumps(about, indent=1) + "\n")
    return len(images)
