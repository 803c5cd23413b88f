"""What emulators are to run, and where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tactibench import Sensor
from tactibench_tactip.emulators.faults import Fault
from tactibench_tactip.emulators.log import Envelope
from tactibench_tactip.emulators.rig import Rig


@dataclass(frozen=True)
class Setup:
    """What is to run. sensor: a name for ``simulated`` with ``parameters``, or an object that can
    be pickled. ur, grbl, camera: keyword arguments of the emulators; None: not there.
    """

    sensor: str | Sensor = "tactip-127"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    rig: Rig = field(default_factory=Rig)
    envelope: Envelope | None = None
    time_scale: float = 1.0
    press_depth_mm: float = 0.4
    faults: tuple[Fault, ...] = ()
    ur: Mapping[str, Any] | None = None
    grbl: Mapping[str, Any] | None = None
    camera: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Ports:
    """ur: host; grbl: port for pyserial; camera: URL. None: not there."""

    ur: str | None = None
    grbl: str | None = None
    camera: str | None = None
