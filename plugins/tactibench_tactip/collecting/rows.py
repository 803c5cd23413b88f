"""A press as a sample of the data set."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any, Literal

from tactibench import Scene
from tactibench.datasets import Draft
from tactibench.lab import Press
from tactibench_tactip.camera.source import Image
from tactibench_tactip.settings import Pose6
from tactibench_tactip.station import Pressed

Outcome = Literal["ok", "bad_frame", "no_contact", "aborted"]

NOTHING = MappingProxyType(
    {
        "draw": "",
        "outcome": "",
        "reason": "",
        "depth_cmd_mm": 0.0,
        "depth_meas_mm": 0.0,
        "z0_mm": 0.0,
        "z0_method": "",
        "pose_cmd": (),
        "pose_meas_before": (),
        "pose_meas_after": (),
        "force_n": (),
        "t_settle_ns": 0,
        "robot_timestamp": (),
        "frames_median": 0,
        "looks": 0,
        "brightness_mean": 0.0,
        "brightness_std": 0.0,
        "saturated": 0.0,
        "n_pins": -1,
    }
)
"""Every key of ``extra``, in its order: each has this type in every row."""


def draft_of(
    press: Press, pressed: Pressed, *, session: str, attempt: int, method: str, reason: str
) -> Draft:
    """The sample of a press that came to its end; reason: why its frame is bad, "" when it is
    not."""
    judged, state = pressed.judged, pressed.state
    return Draft(
        judged.image,
        press.id,
        pressed.scene,
        press=press.name,
        session=session,
        t_frame_ns=judged.t_ns,
        extra=_extra(
            press,
            outcome="bad_frame" if reason else "ok",
            reason=reason,
            depth_meas_mm=pressed.scene.pose.depth,
            z0_mm=pressed.z0,
            z0_method=method,
            pose_cmd=_floats(pressed.commanded),
            pose_meas_before=_floats(pressed.before),
            pose_meas_after=_floats(pressed.after),
            force_n=[] if state.force_n is None else [float(value) for value in state.force_n],
            t_settle_ns=pressed.settled_ns,
            robot_timestamp=[] if state.time_s is None else [state.time_s],
            frames_median=len(pressed.frames),
            looks=pressed.looks,
            brightness_mean=judged.brightness,
            brightness_std=judged.contrast,
            saturated=judged.saturated,
            n_pins=judged.pins,
        ),
        status="bad" if reason else "ok",
        attempt=attempt,
    )


def aborted_draft(
    press: Press,
    image: Image,
    scene: Scene,
    *,
    outcome: Outcome,
    reason: str,
    session: str,
    attempt: int,
    z0: float,
    method: str,
) -> Draft:
    """The sample of a press that was given up; its image is of the undeformed sensor."""
    extra = _extra(
        press,
        outcome=outcome,
        reason=reason,
        z0_mm=z0,
        z0_method=method,
        brightness_mean=float(image.mean()),
        brightness_std=float(image.std()),
    )
    return Draft(
        image,
        press.id,
        scene,
        press=press.name,
        session=session,
        extra=extra,
        status="bad",
        attempt=attempt,
    )


def _extra(press: Press, **found: Any) -> dict[str, Any]:
    """What was found of a press, and nothing for the rest."""
    known = {"draw": press.draw, "depth_cmd_mm": float(press.scene.pose.depth), **found}
    assert known.keys() <= NOTHING.keys(), "keys of extra"  # noqa: S101
    empty = {key: [] if value == () else value for key, value in NOTHING.items()}
    return empty | known


def _floats(pose: Pose6) -> list[float]:
    return [float(value) for value in pose]
