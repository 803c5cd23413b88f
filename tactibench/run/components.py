"""The plugins a run is made of, resolved by name and described for its identity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from tactibench.errors import UserError
from tactibench.plugins.base import Encoder, Model, ModelContext, Sensor, SensorContext
from tactibench.plugins.discovery import Origin
from tactibench.plugins.host import Catalogue, PluginHost
from tactibench.plugins.specs import EncoderSpec, ModelSpec, SensorSpec, Value
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.identity import code_hash, code_mentions
from tactibench.records.record import Component, Record
from tactibench.run.request import QUICK_EPOCHS, RunRequest

REFERENCE_FRAMES = "reference_frames"
"""Folder of a plugin's package that makes reference frames. Models are tested on them, never
trained, so that it is no part of the code behind what else is in the package."""

SpecT = TypeVar("SpecT", ModelSpec, SensorSpec, EncoderSpec)


@dataclass(frozen=True)
class Part(Generic[SpecT]):
    """A spec with its parameters' values and the plugin it came from."""

    spec: SpecT
    values: Mapping[str, Value]
    origin: Origin

    @property
    def name(self) -> str:
        return self.spec.name

    def code(self) -> str:
        """Hash of the source of the package behind the spec. Raises UserError without one."""
        package, *inside = self.spec.target.partition(":")[0].split(".")
        alone = frozenset() if inside[:1] == [REFERENCE_FRAMES] else frozenset({REFERENCE_FRAMES})
        try:
            return code_hash(package, alone)
        except ModuleNotFoundError:
            self.spec.load()  # says in one sentence what does not load
            raise

    def mentions(self, *modules: str) -> bool:
        """Whether the source of the package behind the spec names one of the modules."""
        return code_mentions(self.spec.target.partition(":")[0].partition(".")[0], modules)

    def component(self) -> Component:
        """Return the part as a record names it."""
        defaults = {p.name: p.default for p in self.spec.parameters}
        changed = [name for name, value in self.values.items() if value != defaults[name]]
        return Component(name=self.name, parameters=dict(self.values), settings=changed)

    def label(self) -> str:
        """Name with the parameters that differ from their defaults."""
        return self.component().label


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """What presses the scenes of a run.

    tested: what presses the test scenes, None where it is the sensor.
    """

    sensor: Part[SensorSpec]
    regime: str
    tested: Part[SensorSpec] | None = None

    def build_sensor(self, context: SensorContext) -> Sensor:
        return self.sensor.spec.load()(context, **self.sensor.values)

    @property
    def test_sensor(self) -> Part[SensorSpec]:
        """What presses the test scenes."""
        return self.tested or self.sensor

    def build_test_sensor(self, context: SensorContext) -> Sensor:
        return self.test_sensor.spec.load()(context, **self.test_sensor.values)


@dataclass(frozen=True, kw_only=True)
class Parts(Sensors):
    """Model, sensor and encoder of a run."""

    model: Part[ModelSpec]
    encoder: Part[EncoderSpec] | None

    def build_encoder(self) -> Encoder | None:
        if self.encoder is None:
            return None
        return self.encoder.spec.load()(**self.encoder.values)

    def build_model(self, context: ModelContext) -> Model:
        return self.model.spec.load()(context, **self.model.values)

    @property
    def shows_surface(self) -> bool:
        """Whether the first map of the model, if it shows any, is the deformed surface."""
        return self.encoder is None or self.encoder.spec.shows_surface

    @property
    def encode_values(self) -> dict[str, Value]:
        """The encoder's parameters that change what a model is trained on."""
        if self.encoder is None:
            return {}
        decoding = {p.name for p in self.encoder.spec.parameters if p.decode_only}
        return {k: v for k, v in self.encoder.values.items() if k not in decoding}


