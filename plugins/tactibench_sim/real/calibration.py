"""The fit of the simulator to recorded presses as a file, with the frames that it used."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Self

from tactibench import UserError
from tactibench_sim.optics.camera import Optics

SHIPPED = {"": "calibration.json", "331": "calibration_331.json", "127": "calibration_127.json"}
"""Fits to the public recordings. "": version 1, to 200 presses of the 331-pin recording that were
hardly dragged. The others, to 400 presses each, include slip and a mount that gives way."""


@dataclass(frozen=True)
class Unknowns:
    """The fitted numbers, all of them global: none belongs to a single press.

    The fit begins at the defaults. With t the tilt label,

        travel = depth label + depth_offset_mm + pivot_mm (1 - cos t) + pivot_side_mm sin t,
        d = travel (1 - give_per_mm travel),

    where d is the indentation, mm: what holds the dome gives way. The plate's normal leaves the
    axis by t + tilt_offset_deg, in the plane at yaw_deg to the frame's x axis. The plate drags the
    skin, mm relative to the dome, in every press by

        drag_offset_mm + drag_per_depth d + drag_per_tilt d sin t,

    and in a press that was dragged also by drag_per_mm move + drag_per_deg turn, but at most by
    slip_mm d**slip_power, beyond which the plate slips.

    Attributes:
        depth_offset_mm: Travel at a depth label and a tilt of 0.
        pivot_mm: Height above the dome's centre of the point about which the robot turns the
            sensor (20: the apex).
        pivot_side_mm: Distance of that point from the dome's axis.
        tilt_offset_deg: Tilt of the plate at a tilt label of 0.
        yaw_deg: Direction on the frame in which the plate tilts.
        pin_length_mm: Effective lever; pins dragged along by the gel turn less than their base.
        air_mm: Distance from the camera to the window.
        gel_mm: Distance from the window to the apex (refraction at an index of 1.41; the window's
            thickness counts as gel).
        focal_px: Focal length.
        centre_x: Place of the optical axis in the frame, px.
        centre_y: Likewise.
        drag_per_mm: Drag per mm that the robot moved along the plate (label ``move``).
        drag_per_deg: Drag, mm, per deg that the robot turned (label ``turn``).
        drag_offset_mm: Drag of every press.
        drag_per_depth: Drag per mm of indentation.
        drag_per_tilt: Drag per mm of indentation and sine of the tilt.
        slip_mm: Drag at which the plate slips, at an indentation of 1 mm.
        slip_power: Exponent with which that drag grows with the indentation.
        give_per_mm: Share of the travel by which the dome gives way, per mm of travel.
        rest_x: Drift of all pins since the rest frame was taken, px.
        rest_y: Likewise.
    """

    depth_offset_mm: float = 5.0
    pivot_mm: float = 20.0
    pivot_side_mm: float = 0.0
    tilt_offset_deg: float = 0.0
    yaw_deg: float = 90.0
    pin_length_mm: float = 0.5
    air_mm: float = 2.0
    gel_mm: float = 24.0
    focal_px: float = 110.0
    centre_x: float = 0.0
    centre_y: float = 0.0
    drag_per_mm: float = -0.5
    drag_per_deg: float = 0.0
    drag_offset_mm: float = 0.0
    drag_per_depth: float = 0.0
    drag_per_tilt: float = 0.0
    slip_mm: float = 0.35
    slip_power: float = 1.0
    give_per_mm: float = 0.03
    rest_x: float = 0.0
    rest_y: float = 0.0

    def optics(self, side: int, lens: str = "fisheye", gel_index: float = 1.41) -> Optics:
        """Return the camera.

        Args:
            side: Side of the frames, px.
            lens: "pinhole" or "fisheye".
            gel_index: Refractive index of the gel.

        Raises:
            UserError: The unknowns fit no camera (``Optics``).
        """
        middle = (side - 1) / 2
        return Optics(
            size=side,
            camera_distance_mm=self.air_mm + self.gel_mm,
            lens=lens,
            focal=self.focal_px / side,
            principal_x=(self.centre_x - middle) / side,
            principal_y=(self.centre_y - middle) / side,
            gel_mm=self.gel_mm,
            gel_index=gel_index,
            window_mm=0.0,
        )


@dataclass(frozen=True)
class LabelFit:
    """Numbers of `tactibench data fit` on the fitted recording, which define all true indentations.

    ``depth_offset_mm``, ``pivot_mm`` and ``pivot_side_mm`` of ``Unknowns`` say where simulated
    fields meet the real ones best. Sensors and recordings state indentation as this fit does, so a
    fitted sensor is pressed deeper by the difference.

    Attributes:
        depth_offset_mm: As in ``Unknowns``.
        pivot_mm: As in ``Unknowns``.
        pivot_side_mm: As in ``Unknowns``.
    """

    depth_offset_mm: float
    pivot_mm: float
    pivot_side_mm: float


WITHOUT = {"slip_mm": math.inf, "slip_power": 0.0, "give_per_mm": 0.0, "rest_x": 0.0, "rest_y": 0.0}
"""Unknowns that a calibration of version 1 does not have, with the values that change nothing."""


@dataclass(frozen=True)
class Calibration:
    """The fit to a recording. Files are written by `tactibench sim real FOLDER --keep FILE`.

    Attributes:
        recording: sha256 of the recording.
        frames: Names of the frames that were fitted to.
        side: Side of the recording's frames, px.
        rest_centre: Mean place of the pins at rest, px.
        kind: Name of the dome (``plate.kinds``).
        unknowns: The fitted numbers.
        label_fit: The fit of the labels alone. None for version 1, whose sensors count indentation
            from their own first touch.
    """

    recording: str
    frames: tuple[str, ...]
    side: int
    rest_centre: tuple[float, float]
    kind: str
    unknowns: Unknowns
    label_fit: LabelFit | None = None

    def content(self) -> dict[str, Any]:
        """Return what a file holds; unknowns that change nothing are left out."""
        values = asdict(self.unknowns)
        needed = {name: v for name, v in values.items() if v != WITHOUT.get(name)}
        content = {**asdict(self), "unknowns": needed}
        return {name: value for name, value in content.items() if value is not None}

    def write(self, path: Path) -> None:
        """Write a JSON file.

        Raises:
            UserError: The file cannot be written.
        """
        try:
            path.write_text(json.dumps(self.content(), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror}.") from None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file of ``write``.

        Raises:
            UserError: The file is unreadable or no calibration.
        """
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            x, y = map(float, content["rest_centre"])
            unknowns = {**WITHOUT, **content["unknowns"]}
            label_fit = content.get("label_fit")
            return cls(
                str(content["recording"]),
                tuple(map(str, content["frames"])),
                int(content["side"]),
                (x, y),
                str(content["kind"]),
                Unknowns(**{name: float(value) for name, value in unknowns.items()}),
                label_fit and LabelFit(**{name: float(value) for name, value in label_fit.items()}),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise UserError(
                f"{path} is no calibration ({type(error).__name__}: {error}); make one with "
                "`tactibench sim real FOLDER --keep FILE`."
            ) from None


@cache
def shipped(name: str) -> Calibration:
    """Return a fit that ships, by its key in ``SHIPPED``."""
    with as_file(files(__package__).joinpath(SHIPPED[name])) as path:
        return Calibration.read(path)


def calibration(given: str) -> Calibration:
    """Return a fit by its name in ``SHIPPED`` or by the path of a file.

    Raises:
        UserError: The file is unreadable or no calibration.
    """
    return shipped(given) if given in SHIPPED else Calibration.read(Path(given))
