"""Entry points of the conformance kit: properties and subjects by kind and name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins import KINDS, EncoderSpec, PluginHost, Value
from tactibench.protocols import load_protocol
from tactibench.testing import encoder as encoder_checks
from tactibench.testing import model as model_checks
from tactibench.testing import sensor as sensor_checks
from tactibench.testing.subjects import (
    EXPECTED,
    PROTOCOL,
    SKIPPED,
    EncoderSubject,
    ModelSubject,
    Property,
    SensorPresses,
    SensorSubject,
    check_names,
    examine,
    properties_of,
)

EPOCHS = "15"
"""Epochs of a model under test that has such a parameter. With them the shipped models answer
frames like those of their training with a contact, and train in seconds on one core."""

PROPERTIES = {
    "model": properties_of(model_checks),
    "sensor": properties_of(sensor_checks),
    "encoder": properties_of(encoder_checks),
}
OPTION_KINDS = {"sensor": "model", "encoder": "model", "answer": "model", "data": "sensor"}
"""Option of ``subject_of`` -> kind of plugin that it belongs to."""

Parameters = Mapping[str, Mapping[str, str]]
"""Kind of plugin -> parameter -> text of its value, as in ``--param``."""


def properties(kind: str) -> tuple[Property, ...]:
    """Return all properties of a kind, in the order of their checks.

    Raises:
        UserError: The kind is none of "model", "sensor" and "encoder".
    """
    if kind not in PROPERTIES:
        raise UserError(f"there is no kind {kind!r}; allowed: {', '.join(KINDS)}.")
    return PROPERTIES[kind]


def subject_of(
    kind: str,
    name: str,
    *,
    parameters: Parameters | None = None,
    sensor: str = "",
    encoder: str = "",
    answer: str | None = None,
    data: Path | None = None,
    host: PluginHost | None = None,
) -> Any:
    """Return the subject on which the properties of a kind are checked.

    Args:
        kind: "model", "sensor" or "encoder".
        name: Name of the plugin's model, sensor or encoder.
        parameters: Kind -> parameter -> text of its value; for a model also those of its encoder.
        sensor: Sensor that presses the frames of a model; "" for the default one.
        encoder: Encoder that a model is trained through; "" for its own or the default one.
        answer: Kind of a model's answers, "contacts", "plate" or "sites"; None for contacts where
            it has them.
        data: Folder of recorded frames, for a sensor that needs one.
        host: Plugins; None for all installed plugins.

    Raises:
        UserError: A name, parameter or option does not exist, or they do not fit together.
    """
    properties(kind)
    host, given = host or PluginHost(), parameters or {}
    options = {"sensor": sensor, "encoder": encoder, "answer": answer, "data": data}
    strange = [
        f"--{option}" for option, owner in OPTION_KINDS.items() if options[option] and kind != owner
    ]
    fitting = {"model": ("model", "encoder")}.get(kind, (kind,))
    strange += [f"--param {other}.NAME" for other in given if other not in fitting]
    if strange:
        raise UserError(
            f"{strange[0]} does not belong to the check of {kind}s; leave it out, or name another "
            "--kind."
        )
    spec = host.catalogue(kind)[name]
    title = f"{kind} {name} of plugin {host.catalogue(kind).origins[name]}"
    if kind == "model":
        return _model_subject(title, host, name, given, sensor, encoder, answer or "")
    values = spec.settings(given.get(kind, {}))
    if kind == "encoder":
        grid = load_protocol(PROTOCOL).spec.grid.grid()
        return EncoderSubject(title, spec, values, grid)
    if spec.needs_data and data is None:
        raise UserError(
            f"sensor {name!r} reads recorded frames; name their folder with --data DIR."
        )
    if data is not None and not spec.needs_data:
        raise UserError(f"sensor {name!r} makes its own frames and takes no --data; leave it out.")
    return SensorSubject(title, spec, values, data)


def _model_subject(
    title: str,
    host: PluginHost,
    name: str,
    given: Parameters,
    sensor: str,
    encoder: str,
    answer: str,
) -> ModelSubject:
    spec = host.models.for_answer(answer)[name]
    if answer and answer not in spec.answers:
        raise UserError(
            f"model {name!r} answers {' and '.join(spec.answers)}, but not {answer!r}; leave "
            "--answer out."
        )
    settings = dict(given.get("model", {}))
    if any(parameter.name == "epochs" for parameter in spec.parameters):
        settings.setdefault("epochs", EPOCHS)
    trained_through: tuple[EncoderSpec, Mapping[str, Value]] | None = None
    if spec.uses_encoder:
        default = spec.default_encoder or load_protocol(PROTOCOL).spec.defaults.encoder
        encoder_spec = host.encoders[encoder or default]
        if encoder_spec.kind not in spec.encoders:
            raise UserError(
                f"encoder {encoder_spec.name!r} is of kind {encoder_spec.kind!r}, but model "
                f"{name!r} learns {' and '.join(spec.encoders)}; take another encoder."
            )
        trained_through = encoder_spec, encoder_spec.settings(given.get("encoder", {}))
    elif encoder or given.get("encoder"):
        raise UserError(f"model {name!r} uses no encoder; leave the encoder options out.")
    presses = SensorPresses.by_name(host, sensor)
    subject = ModelSubject(title, spec, spec.settings(settings), presses, trained_through, answer)
    if subject.signal not in spec.reads:
        raise UserError(
            f"model {name!r} reads {' and '.join(spec.reads)} frames, but sensor "
            f"{presses.name!r} gives {presses.sensor.signal}; name another one with --sensor."
        )
    source = "a drawn skin" if subject.answer_kind == "sites" else presses.name
    return replace(subject, title=f"{title} on frames of {source}")


def expected_failures(subject: Any, given: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the expected failures that the class of a subject declares, and the given ones.

    A class that cannot be loaded declares none: the property ``target`` reports why.

    Args:
        subject: The subject.
        given: Property -> reason why it is expected to fail.
    """
    try:
        declared = subject.spec.load().expected_failed_checks
    except UserError:
        declared = {}
    return {**declared, **(given or {})}


