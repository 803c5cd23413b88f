"""The configuration of a setup: the checked tables of a TOML file, in millimetres and degrees.

Names and conventions are those of the Bristol robot stack: poses are (x, y, z, alpha, beta, gamma)
in mm and deg, extrinsic ``sxyz``; +z of the work frame and of the tool points into the object.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

from tactibench import Indenter, UserError
from tactibench.lab import parse_toml

Pose6 = tuple[float, float, float, float, float, float]
"""x, y, z mm, alpha, beta, gamma deg, extrinsic about x, y, z."""

Crop = tuple[NonNegativeInt, NonNegativeInt, PositiveInt, PositiveInt]
PoseInFile = Annotated[Pose6, Field(strict=False)]


BINDING = MappingProxyType(
    {
        "robot": ("driver", "press_mm_s"),
        "frames": ("moves", "work_frame", "tcp_pose", "sensor"),
        "camera": ("size", "fourcc", "crop", "exposure", "gain", "burst"),
        "sensor": ("name", "dome_radius_mm", "deepest_mm"),
        "contact": ("method", "at_mm", "fixed_mm"),
    }
)
"""Table -> keys that bind a data set, because its labels and frames depend on them. All others may
change: they decide what is refused, how long actions take and how long the program waits."""


SIMULATED = "simulated"
"""Address of the robot of a rehearsal."""
METRES, MOST_MM = 2.0, 5000.0
"""Distances from the origin, mm, between which a place must lie, unless it is the origin. A nearer
place was meant in m: no robot reaches 2 mm from its base, and no tool is so short. No table has a
place farther away than 5 m."""
QUARTER_RAD = 0.03
"""Difference within which a taught angle counts as a number of quarter turns, rad."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class RobotSettings(_Table):
    """The robot, and how fast it moves.

    Attributes:
        driver: Driver of the robot.
        address: A host (ur), a serial port or socket:// (grbl), ``package.module:callable`` that
            makes the robot (cri), or "simulated": a robot that exists in this program only, with a
            camera that shows a simulated sensor.
        connect_s: Time within which the robot must answer.
        watchdog_hz: Rate of the watchdog: a UR stops when it receives nothing for one period.
        home: Whether a stage whose position is not known drives to its switches before it moves:
            the way to them is free from everywhere.
        allow_unhomed: Whether to use a stage that has no switches.
        lacks: Settings that a stage's firmware does not have, such as "$13"; a person checked what
            they would say.
        set_tcp: Whether a UR uses frames.tcp_pose where the pendant's TCP is another one.
    """

    driver: Literal["ur", "grbl", "cri"]
    address: str = Field(min_length=1)
    # The least values are far below all useful ones, and above values that were meant in m.
    approach_mm_s: Annotated[float, Field(ge=0.2, le=100)] = 20.0
    press_mm_s: Annotated[float, Field(ge=0.05, le=20)] = 5.0
    retract_mm_s: Annotated[float, Field(ge=0.2, le=100)] = 50.0
    acceleration_mm_s2: Annotated[float, Field(ge=5, le=2000)] = 500.0
    connect_s: Annotated[float, Field(gt=0, le=120)] = 20.0
    watchdog_hz: Annotated[float, Field(ge=2, le=50)] = 10.0
    home: bool = False
    allow_unhomed: bool = False
    lacks: Annotated[tuple[str, ...], Field(strict=False)] = ()
    set_tcp: bool = False

    @property
    def homes(self) -> bool:
        """Return whether connecting may drive the robot to its switches."""
        return self.driver == "grbl" and self.home


class FrameSettings(_Table):
    """The places of robot, tool and sensor.

    Attributes:
        moves: The part that the robot carries.
        work_frame: Pose of the work frame in the robot's base. Its origin is the sensor's
            undeformed apex, or the indenter's foremost point where the sensor moves.
        tcp_pose: Pose of the tool in the flange.
        sensor: x, y mm of the apex and yaw deg of the image's x axis in the work frame (in the
            tool, where the sensor moves); ``hw calibrate`` measures it.
    """

    moves: Literal["indenter", "sensor"] = "indenter"
    work_frame: PoseInFile
    tcp_pose: PoseInFile = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    sensor: Annotated[tuple[float, float, float], Field(strict=False)] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        for name, pose in (("work_frame", self.work_frame), ("tcp_pose", self.tcp_pose)):
            distance = math.hypot(*pose[:3])
            if 0.0 < distance < METRES or distance > MOST_MM:
                raise ValueError(
                    f"frames.{name} lies {distance:g} mm from its origin; write x, y, z in mm, not "
                    "in m"
                )
            if _looks_like_radians(pose[3:]):
                raise ValueError(
                    f"frames.{name} is turned by {', '.join(f'{v:g}' for v in pose[3:])}, which "
                    "looks like radians; write degrees, extrinsic about x, y, z (an angle that "
                    "really is so small: 360 more)"
                )
        return self


