"""The reference scenes as a folder of frames: pins where finite elements put them."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.optics.noise import streams
from tactibench_sim.reference_frames.scenes import RADIUS_MM, ReferenceScene, shipped_file
from tactibench_sim.reference_frames.sensor import reference_tips
from tactibench_sim.sensor import SimulatedTacTip

Images = npt.NDArray[np.uint8]
IMAGES, CONTACTS, SENSOR = "images", "contacts.csv", "sensor.json"
COLUMNS = ("sensor_image", "contact", "x_mm", "y_mm", "depth_mm", "radius_mm", "scene")


def frames(
    sensor: SimulatedTacTip, scenes: Sequence[ReferenceScene], seed: np.random.SeedSequence
) -> Images:
    """Return (S, H, W) or (S, H, W, 3) frames with the sensor's noise, one for each scene.

    Args:
        sensor: Sensor whose camera and pins are taken.
        scenes: S scenes.
        seed: Seed of the noise.

    Raises:
        UserError: The sensor has pins where the scenes have none.
    """
    points = np.stack([reference_tips(sensor, scene) for scene in scenes])
    return sensor.renderer.frames(points, streams(seed, 0, len(scenes)))


def write(
    folder: Path, sensor: SimulatedTacTip, scenes: Sequence[ReferenceScene], seed: int
) -> int:
    """Write images/*.png, contacts.csv and sensor.json into a new folder; return the count.

    contacts.csv has a row for each contact: image, number, x, y, depth past first touch and radius,
    mm, scene. images/init_0.png is the untouched sensor.

    Args:
        folder: New or empty folder.
        sensor: Sensor whose camera and pins are taken.
        scenes: Scenes, one image each.
        seed: Seed of the noise.

    Raises:
        UserError: The folder is not empty or no folder, an image cannot be written, or the sensor
            has pins where the scenes have none.
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
        writer = csv.writer(out)
        writer.writerow(COLUMNS)
        for name, scene in zip(names, scenes, strict=True):
            for k, (x, y, depth) in enumerate(scene.tips.tolist()):
                row = (f"{x:.6f}", f"{y:.6f}", f"{depth:.6f}", f"{RADIUS_MM:g}")
                writer.writerow((name, k, *row, scene.name))
    about = {"sensor": sensor.describe(), "seed": seed, "reference_sha256": shipped_file().digest}
    (folder / SENSOR).write_text(json.dumps(about, indent=1) + "\n")
    return len(images)
