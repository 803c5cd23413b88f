"""Names in a sweep's file: read, and checked against what there is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins.host import PluginHost
from tactibench.protocols.loader import load_protocol, protocol_files
from tactibench.sweep.keys import ANY, AXES
from tactibench.sweep.read import SweepFile


@dataclass(frozen=True)
class Named:
    """A plugin with settings of its own: "unet, width=32"."""

    name: str
    settings: Mapping[str, str]


def named(text: str) -> Named:
    """Read "NAME" or "NAME, KEY=VALUE, ...". Raises UserError."""
    name, *texts = (part.strip() for part in text.split(","))
    settings = {}
    for one in texts:
        key, equals, value = (part.strip() for part in one.partition("="))
        if not equals or not key:
            raise UserError(f"{text!r} is not understood; write NAME, KEY=VALUE, ...")
        if key in settings:
            raise UserError(f"{text!r} sets {key} twice; set it once.")
        settings[key] = value
    return Named(name, settings)


def protocol_of(file: SweepFile, text: str) -> str:
    """The name of a protocol that ships with tactibench, or an absolute path."""
    return text if text in protocol_files() else str(file.inside(text))


def check_names(file: SweepFile, host: PluginHost) -> None:
    """Raises UserError for a name or a setting that does not exist."""
    keys = file.keys
    regimes: dict[str, None] = {}
    for text in keys.protocol:
        known = text in protocol_files() or text.endswith(".toml")
        loaded = load_protocol(protocol_of(file, text) if known else text)
        regimes |= dict.fromkeys(loaded.keys.regimes)
    for catalogue, texts in (
        (host.models, keys.model),
        (host.encoders, keys.encoder),
        (host.sensors, keys.sensor),
    ):
        for one in map(named, texts):
            spec: Any = catalogue[one.name]
            spec.settings(one.settings)
    for regime in keys.regime:
        if regime not in regimes:
            raise UserError(f"no protocol has a regime {regime!r}; {did_you_mean(regime, regimes)}")
    models = {*keys.model, *(named(text).name for text in keys.model), ANY}
    for key, table, allowed in (
        ("device", keys.device, models),
        ("data", keys.data, {*keys.protocol, ANY}),
    ):
        for name in table:
            if name not in allowed:
                raise UserError(f"key '{key}.{name}': {did_you_mean(name, allowed)}")


def check_exclusions(file: SweepFile) -> None:
    """An exclusion of what is not in the lists is a slip of the pen: raises UserError."""
    for number, one in enumerate(file.keys.exclude, start=1):
        for axis in AXES:
            listed = [str(value) for value in getattr(file.keys, axis)]
            for value in map(str, getattr(one, axis)):
                if value not in listed:
                    near = did_you_mean(value, listed) if listed else f"there is no list {axis!r}."
                    raise UserError(f"key 'exclude.{number}.{axis}' names {value!r}; {near}")
