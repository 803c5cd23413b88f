"""The plugins that a run is made of, resolved by name and checked against the protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins import (
    Encoder,
    EncoderSpec,
    Model,
    ModelContext,
    ModelSpec,
    PluginHost,
    SensorSpec,
    Value,
)
from tactibench.protocols import Protocol
from tactibench.records import BoundSpec
from tactibench.run.request import RunRequest

QUICK_EPOCHS = 2
"""The second epoch shows that training goes on after the first validation; --quick proves nothing
else."""


@dataclass(frozen=True, kw_only=True)
class Components:
    """Model, sensors and encoder of a run.

    Attributes:
        model: The model that is scored.
        sensor: The sensor that presses the training scenes.
        encoder: The encoder that the model learns through; None where it uses none.
        regime: Name of the training regime.
        test_sensor: The sensor that presses the test scenes; None where it is ``sensor``.
    """

    model: BoundSpec[ModelSpec]
    sensor: BoundSpec[SensorSpec]
    encoder: BoundSpec[EncoderSpec] | None
    regime: str
    test_sensor: BoundSpec[SensorSpec] | None = None

    @property
    def tested(self) -> BoundSpec[SensorSpec]:
        """Return the sensor that presses the test scenes."""
        return self.test_sensor or self.sensor

    def build_encoder(self) -> Encoder | None:
        """Build the encoder and return it; None where the model uses none."""
        return None if self.encoder is None else self.encoder.build()

    def build_model(self, context: ModelContext) -> Model:
        """Build the model, not trained, and return it."""
        model: Model = self.model.build(context)
        return model

    @property
    def adapts(self) -> bool:
        """Return whether the model can adapt to labelled presses of the tested sensor."""
        loaded: Any = self.model.spec.load()
        return loaded.adapt is not Model.adapt

    @property
    def shows_surface(self) -> bool:
        """Return whether the first map of the model, if it has any, is the deformed surface."""
        return self.encoder is None or self.encoder.spec.shows_surface

    @property
    def training_values(self) -> dict[str, Value]:
        """Return the encoder's parameters that change what a model is trained on."""
        if self.encoder is None:
            return {}
        decoding = {p.name for p in self.encoder.spec.parameters if p.decode_only}
        return {k: v for k, v in self.encoder.values.items() if k not in decoding}

    def plugin_versions(self) -> dict[str, Any]:
        """Return plugin -> distribution, version and source hash."""
        components = (self.model, self.sensor, self.tested, self.encoder)
        codes = {used.origin: used.code() for used in components if used is not None}
        return {
            origin.plugin: {
                "distribution": origin.distribution,
                "version": origin.version,
                "code": code[:16],
            }
            for origin, code in codes.items()
        }


def resolve_components(request: RunRequest, protocol: Protocol, host: PluginHost) -> Components:
    """Look the plugins up and check that they fit the protocol.

    Raises:
        UserError: A plugin, a parameter or the regime does not exist, or they do not fit together
            or the protocol.
    """
    given = {kind: dict(values) for kind, values in request.parameters.items()}
    model = _model(request, protocol, host)
    if request.quick and any(p.name == "epochs" for p in model.parameters):
        given.setdefault("model", {}).setdefault("epochs", str(QUICK_EPOCHS))
    sensor = _sensor(request, protocol, host)
    regime = _regime(request, protocol)
    many_tips = any(protocol.draw(name).indenter != "single" for name in protocol.regimes[regime])
    if many_tips and model.max_contacts == 1:
        raise _one_contact_only(f"model {model.name!r} predicts", regime)
    encoder = None
    if model.uses_encoder:
        encoder_spec = _encoder(request.encoder or model.default_encoder, protocol, model, host)
        if many_tips and encoder_spec.max_contacts == 1:
            raise _one_contact_only(f"encoder {encoder_spec.name!r} shows", regime)
        values = given.get("encoder", {})
        encoder = BoundSpec.named(host.encoders, encoder_spec.name, values)
    elif request.encoder or given.get("encoder"):
        raise UserError(f"model {model.name!r} uses no encoder; leave the encoder options out.")
    return Components(
        model=BoundSpec.named(host.models, model.name, given.get("model", {})),
        sensor=BoundSpec.named(host.sensors, sensor.name, given.get("sensor", {})),
        encoder=encoder,
        regime=regime,
    )


def _model(request: RunRequest, protocol: Protocol, host: PluginHost) -> ModelSpec:
    model = host.models[request.model]
    if protocol.answer not in model.answers:
        raise UserError(
            f"model {model.name!r} answers {' and '.join(model.answers)}, but protocol "
            f"{protocol.id!r} asks for {protocol.answer}; take another model."
        )
    return model


def _sensor(request: RunRequest, protocol: Protocol, host: PluginHost) -> SensorSpec:
    default = protocol.defaults.sensor if request.data is None else "recorded"
    sensor = host.sensors[request.sensor or default]
    if sensor.needs_data and request.data is None:
        raise UserError(
            f"protocol {protocol.id!r} reads recorded frames with sensor {sensor.name!r}; "
            "name their folder with --data DIR."
        )
    if request.data is not None and not sensor.needs_data:
        raise UserError(
            f"sensor {sensor.name!r} makes its own frames and takes no --data; "
            "leave one of the two out."
        )
    return sensor


def _regime(request: RunRequest, protocol: Protocol) -> str:
    regime = request.regime or next(iter(protocol.regimes))
    if regime not in protocol.regimes:
        raise UserError(
            f"protocol {protocol.id!r} has no regime {regime!r}; it has "
            f"{', '.join(protocol.regimes)}."
        )
    return regime


def cannot_adapt(model: str) -> UserError:
    """Return the error for a model that cannot adapt to labelled presses of the tested sensor."""
    return UserError(
        f"model {model} cannot adapt to labelled presses of another sensor; leave --test shots "
        "out, or take a model that writes adapt, such as kernel."
    )


def _one_contact_only(subject: str, regime: str) -> UserError:
    return UserError(
        f"{subject} one contact per frame and cannot be trained in regime {regime!r}, whose "
        "frames hold several; use --regime single."
    )


def _encoder(name: str, protocol: Protocol, model: ModelSpec, host: PluginHost) -> EncoderSpec:
    """Return the encoder of a name, or the protocol's where the name is empty.

    Raises:
        UserError: There is no such encoder, or the model does not learn encoders of its kind.
    """
    encoder = host.encoders[name or protocol.defaults.encoder]
    if encoder.kind in model.encoders:
        return encoder
    fitting = [spec.name for spec in host.encoders if spec.kind in model.encoders]
    remedy = f"take --encoder {' or '.join(fitting)}" if fitting else "no such encoder is installed"
    raise UserError(
        f"encoder {encoder.name!r} is of kind {encoder.kind!r}, but model {model.name!r} "
        f"learns {' and '.join(model.encoders)}; {remedy}."
    )