def conformance(
    kind: str,
    name: str,
    *,
    expected_failed_checks: Mapping[str, str] | None = None,
    **options: Any,
) -> Callable[[str], None]:
    """Return a pytest test with a parameter for every property of a model, sensor or encoder.

    Assign it to a name that pytest collects: ``test_conformance = conformance("model", "ridge")``.
    The plugin must be installed; it is looked up, and trained, when the first test runs.

    Args:
        kind: "model", "sensor" or "encoder".
        name: Name of the plugin's model, sensor or encoder.
        expected_failed_checks: Property -> reason why it is expected to fail; a listed property
            that holds is a failure.
        options: Options of ``subject_of``.

    Raises:
        UserError: The kind or a property is unknown, or an expected failure has no reason. It is
            raised at once, not in the test.
    """
    import pytest

    by_name = {one_property.name: one_property for one_property in properties(kind)}
    check_names(by_name.values(), expected_failed_checks or {})

    @cache
    def subject() -> Any:
        return subject_of(kind, name, **options)

    @pytest.mark.parametrize("property_name", list(by_name))
    def test_conformance(property_name: str) -> None:
        expected = expected_failures(subject(), expected_failed_checks)
        finding = examine(by_name[property_name], subject(), expected.get(property_name))
        if finding.outcome == SKIPPED:
            pytest.skip(finding.message)
        if finding.outcome == EXPECTED:
            pytest.xfail(finding.message)
        if not finding.ok:
            pytest.fail(f"{finding.checked.statement}: {finding.message}", pytrace=False)

    test_conformance.__doc__ = f"Every property of the {kind} {name!r}."
    return test_conformance