def resolve_parts(request: RunRequest, protocol: LoadedProtocol, host: PluginHost) -> Parts:
    """Look the plugins up and check that they fit the protocol. Raises UserError."""
    keys = protocol.keys
    model = host.models[request.model]
    given = {kind: dict(values) for kind, values in request.parameters.items()}
    quick_epochs = request.quick and any(p.name == "epochs" for p in model.parameters)
    if quick_epochs and "epochs" not in given.get("model", {}):
        given.setdefault("model", {})["epochs"] = str(QUICK_EPOCHS)
    default_sensor = keys.defaults.sensor if request.data is None else "recorded"
    sensor = host.sensors[request.sensor or default_sensor]
    if keys.answer not in model.answers:
        raise UserError(
            f"model {model.name!r} answers {' and '.join(model.answers)}, but protocol {keys.id!r} "
            f"asks for {keys.answer}; take another model."
        )
    if sensor.needs_data and request.data is None:
        raise UserError(
            f"protocol {keys.id!r} reads recorded frames with sensor {sensor.name!r}; "
            "name their folder with --data DIR."
        )
    if request.data is not None and not sensor.needs_data:
        raise UserError(
            f"sensor {sensor.name!r} makes its own frames and takes no --data; "
            "leave one of the two out."
        )
    regime = _regime(request, protocol)
    several = any(keys.draw(name).indenter != "single" for name in keys.regimes[regime])
    if several and model.max_contacts == 1:
        raise _one_only(f"model {model.name!r}", regime)
    encoder = None
    if model.uses_encoder:
        encoder = _encoder(request.encoder or model.default_encoder, protocol, model, host)
        if several and encoder.max_contacts == 1:
            raise _one_only(f"encoder {encoder.name!r}", regime)
    elif request.encoder or given.get("encoder"):
        raise UserError(f"model {model.name!r} uses no encoder; leave the encoder options out.")
    return Parts(
        model=_part(host.models, model.name, given.get("model", {})),
        sensor=_part(host.sensors, sensor.name, given.get("sensor", {})),
        encoder=_part(host.encoders, encoder.name, given.get("encoder", {})) if encoder else None,
        regime=regime,
    )


def sensors_of(record: Record, host: PluginHost) -> Sensors:
    """What pressed the scenes of a record's run: the sensor that it names, as it was set.

    Raises UserError for one that is not installed, or has no such parameters.
    """
    stated = record.sensor
    spec = host.sensors[stated.name]
    values = spec.settings_of_record(stated.parameters)
    sensor = Part(spec, values, host.sensors.origins[spec.name])
    return Sensors(sensor=sensor, regime=record.regime)


def _part(catalogue: Catalogue[SpecT], name: str, given: Mapping[str, str]) -> Part[SpecT]:
    spec = catalogue[name]
    return Part(spec, spec.settings(given), catalogue.origins[name])


def _regime(request: RunRequest, protocol: LoadedProtocol) -> str:
    keys = protocol.keys
    regime = request.regime or next(iter(keys.regimes))
    if regime not in keys.regimes:
        raise UserError(
            f"protocol {keys.id!r} has no regime {regime!r}; it has {', '.join(keys.regimes)}."
        )
    return regime


def _one_only(what: str, regime: str) -> UserError:
    verb = "predicts" if what.startswith("model") else "shows"
    return UserError(
        f"{what} {verb} one contact per frame and cannot be trained in regime {regime!r}, whose "
        "frames hold several; use --regime single."
    )


def _encoder(
    name: str, protocol: LoadedProtocol, model: ModelSpec, host: PluginHost
) -> EncoderSpec:
    """The encoder of that name, or the protocol's; it must be of a kind that the model learns."""
    encoder = host.encoders[name or protocol.keys.defaults.encoder]
    if encoder.kind not in model.encoders:
        fitting = [spec.name for spec in host.encoders if spec.kind in model.encoders]
        raise UserError(
            f"encoder {encoder.name!r} is of kind {encoder.kind!r}, but model {model.name!r} "
            f"learns {' and '.join(model.encoders)}; "
            + (
                f"take --encoder {' or '.join(fitting)}."
                if fitting
                else "no such encoder is installed."
            )
        )
    return encoder


def data_folder(path: Path | None, option: str = "--data") -> Path | None:
    """The folder given with an option. Raises UserError when it is not there."""
    if path is not None and not path.is_dir():
        what = "is not a folder" if path.exists() else "does not exist"
        raise UserError(f"the data folder {path} {what}; check {option}.")
    return path


def plugin_versions(parts: Parts) -> dict[str, Any]:
    """Plugin -> distribution, version and source hash."""
    found = {part.origin: part.code() for part in (parts.model, parts.sensor, parts.test_sensor)}
    if parts.encoder is not None:
        found[parts.encoder.origin] = parts.encoder.code()
    return {
        origin.plugin: {
            "distribution": origin.distribution,
            "version": origin.version,
            "code": code[:16],
        }
        for origin, code in found.items()
    }
