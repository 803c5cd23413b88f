"""What is written over a collection, and compared when it goes on."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

from tactibench import UserError, __version__
from tactibench.datasets import FRAMES, Header
from tactibench_tactip.camera.driver import Camera
from tactibench_tactip.camera.gate import Reference
from tactibench_tactip.collecting.plan import Plan
from tactibench_tactip.settings import Settings

ALIKE_LEVELS = 6.0
"""Grey levels by which the undeformed sensor may differ on average when a collection goes on."""


def header_of(settings: Settings, plan: Plan, camera: Camera, image: tuple[int, int]) -> Header:
    """The header of a collection: going on needs the same configuration and the same camera."""
    lasting = settings.lasting()
    found = camera.read_back
    assert found is not None, "the camera is open"  # noqa: S101
    text = json.dumps(lasting, sort_keys=True)
    return Header(
        name="tactip",
        sensor={
            "name": settings.sensor.name,
            "plugin": f"tactibench_tactip {__version__}",
            "configuration": lasting,
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
            "camera": {**asdict(found), "fps": round(found.fps, 1)},
        },
        image=image,
        dome_radius_mm=settings.sensor.dome_radius_mm,
        frames={
            **FRAMES,
            "work": "z into the object; tool poses are in it: x, y, z mm, alpha, beta, gamma deg",
        },
        source={"importer": "tactibench hw collect", "presses": plan.what},
    )


def check_same_sensor(rest: Reference, before: Any, folder: str) -> None:
    """Raises UserError when the undeformed sensor does not look as it did when the data set was
    begun. before: (H, W) uint8 of then, None when it was not recorded."""
    if before is None:
        return
    difference = float(abs(rest.mean - before).mean())
    if difference > ALIKE_LEVELS:
        raise UserError(
            f"the undeformed sensor differs by {difference:.1f} grey levels from the one that "
            f"{folder} was begun with ({ALIKE_LEVELS:g} are allowed); put camera, light and sensor "
            "back as they were, or begin another data set."
        )