def _looks_like_radians(angles: tuple[float, ...]) -> bool:
    """Return whether numbers look like the radians of quarter turns.

    All must lie within a whole turn in radians, and one of them, or their length as a rotation
    vector, must be a multiple of pi / 2, as a pendant shows it for a tool that points down.
    """
    if max(map(abs, angles)) > 2.0 * math.pi + QUARTER_RAD:
        return False
    quarters = [abs(value) / (0.5 * math.pi) for value in (*angles, math.hypot(*angles))]
    return any(round(q) > 0 and abs(q - round(q)) * 0.5 * math.pi < QUARTER_RAD for q in quarters)


class SensorSettings(_Table):
    """The sensor.

    Attributes:
        deepest_mm: Greatest depth past first touch.
        pins: Pins in a frame of the undeformed sensor; None: they are not counted.
        pins_tolerance: Pins that a frame may have fewer or more.
    """

    name: str = "tactip-127"
    dome_radius_mm: Annotated[float, Field(ge=1)] = 20.0
    deepest_mm: Annotated[float, Field(ge=0.1, le=12)] = 6.5
    pins: PositiveInt | None = None
    pins_tolerance: NonNegativeInt = 2

    def allows(self, count: int) -> bool:
        """Return whether a frame may show so many pins."""
        return self.pins is None or abs(count - self.pins) <= self.pins_tolerance

    @property
    def workspace(self) -> None:
        """None: a TacTip is pressed in the published range."""
        return None


class CameraSettings(_Table):
    """The camera.

    Attributes:
        source: A number, a path such as /dev/v4l/by-id/..., or an address.
        size: Width and height px; None: as the camera sends them.
        crop: x, y, width and height px of the part of the frame that is stored.
        exposure: Exposure in the backend's own unit; None: the camera stays as it is and must hold
            its brightness.
        burst: Frames of one sample; their median is stored.
        stall_s: Time without a frame after which the camera counts as stalled.
        noiseless: Whether it is a synthetic camera, whose frames may repeat to the last bit.
        lag_s: Time by which a frame may come late, besides its own period; frames are taken so
            much later, and a press that shows later ends the session.
    """

    source: str | int
    size: Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)] | None = None
    fps: PositiveFloat = 30.0
    fourcc: Annotated[str, Field(pattern=r"^[A-Za-z0-9]{4}$")] | None = None
    crop: Annotated[Crop, Field(strict=False)] | None = None
    exposure: float | None = None
    gain: float | None = None
    burst: Annotated[int, Field(ge=2, le=15)] = 3
    warmup_frames: Annotated[int, Field(ge=1, le=600)] = 60
    stall_s: Annotated[float, Field(gt=0, le=10)] = 1.0
    lag_s: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    noiseless: bool = False


class IndenterSettings(_Table):
    """The mounted indenter.

    Attributes:
        distance_mm: Distance between the tips of a dual.
        side_mm: Side of a triple.
        heights_mm: Heights of a triple's inserts, seen facing the tips, x right and y down: the tip
            below, upper left, upper right.
    """

    kind: Literal["single", "dual", "triple", "plate"] = "single"
    radius_mm: Annotated[float, Field(ge=0.1, le=50)] = 3.0
    distance_mm: PositiveFloat | None = None
    side_mm: PositiveFloat = 8.0
    heights_mm: Annotated[tuple[float, float, float], Field(strict=False)] | None = None

    @model_validator(mode="after")
    def _check_complete(self) -> Self:
        if (self.kind == "dual") != (self.distance_mm is not None):
            raise ValueError("distance_mm belongs to a dual indenter, and a dual needs it")
        if (self.kind == "triple") != (self.heights_mm is not None):
            raise ValueError("heights_mm belongs to a triple indenter, and a triple needs it")
        return self

    def indenter(self) -> Indenter:
        """Return the indenter of the vocabulary."""
        if self.kind == "plate":
            return Indenter.plate()
        if self.distance_mm is not None:
            return Indenter.dual(self.distance_mm, self.radius_mm)
        if self.heights_mm is not None:
            return Indenter.triple(self.heights_mm, self.side_mm, self.radius_mm)
        return Indenter.single(self.radius_mm)


