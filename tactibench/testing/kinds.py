"""What can be checked, by kind and name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.plugins.specs import KINDS, EncoderSpec, Value
from tactibench.protocols.loader import load_protocol
from tactibench.testing import encoder as encoders
from tactibench.testing import model as models
from tactibench.testing import sensor as sensors
from tactibench.testing.pressed import PROTOCOL, Presser
from tactibench.testing.property import Property
from tactibench.testing.report import Finding, Report, run_checks

EXPECTED = "expected_failed_checks"
"""Attribute of a class behind a spec: property -> why it does not hold, by design."""
EPOCHS = "15"
"""Of models under test that have such a parameter: enough for the shipped ones to answer a contact
to frames like those of their training, and seconds on one core."""

Parameters = Mapping[str, Mapping[str, str]]
"""Kind -> parameter -> text, as of ``--param``."""


def properties(kind: str) -> tuple[Property, ...]:
    """All properties of a kind, in the order in which they are asked. Raises UserError."""
    found = {
        "model": models.PROPERTIES,
        "sensor": sensors.PROPERTIES,
        "encoder": encoders.PROPERTIES,
    }
    if kind not in found:
        raise UserError(f"there is no kind {kind!r}; allowed: {', '.join(KINDS)}.")
    return found[kind]


def subject_of(
    kind: str,
    name: str,
    *,
    parameters: Parameters | None = None,
    sensor: str = "",
    encoder: str = "",
    data: Path | None = None,
    host: PluginHost | None = None,
) -> Any:
    """What the properties of a kind are asked about.

    sensor: presses the frames of a model; "": the default one. encoder: what a model is trained
    through; "": its own or the default one. data: folder of a sensor that needs one. Raises
    UserError for names, parameters and options that do not exist or fit.
    """
    properties(kind)
    plugins, given = host or PluginHost(), parameters or {}
    for option, value, of in (
        ("sensor", sensor, "model"),
        ("encoder", encoder, "model"),
        ("data", data, "sensor"),
    ):
        if value and kind != of:
            raise UserError(
                f"--{option} belongs to the check of a {of}; leave it out, or say --kind {of}."
            )
    for other in given:
        if other != kind and not (kind == "model" and other == "encoder"):
            raise UserError(
                f"--param {other}.NAME does not belong to the check of a {kind}; leave it out, or "
                f"say --kind {other}."
            )
    if kind == "model":
        return _model(name, plugins, given, sensor, encoder)
    if kind == "encoder":
        spec = plugins.encoders[name]
        grid = load_protocol(PROTOCOL).keys.grid.grid()
        values = spec.settings(given.get(kind, {}))
        return encoders.EncoderSubject(_title(kind, name, plugins), spec, values, grid)
    needs = plugins.sensors[name]
    if needs.needs_data and data is None:
        raise UserError(
            f"sensor {name!r} reads recorded frames; name their folder with --data DIR."
        )
    if data is not None and not needs.needs_data:
        raise UserError(f"sensor {name!r} makes its own frames and takes no --data; leave it out.")
    values = needs.settings(given.get(kind, {}))
    return sensors.SensorSubject(_title(kind, name, plugins), needs, values, data)


def _model(
    name: str, host: PluginHost, given: Parameters, sensor: str, encoder: str
) -> models.ModelSubject:
    spec = host.models[name]
    own = dict(given.get("model", {}))
    if any(parameter.name == "epochs" for parameter in spec.parameters):
        own.setdefault("epochs", EPOCHS)
    through: tuple[EncoderSpec, Mapping[str, Value]] | None = None
    if spec.uses_encoder:
        default = spec.default_encoder or load_protocol(PROTOCOL).keys.defaults.encoder
        drawn = host.encoders[encoder or default]
        if drawn.kind not in spec.encoders:
            raise UserError(
                f"encoder {drawn.name!r} is of kind {drawn.kind!r}, but model {name!r} learns "
                f"{' and '.join(spec.encoders)}; take another encoder."
            )
        through = drawn, drawn.settings(given.get("encoder", {}))
    elif encoder or given.get("encoder"):
        raise UserError(f"model {name!r} uses no encoder; leave the encoder options out.")
    presser = Presser.of(host, sensor)
    title = f"{_title('model', name, host)} on frames of {presser.name}"
    return models.ModelSubject(title, spec, spec.settings(own), presser, through)


def expected_failures(subject: Any, given: Mapping[str, str] | None = None) -> dict[str, str]:
    """What the class behind the spec declares, and what is given beside it.

    A class that cannot be loaded declares nothing: the property ``target`` says why.
    """
    try:
        declared = getattr(subject.spec.load(), EXPECTED, {})
    except UserError:
        declared = {}
    return {**declared, **(given or {})}


def check(
    kind: str,
    name: str,
    *,
    expected_failed_checks: Mapping[str, str] | None = None,
    tell: Callable[[Finding], None] = lambda _: None,
    **options: Any,
) -> Report:
    """Ask all properties of one plugin.

    expected_failed_checks: property -> why it is expected to fail; what its class declares under
    that name is added. options: of ``subject_of``. Raises UserError as that does, and for an
    expected failure that names no property.
    """
    subject = subject_of(kind, name, **options)
    expected = expected_failures(subject, expected_failed_checks)
    return run_checks(properties(kind), subject, expected, tell)


def _title(kind: str, name: str, host: PluginHost) -> str:
    catalogue = host.catalogue(kind)
    return f"{kind} {name} of plugin {catalogue.origins[name]}"
