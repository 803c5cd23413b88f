"""The plugins that a run is made of, and the rules for what fits what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins import (
    CHANNELS,
    INSTANCE,
    Encoder,
    EncoderSpec,
    Model,
    ModelSpec,
    PluginHost,
    SensorSpec,
    Value,
)
from tactibench.protocols import LoadedProtocol, Protocol, board_spec
from tactibench.records import BoundSpec
from tactibench.run.request import (
    REFERENCE,
    SHOTS,
    RunRequest,
    TestOptions,
    data_folder,
    folder_label,
)

Sensor = BoundSpec[SensorSpec]

QUICK = {"epochs": "2", "mixing": "0"}
"""Parameters of a model in a quick run, where it has them. The second epoch shows that training
goes on after the first validation; --quick proves nothing else."""
INSTANCES = "instances"
"""Parameter of a sensor that spreads the training presses over several instances of it."""


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
    sensor: Sensor
    encoder: BoundSpec[EncoderSpec] | None
    regime: str
    test_sensor: Sensor | None = None

    @property
    def tested(self) -> Sensor:
        """Return the sensor that presses the test scenes."""
        return self.test_sensor or self.sensor

    def build_encoder(self) -> Encoder | None:
        """Build the encoder and return it; None where the model uses none."""
        return None if self.encoder is None else self.encoder.build()

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
    """Look the plugins of a run up and check that they fit together and the protocol.

    Raises:
        UserError: A plugin, a parameter or the regime does not exist, or something does not fit.
    """
    given = {kind: dict(values) for kind, values in request.parameters.items()}
    data_folder(request.data)
    models = host.models.for_answer(protocol.answer)
    model = models[request.model]
    default = protocol.defaults.sensor if request.data is None else "recorded"
    sensor_spec = host.sensors[request.sensor or default]
    encoder_spec = None
    if model.uses_encoder:
        name = request.encoder or model.default_encoder or protocol.defaults.encoder
        encoder_spec = host.encoders[name]
    regime = request.regime or next(iter(protocol.regimes))
    _refuse(_misfits(request, protocol, host, model, sensor_spec, encoder_spec, regime))
    if request.quick:
        known = {parameter.name for parameter in model.parameters}
        short = {name: value for name, value in QUICK.items() if name in known}
        given["model"] = {**short, **given.get("model", {})}
    encoder = None
    if encoder_spec is not None:
        encoder = BoundSpec.named(host.encoders, encoder_spec.name, given.get("encoder", {}))
    sensor = BoundSpec.named(host.sensors, sensor_spec.name, given.get("sensor", {}))
    components = Components(
        model=BoundSpec.named(models, model.name, given.get("model", {})),
        sensor=sensor,
        encoder=encoder,
        regime=regime,
        test_sensor=resolve_test_sensor(request.test, protocol, sensor, host),
    )
    if request.test.shots and not (request.in_worker or components.adapts):
        raise cannot_adapt(components.model.label)
    return components


def resolve_test_sensor(
    options: TestOptions, protocol: Protocol, sensor: Sensor, host: PluginHost
) -> Sensor | None:
    """Return the sensor that presses the test scenes; None where it is the training sensor.

    Args:
        options: The options of ``--test``.
        protocol: The protocol of the run.
        sensor: The training sensor.
        host: The plugins.

    Raises:
        UserError: The options do not fit the protocol or the sensor.
    """
    references = {spec.reference_of: spec.name for spec in host.sensors if spec.reference_of}
    _refuse(_test_misfits(options, protocol, sensor, references))
    if protocol.transfer is not None or options.data is not None:
        data_folder(options.data, "--test data=FOLDER")
        name = sensor.name if protocol.transfer is None else protocol.defaults.sensor
        target: Sensor = BoundSpec.named(host.sensors, name, options.parameters)
        return target
    if not options:
        return _one_instance(sensor) if _has_several(sensor) else None
    name = references[sensor.name] if options.reference else sensor.name
    tested: Sensor = BoundSpec.named(host.sensors, name, options.parameters)
    over = set(sensor.values) & set(tested.values) - set(options.parameters)
    taken_over = {name: sensor.values[name] for name in over}
    tested = BoundSpec(tested.spec, {**tested.values, **taken_over}, tested.origin)
    several = _has_several(tested)
    if several and INSTANCES not in options.parameters:
        tested, several = _one_instance(tested), False
    _refuse(_same_sensor(options, sensor, tested, several))
    return tested


def check_signals(components: Components, signals: Sequence[str], host: PluginHost) -> None:
    """Raise UserError where the model cannot read the signals of a sensor of the run.

    Args:
        components: Model and sensors of the run.
        signals: Kind of signal of the training and of the tested sensor, see ``Sensor.signal``.
        host: The plugins.
    """
    model = components.model.spec
    for sensor, signal in zip((components.sensor, components.tested), signals, strict=False):
        if signal not in model.reads:
            able = ", ".join(other.name for other in host.models if signal in other.reads)
            raise UserError(
                f"model {model.name!r} reads {' and '.join(model.reads)} frames, but sensor "
                f"{sensor.name!r} gives {signal} frames; models that read {signal}: "
                f"{able or 'none'}."
            )


def check_depth(components: Components, protocol: LoadedProtocol, host: PluginHost) -> None:
    """Raise UserError where presses of which the depth is not known can be no part of a run.

    Args:
        components: Model and sensors of the run.
        protocol: The protocol; it cannot rank by an error of depths.
        host: The plugins.
    """
    from tactibench.metrics import find_metric

    spec, model = protocol.spec, components.model.spec
    ranking = board_spec(spec.label).ranking
    if ranking is not None and find_metric(ranking.metric).needs_depth:
        raise UserError(
            f"protocol {spec.id!r} ranks by {ranking.metric}, but nobody knows how deep the "
            "presses of this recording are; take another protocol, or import it with --param "
            "depth=COLUMN."
        )
    if CHANNELS not in model.reads:  # those models learn whatever of a contact is known
        able = ", ".join(other.name for other in host.models if CHANNELS in other.reads)
        raise UserError(
            f"model {model.name!r} learns depths, but nobody knows how deep the presses of this "
            f"recording are; take one of {able}, or import it with --param depth=COLUMN."
        )


def cannot_adapt(model: str) -> UserError:
    """Return the error for a model that cannot adapt to labelled presses of the tested sensor."""
    return UserError(
        f"model {model} cannot adapt to labelled presses of another sensor; leave --test shots "
        "out, or take a model that writes adapt, such as kernel."
    )


def _refuse(misfits: Iterator[str]) -> None:
    """Raise UserError with the first sentence, if there is one: later rules build on the first."""
    sentence = next(misfits, None)
    if sentence is not None:
        raise UserError(sentence)


def _misfits(
    request: RunRequest,
    protocol: Protocol,
    host: PluginHost,
    model: ModelSpec,
    sensor: SensorSpec,
    encoder: EncoderSpec | None,
    regime: str,
) -> Iterator[str]:
    """Yield a sentence for everything that does not fit in a training."""
    asks, drawn = f"protocol {protocol.id!r}", protocol.split is not None
    if protocol.answer not in model.answers:
        yield (
            f"model {model.name!r} answers {' and '.join(model.answers)}, but {asks} asks for "
            f"{protocol.answer}; take another model."
        )
    if sensor.needs_data and request.data is None:
        yield (
            f"{asks} reads recorded frames with sensor {sensor.name!r}; name their folder with "
            "--data DIR."
        )
    if request.data is not None and not sensor.needs_data:
        yield (
            f"sensor {sensor.name!r} makes its own frames and takes no --data; leave one of the "
            "two out."
        )
    if sensor.needs_data and protocol.families:
        yield (
            f"{asks} presses hard cases, which the folder of sensor {sensor.name!r} does not hold; "
            "take a simulated sensor."
        )
    if not (sensor.needs_data or drawn or protocol.transfer):
        yield (
            f"{asks} takes the presses of a recorded folder, which sensor {sensor.name!r} does not "
            "have; use --sensor recorded --data DIR."
        )
    if regime not in protocol.regimes:
        yield f"{asks} has no regime {regime!r}; it has {', '.join(protocol.regimes)}."
    if encoder is None and (request.encoder or request.parameters.get("encoder")):
        yield f"model {model.name!r} uses no encoder; leave the encoder options out."
    if encoder is not None and encoder.kind not in model.encoders:
        fitting = [spec.name for spec in host.encoders if spec.kind in model.encoders]
        names = " or ".join(fitting)
        yield (
            f"encoder {encoder.name!r} is of kind {encoder.kind!r}, but model {model.name!r} "
            f"learns {' and '.join(model.encoders)}; "
            + (f"take --encoder {names}." if names else "no such encoder is installed.")
        )
    if holds_several(protocol, regime):
        ones = {
            f"model {model.name!r} predicts": model.max_contacts,
            f"encoder {encoder and encoder.name!r} shows": encoder and encoder.max_contacts,
        }
        for subject, most in ones.items():
            if most == 1:
                yield (
                    f"{subject} one contact per frame and cannot be trained in regime {regime!r}, "
                    "whose frames hold several; use --regime single."
                )


def holds_several(protocol: Protocol, regime: str) -> bool:
    """Return whether frames of a training regime hold several contacts."""
    return any(protocol.draw(name).indenter != "single" for name in protocol.regimes[regime])


def _test_misfits(
    options: TestOptions,
    protocol: Protocol,
    sensor: Sensor,
    references: dict[str, str],
) -> Iterator[str]:
    """Yield a sentence for everything that does not fit in a test on other frames."""
    asks, out = f"protocol {protocol.id!r}", f"leave --test {SHOTS} out"
    hidden = "--hidden-seed" if options.hidden else "--test"
    if options.shots and protocol.transfer is not None:
        counts = ", ".join(map(str, protocol.transfer.shots))
        yield f"{asks} shows {counts} labelled frames of its own accord; {out}."
    if options.shots and protocol.families:
        yield (
            f"{asks} tests many sensors at once, so no labelled presses of one can be shown; {out}."
        )
    if options.shots and protocol.sites is not None:
        yield f"{asks} shows no labelled frames of another recording; {out}."
    if options.shots and options.reference:
        yield (
            f"--test {REFERENCE} has its few scenes for the test alone and none to be shown with "
            f"labels; {out}."
        )
    if protocol.transfer is not None:
        if options.data is None:
            yield (
                f"{asks} tests on another sensor than it trains on; name the recording of that one "
                "with --test data=FOLDER."
            )
        if options.reference or options.hidden:
            option = hidden if options.hidden else f"--test {REFERENCE}"
            yield f"{asks} tests on a recording; leave {option} out."
        if protocol.plates is None and not sensor.spec.needs_data:
            yield (
                f"{asks} draws no presses for a sensor that makes its own frames, as "
                f"{sensor.name!r} does; use --data DIR."
            )
        return
    if of := sensor.spec.reference_of:
        yield (
            f"sensor {sensor.name!r} has nothing but {sensor.spec.scenes} to be tested on; use "
            f"--sensor {of} --test {REFERENCE}."
        )
    read = sensor.spec.needs_data
    if options.data is not None and not (read and (protocol.split or protocol.sites)):
        yield (
            f"--test data=FOLDER tests on another recording than --data, which {asks} cannot; of "
            "plates take protocol transfer, of a simulated sensor leave it out."
        )
    if (options.reference or options.hidden) and options.data is not None:
        yield f"--test data=FOLDER tests on a recording; leave {hidden} out."
    if options and read and options.data is None:
        yield (
            f"sensor {sensor.name!r} has the frames of its folder and can press no others; leave "
            f"{hidden} out."
        )
    if options.reference and options.hidden:
        yield (
            "--hidden-seed draws presses anew and reference scenes are not drawn; leave one of "
            "--hidden-seed and --test reference out."
        )
    if options.reference and sensor.name not in references:
        others = f"; {' and '.join(sorted(references))} have some" if references else ""
        yield (
            f"sensor {sensor.name!r} has no reference scenes{others}; take another sensor, or "
            "--test sensor.NAME=VALUE."
        )


def _same_sensor(
    options: TestOptions, sensor: Sensor, tested: Sensor, several: bool
) -> Iterator[str]:
    """Yield a sentence where the tested sensor is the trained one, or many sensors at once."""
    if several:
        yield (
            f"--test sensor.{INSTANCES} would test on the instances that models are trained on; "
            f"test on one that no training sees, --test sensor.{INSTANCE}=K with K from 0 to 9."
        )
    if tested.name != sensor.name or tested.values != sensor.values:
        return
    if options.shots:
        yield (
            f"--test {SHOTS}={options.shots} shows presses of another sensor than the trained one; "
            "name it with --test sensor.NAME=VALUE, for example sensor.instance=1."
        )
    if options.parameters or not options.hidden:
        texts = replace(options, hidden=False).texts  # --hidden-seed is no text of --test
        yield (
            f"--test {' --test '.join(texts)} is what the training frames are made with already; "
            "give another value, or leave --test out."
        )


def _has_several(sensor: Sensor) -> bool:
    """Return whether the presses of a sensor are spread over several instances."""
    count = sensor.values.get(INSTANCES, 0)
    return isinstance(count, int) and count > 1


def _one_instance(sensor: Sensor) -> Sensor:
    """Return the sensor with all presses on one instance, as it is tested."""
    return BoundSpec(sensor.spec, {**sensor.values, INSTANCES: 0}, sensor.origin)


def describe_target(tested: Sensor, options: TestOptions) -> str:
    """Return words for the tested sensor, such as "another individual (instance=1)".

    Args:
        tested: The sensor that presses the test scenes.
        options: The options of ``--test``.
    """
    if not replace(options, shots=0):
        return "the nominal sensor"
    values = [f"{name}={tested.values[name]}" for name in options.parameters]
    settings = f" ({', '.join(values)})" if values else ""
    if options.data is not None:
        return f"recording {folder_label(options.data)}{settings}"
    if options.reference:
        return f"{tested.spec.scenes}{settings}"
    if options.hidden:
        return f"hidden presses{settings}"
    kind = "individual" if set(options.parameters) == {INSTANCE} else "setting"
    return f"another {kind}{settings}"