class EnvelopeSettings(_Table):
    """Limits of the tool's centre point in the work frame.

    The tool stays in a box: x and y within +-half_width_mm, z from -above_mm to below_mm. It is
    turned by at most tilt_deg against the work frame's z, and yaw_deg about it.

    Attributes:
        clearance_mm: Distance before first touch at which all sideways motion is made.
        max_force_n: Greatest change of the force in a descent, where the robot measures it.
    """

    half_width_mm: Annotated[float, Field(ge=1, le=100)] = 12.0
    above_mm: Annotated[float, Field(ge=2, le=200)] = 60.0
    below_mm: Annotated[float, Field(ge=0.2, le=15)] = 10.0
    clearance_mm: Annotated[float, Field(ge=2, le=50)] = 10.0
    tilt_deg: Annotated[float, Field(ge=0, le=45)] = 25.0
    yaw_deg: Annotated[float, Field(ge=0, le=180)] = 180.0
    max_force_n: Annotated[float, Field(gt=0, le=50)] = 15.0


class ContactSettings(_Table):
    """The search for first touch.

    Attributes:
        every_presses: Presses after which first touch is searched again.
        every_minutes: Minutes after which it is searched again.
        travel_mm: Greatest travel before and beyond the expected place.
        at_mm: Place of the search on the sensor, x and y.
        fixed_mm: First touch of method fixed, past the work frame's zero.
        spread_mm: Greatest difference of two searches.
    """

    method: Literal["visual", "fixed"] = "visual"
    every_presses: PositiveInt = 250
    every_minutes: PositiveFloat = 30.0
    travel_mm: Annotated[float, Field(gt=0, le=10)] = 3.0
    at_mm: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)
    fixed_mm: float = 0.0
    spread_mm: PositiveFloat = 0.15


class TimingSettings(_Table):
    """The times of a press.

    Attributes:
        settle_s: Time from the end of the descent to the first frame that counts.
    """

    settle_s: Annotated[float, Field(ge=0, le=10)] = 0.2


class SafetySettings(_Table):
    """Reactions to faults.

    Attributes:
        give_up: Bad presses in a row that end a session.
    """

    give_up: PositiveInt = 5


class Settings(_Table):
    """One configuration file."""

    schema_: Literal[1] = Field(alias="schema")
    robot: RobotSettings
    frames: FrameSettings
    camera: CameraSettings
    sensor: SensorSettings = SensorSettings()
    indenter: IndenterSettings = IndenterSettings()
    envelope: EnvelopeSettings = EnvelopeSettings()
    contact: ContactSettings = ContactSettings()
    timing: TimingSettings = TimingSettings()
    safety: SafetySettings = SafetySettings()

    def with_changes(self, **tables: dict[str, Any]) -> Settings:
        """Return the settings with other values of keys, table by table; they are not checked."""
        changes = {
            name: getattr(self, name).model_copy(update=values) for name, values in tables.items()
        }
        return self.model_copy(update=changes)

    @property
    def simulated(self) -> bool:
        """Return whether robot and camera exist in this program only."""
        return self.robot.address == SIMULATED

    def rehearsal(self) -> Settings:
        """Return the settings with a simulated robot and camera, without keys of a real camera."""
        unset = dict.fromkeys(("size", "fourcc", "crop", "exposure", "gain"))
        return self.with_changes(
            robot={"address": SIMULATED}, camera={**unset, "fps": 100.0}, sensor={"pins": None}
        )

    def with_speed_scale(self, scale: float) -> Settings:
        """Return the settings with all speeds times ``scale``."""
        names = ("approach_mm_s", "press_mm_s", "retract_mm_s")
        return self.with_changes(robot={name: scale * getattr(self.robot, name) for name in names})

    def record(self) -> dict[str, Any]:
        """Return the tables for a record, without addresses and the mounted indenter."""
        tables = self.model_dump(mode="json", by_alias=True, exclude={"indenter", "safety"})
        for table, name in (("robot", "address"), ("robot", "connect_s"), ("camera", "source")):
            del tables[table][name]
        return tables

    def binding(self) -> dict[str, Any]:
        """Return the keys that may not change within a data set, table by table."""
        record = self.record()
        return {
            table: {name: record[table][name] for name in names} for table, names in BINDING.items()
        }


def read_settings(path: Path) -> Settings:
    """Return the settings of a file.

    Raises:
        UserError: The file is not there, or a key is wrong; the message names file and key.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise UserError(
            f"the configuration {path} is not there; `tactibench hw example` writes one to start "
            "from."
        ) from None
    settings = parse_toml(content, Settings, f"the configuration {path}")
    return settings.rehearsal() if settings.simulated else settings
