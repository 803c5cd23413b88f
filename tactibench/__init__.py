"""Benchmark for soft optical tactile sensors read by learned models.

Everything a plugin needs is exported here, and imported only when it is used:
``import tactibench`` loads neither numpy nor torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from tactibench.contacts import (
        Answer,
        Contacts,
        Frame,
        Grid,
        Indenter,
        PlatePose,
        Pose,
        Scene,
    )
    from tactibench.errors import UserError
    from tactibench.images import gray_frames
    from tactibench.plugins.base import (
        Encoder,
        FitReport,
        Model,
        ModelContext,
        Progress,
        Sensor,
        SensorContext,
    )
    from tactibench.plugins.hookspecs import hookimpl
    from tactibench.plugins.named import open_sensor
    from tactibench.plugins.parameters import training_parameters
    from tactibench.plugins.specs import (
        CommandSpec,
        EncoderSpec,
        ModelSpec,
        Parameter,
        SensorSpec,
    )

_HOME = {
    "Answer": "contacts",
    "CommandSpec": "plugins.specs",
    "Contacts": "contacts",
    "Encoder": "plugins.base",
    "EncoderSpec": "plugins.specs",
    "FitReport": "plugins.base",
    "Frame": "contacts",
    "Grid": "contacts",
    "Indenter": "contacts",
    "Model": "plugins.base",
    "ModelContext": "plugins.base",
    "ModelSpec": "plugins.specs",
    "Parameter": "plugins.specs",
    "PlatePose": "contacts",
    "Pose": "contacts",
    "Progress": "plugins.base",
    "Scene": "contacts",
    "Sensor": "plugins.base",
    "SensorContext": "plugins.base",
    "SensorSpec": "plugins.specs",
    "UserError": "errors",
    "gray_frames": "images",
    "hookimpl": "plugins.hookspecs",
    "open_sensor": "plugins.named",
    "training_parameters": "plugins.parameters",
}

__all__ = [
    "Answer",
    "CommandSpec",
    "Contacts",
    "Encoder",
    "EncoderSpec",
    "FitReport",
    "Frame",
    "Grid",
    "Indenter",
    "Model",
    "ModelContext",
    "ModelSpec",
    "Parameter",
    "PlatePose",
    "Pose",
    "Progress",
    "Scene",
    "Sensor",
    "SensorContext",
    "SensorSpec",
    "UserError",
    "__version__",
    "gray_frames",
    "hookimpl",
    "open_sensor",
    "training_parameters",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
