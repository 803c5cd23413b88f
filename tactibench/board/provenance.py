"""The provenance that a record states, compared with what can be derived of it.

A record states more than its answers prove: what was tested, what trained, what was counted.
Everything that the protocol, the options and the sensors determine is derived again and compared.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tactibench.board.derivation import Derived
from tactibench.board.record_forms import LABEL, SLACK, differs, look_alike, same, short
from tactibench.board.shipped import OURS
from tactibench.errors import UserError
from tactibench.plugins import EncoderSpec, ModelSpec, Parameter, PluginHost, SensorSpec
from tactibench.protocols import LoadedProtocol
from tactibench.records import Component, Record, canonical
from tactibench.run import DATA

TEXT = re.compile(r"(?!.*\.\.)[A-Za-z0-9_. -]{0,80}")
"""Form of the text of a parameter without choices: a name, which is not a path."""
MOST_PARAMETERS = 64
"""Most parameters of a model or encoder of others; of those that ship the largest has 43."""
LONGEST_PARAMETER = 40
"""Most characters of the name of a parameter of others, because it stands in the name of a row."""
FIT_SLACK = 1e-3
"""Relative tolerance of numbers that were fitted to the pins of a recording."""


def refuse_components(
    record: Record, protocol: LoadedProtocol, host: PluginHost, where: str
) -> None:
    """Raise UserError where model, encoder, sensors or plugins are not what ships under their name.

    Models and encoders that ship are checked by their specs. Of those of others only the form is
    checked; the rest is the submitter's word.

    Args:
        record: The record that is checked.
        protocol: Its protocol.
        host: The plugins that ship with tactibench.
        where: Name of the record in messages.
    """
    if record.regime not in protocol.spec.regimes:
        raise UserError(
            f"{where}: regime {record.regime!r} is none of protocol {protocol.spec.id!r}; it has "
            f"{', '.join(protocol.spec.regimes)}."
        )
    our_plugins: set[str] = set()
    others = 0
    components = (
        ("model", record.model, host.models),
        ("encoder", record.encoder, host.encoders),
        ("sensor", record.sensor, host.sensors),
        ("sensor.tested", record.test_sensor, host.sensors),
    )
    for place, component, catalogue in components:
        if component is None:
            continue
        spec: Any = catalogue.specs.get(component.name)
        if spec is None:
            if place.startswith("sensor"):
                raise UserError(
                    f"{where}: sensor {component.name!r} does not ship with tactibench, so its "
                    "presses cannot be made again here; only runs on sensors that do can be "
                    "verified."
                )
            others += 1
            _refuse_look_alike(component.name, catalogue.specs, f"{where}: {place}")
            _refuse_strange(component, f"{where}: {place}")
            _refuse_settings(component, f"{where}: {place}")
            continue
        our_plugins.add(catalogue.origins[component.name].plugin)
        _refuse_parameters(spec, component, f"{where}: {place}", test=place == "sensor.tested")
    stated = record.identity.plugins
    for name in sorted(our_plugins):
        if name not in stated or stated[name]["distribution"] != OURS:
            raise UserError(
                f"{where}: identity.plugins does not say that {name!r} is of tactibench, whose "
                "model, encoder or sensor the record names."
            )
    strangers = set(stated) - our_plugins
    of_ours = [name for name in sorted(strangers) if stated[name]["distribution"] == OURS]
    if of_ours or len(strangers) > others or (others and not strangers):
        raise UserError(
            f"{where}: identity.plugins names {', '.join(sorted(stated)) or 'none'}, but the "
            f"record's components are of {', '.join(sorted(our_plugins)) or 'others'}"
            f"{f' and {others} of others' if others else ''}."
        )
    _refuse_model(record, protocol, host, where)


def _refuse_model(record: Record, protocol: LoadedProtocol, host: PluginHost, where: str) -> None:
    model: ModelSpec | None = host.models.specs.get(record.model.name)
    if model is None:
        return
    if protocol.spec.answer not in model.answers:
        raise UserError(
            f"{where}: model {model.name!r} answers {' and '.join(model.answers)}, but the "
            f"protocol asks for {protocol.spec.answer}."
        )
    if model.uses_encoder != (record.encoder is not None):
        use = "uses an encoder" if model.uses_encoder else "uses no encoder"
        raise UserError(f"{where}: model {model.name!r} {use}, but the record says otherwise.")
    draws = [protocol.spec.draw(name) for name in protocol.spec.regimes[record.regime]]
    if model.max_contacts == 1 and any(draw.indenter != "single" for draw in draws):
        raise UserError(
            f"{where}: model {model.name!r} predicts one contact per frame and is not trained in "
            f"regime {record.regime!r}, whose frames hold several."
        )
    encoder = record.encoder and host.encoders.specs.get(record.encoder.name)
    if encoder and encoder.kind not in model.encoders:
        raise UserError(
            f"{where}: encoder {encoder.name!r} is of kind {encoder.kind!r}, which model "
            f"{model.name!r} does not learn."
        )


def _refuse_parameters(
    spec: ModelSpec | EncoderSpec | SensorSpec, component: Component, where: str, *, test: bool
) -> None:
    """Raise UserError for parameters that the spec does not have or does not allow."""
    try:
        today = spec.settings_of_record(component.parameters)
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    defaults = spec.defaults(today)
    must = set()
    for parameter in spec.parameters:
        name = parameter.name
        if name not in component.parameters:
            raise UserError(f"{where}.parameters lacks {name!r}, which every record states.")
        stated = component.parameters[name]
        # Values are compared as they are written: 0 and 0.0 are equal, but would make two rows.
        if str(stated) == "-0.0":
            raise UserError(f"{where}.{name} is -0.0; write 0.0.")
        if canonical(stated) != canonical(today[name]):
            raise UserError(f"{where}.{name} is {short(stated)}, but is read as {today[name]!r}.")
        _refuse_file(parameter, stated, where)
        if isinstance(stated, str) and not (parameter.choices or TEXT.fullmatch(stated)):
            raise UserError(f"{where}.{name} is {short(stated)}; it may be a name, or empty.")
        if stated != defaults[name]:
            must.add(name)
    if not test:
        _refuse_settings(component, where)


def _refuse_look_alike(name: str, shipped: Iterable[str], where: str) -> None:
    """Raise UserError where a name of others looks like one that ships."""
    for other in shipped:
        if look_alike(name) == look_alike(other):
            raise UserError(
                f"{where}.name is {name!r}, which looks like {other!r} of tactibench; give yours a "
                "name that nobody takes for it."
            )


def _refuse_strange(component: Component, where: str) -> None:
    """Raise UserError for parameters of others that a board could not show as parameters."""
    if len(component.parameters) > MOST_PARAMETERS:
        raise UserError(
            f"{where} has {len(component.parameters):,} parameters; at most {MOST_PARAMETERS} have "
            "room on a board."
        )
    for name, value in component.parameters.items():
        if len(name) > LONGEST_PARAMETER or not (
            not isinstance(value, str) or TEXT.fullmatch(value)
        ):
            raise UserError(
                f"{where}.{name[:60]} is {short(value)}; a name has at most {LONGEST_PARAMETER} "
                "characters, and a text is up to 80 letters, digits, spaces, '.', '_' and '-'."
            )


def _refuse_file(parameter: Parameter, stated: Any, where: str) -> None:
    if parameter.built_in and stated not in parameter.built_in:
        raise UserError(
            f"{where}.{parameter.name} is {short(stated)}, which names a file; nothing that a "
            "record names is opened, so a run on it cannot be verified."
        )


def _refuse_settings(component: Component, where: str) -> None:
    settings = component.settings
    if settings is not None and (
        len(set(settings)) < len(settings) or not set(settings) <= set(component.parameters)
    ):
        raise UserError(f"{where}.settings is {short(settings)}; it names parameters, each once.")


def refuse_underived(
    record: Record, derived: Derived, protocol: LoadedProtocol, where: str
) -> None:
    """Raise UserError where a record does not state what was derived from its sources.

    Args:
        record: The record that is checked.
        derived: The facts that it must state.
        protocol: Its protocol.
        where: Name of the record in messages.
    """
    identity = record.identity
    because = "its protocol, options and sensors give"
    pairs: list[tuple[str, Any, Any]] = [
        ("protocol.title", record.protocol.title, protocol.spec.title),
        ("identity.hidden", identity.hidden, derived.hidden),
        ("identity.shots", identity.shots is not None, derived.shots),
        ("sets of frames in identity.data", len(identity.data or []), derived.sets),
        ("sets of frames in identity.test_frames", len(identity.test_frames), derived.sets),
    ]
    stated = record.sensor.json_values()
    tested: Mapping[str, Any] | None = derived.sensor.get("tested")
    pairs.append(("sensor.tested", "tested" in stated, tested is not None))
    pairs += [
        (f"sensor.{name}", stated.get(name), derived.sensor.get(name))
        for name in ("origin", "range")
    ]
    recording = derived.sensor.get("recording")
    # Only the submitter can tell what a recording was that is not here.
    if (recording_stated := stated.get("recording")) is not None and derived.trained:
        # The name of the folder is free; its contents and its sensor are not.
        pairs += [
            (f"sensor.recording.{name}", recording_stated[name], recording and recording[name])
            for name in ("sha256", "sensor")
        ]
    for key, stated_value, derived_value in pairs:
        if not same(stated_value, derived_value):
            raise differs(where, key, stated_value, derived_value, because)
    if tested is not None:
        _refuse_tested(record, tested, derived.tested_values or {}, where, because)
    _refuse_data(record, derived, where, because)
    for released in identity.released:
        if not any(same(released, published) for published in derived.released):
            raise UserError(
                f"{where}: identity.released holds {short(released)}, which was not published for "
                "these test frames."
            )


def _refuse_tested(
    record: Record,
    tested: Mapping[str, Any],
    values: Mapping[str, Any],
    where: str,
    because: str,
) -> None:
    test = record.test_sensor
    assert test is not None  # noqa: S101 - the caller looked
    folders = [text for text in test.options if text.startswith(f"{DATA}=")]
    trained_on = tested.get("trained_on")
    if trained_on == "":  # on a recording that is not here
        label = (test.trained_on or "").removeprefix("real recording ")
        if not LABEL.fullmatch(label) or label == test.trained_on:
            raise UserError(f"{where}: sensor.tested.trained_on is {short(test.trained_on)}.")
        trained_on = test.trained_on
    pairs = (
        ("name", test.name, tested["name"]),
        ("asked", test.options, tested["asked"]),
        ("on", test.description, tested["on"]),
        ("presses", test.presses, tested["presses"]),
        ("trained_on", test.trained_on, trained_on),
    )
    for name, stated_value, derived_value in pairs:
        if not same(stated_value, derived_value):
            raise differs(where, f"sensor.tested.{name}", stated_value, derived_value, because)
    if any(not LABEL.fullmatch(text.partition("=")[2]) for text in folders):
        raise UserError(f"{where}: sensor.tested.asked names a folder by more than two names.")
    for name, value in test.parameters.items():
        if name in values and canonical(value) != canonical(values[name]):
            key = f"sensor.tested.parameters.{name}"
            raise differs(where, key, value, values[name], because)


def _refuse_data(record: Record, derived: Derived, where: str, because: str) -> None:
    data = record.data
    names = ["test", "published_frames"]
    if derived.trained:
        names += ["train", "validation", "rejected"]
    pairs = [(f"data.{name}", getattr(data, name), derived.data[name]) for name in names]
    if data.simulator and "simulator" in derived.data:
        stated = [error.json_values() for error in data.simulator]
        pairs.append(("data.simulator", stated, derived.data["simulator"]))
    seen = data.of_tested_sensor
    expected = derived.data.get("of_tested_sensor")
    pairs.append(("data.of_tested_sensor", seen is not None, expected is not None))
    if seen is not None and expected is not None:
        pairs += [
            (f"data.of_tested_sensor.{name}", getattr(seen, name), value)
            for name, value in expected.items()
            if name != "described"
        ]
        described = expected.get("described", {})
        pairs += [
            (f"data.of_tested_sensor.described.{name}", value, described.get(name))
            for name, value in seen.described.items()
            if name not in ("folder", "label")
        ]
        shown = [step.get("shots") for step in seen.adapted]
        if seen.adapted:
            pairs.append(("data.of_tested_sensor.adapted", shown, seen.labelled_frames))
    for key, stated_value, derived_value in pairs:
        slack = FIT_SLACK if ".described." in key else SLACK
        if not same(stated_value, derived_value, slack):
            raise differs(where, key, stated_value, derived_value, because)


def refuse_too_many(record: Record, host: PluginHost, most: int, where: str) -> None:
    """Raise UserError where a model that ships answers with more contacts than it can.

    Args:
        record: The record that is checked.
        host: The plugins that ship with tactibench.
        most: Largest number of contacts in one answer.
        where: Name of the record in messages.
    """
    model = host.models.specs.get(record.model.name)
    if model is not None and model.max_contacts is not None and most > model.max_contacts:
        raise UserError(
            f"{where}: a frame is answered with {most} contacts, but model {model.name!r} gives "
            f"{model.max_contacts} at most."
        )


def refuse_failures(record: Record, derived: Mapping[str, Any] | None, where: str) -> None:
    """Raise UserError unless a record counts the failures that are listed with its answers.

    Args:
        record: The record that is checked.
        derived: Result of ``failures_record`` for its answers; None where a failure ends the run.
        where: Name of the record in messages.
    """
    failures = record.data.failures
    stated = None if failures is None else failures.json_values()
    if not same(stated, derived):
        raise differs(where, "data.failures", stated, derived, "its answers give")


def on_word(derived: Derived) -> Sequence[str]:
    """Return the parts of an accepted record that rest on the submitter's word alone."""
    words = ["the model", "its training", "weights", "times", "frames and their hashes"]
    if not derived.trained:
        words.append("numbers of training frames")
    if derived.hidden:
        words.append("that its hidden seed was still secret")
    return words
