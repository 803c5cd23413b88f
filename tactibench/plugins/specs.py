"""Specs: the light, frozen descriptions by which a plugin declares what it has.

``target`` names the class behind a spec as ``"package.module:Class"``; it is imported on use.
A spec that cannot be right raises ValueError when it is made, so its author sees it at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins.parameter import Parameter, Value, text_of
from tactibench.plugins.targets import import_subclass, import_target

if TYPE_CHECKING:
    from tactibench.plugins.base import Encoder, Model, Sensor

KINDS = ("model", "sensor", "encoder")
ANSWERS = ("contacts", "plate")
IMAGE, CHANNELS = "image", "channels"
SIGNALS = (IMAGE, CHANNELS)
"""Kinds of signal: uint8 images of a camera, float32 channels of any other sensor."""
ORIGINS = ("simulated", "real")
VERSION = "version"
"""Parameter by which a sensor is chosen among its versions."""
RECIPE = "recipe"
"""Parameter by which a model is chosen among its recipes."""
INSTANCE = "instance"
"""Parameter by which one sensor of a make is chosen; 0 is the nominal one."""
NOMINAL = 0
"""Number of the nominal instance."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # it becomes part of folder names
_TARGET = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


@dataclass(frozen=True)
class _Spec:
    """The fields that models, sensors and encoders have in common.

    Attributes:
        retired: Parameter -> values that no longer exist -> the values that stand for them now.
    """

    name: str
    target: str
    summary: str
    parameters: tuple[Parameter, ...] = ()
    retired: Mapping[str, Mapping[str, str]] = field(default_factory=dict, hash=False, kw_only=True)

    def __post_init__(self) -> None:
        _check_names(self.name, self.target)
        object.__setattr__(self, "summary", text_of(self.name, "summary", self.summary))
        object.__setattr__(self, "parameters", tuple(self.parameters))
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError(f"{self.name!r} has two parameters of the same name")

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:  # noqa: ARG002
        """Return the value that every parameter has where only ``values`` are given."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def settings(self, given: Mapping[str, str]) -> dict[str, Value]:
        """Return the values of all parameters: those given as text, the others at their defaults.

        Raises:
            UserError: A parameter is unknown, or a value is not allowed.
        """
        by_name = {parameter.name: parameter for parameter in self.parameters}
        for name in given:
            if name not in by_name:
                raise UserError(
                    f"{self.name!r} has no parameter {name!r}; {did_you_mean(name, by_name)}"
                )
            instead = self.retired.get(name, {}).get(given[name])
            if instead is not None:
                allowed = ", ".join(str(choice) for choice in by_name[name].choices)
                raise UserError(
                    f"{self.name!r} no longer has {name}={given[name]}; take {name}={instead} "
                    f"instead{f' (allowed: {allowed})' if allowed else ''}."
                )
        set_values = {name: by_name[name].parse(text) for name, text in given.items()}
        return {**self.defaults(set_values), **set_values}

    def settings_of_record(self, stored: Mapping[str, object]) -> dict[str, Value]:
        """Return the settings that a record holds, in terms of today's parameters.

        Values in ``retired`` become those that stand for them now, and a retired parameter that no
        longer exists is left out. A parameter that is newer than the record has the value that it
        had then (``Parameter.before``).

        Args:
            stored: Name of a parameter -> value in the record.

        Raises:
            UserError: A parameter is unknown, or a value is not allowed.
        """
        today = {parameter.name for parameter in self.parameters}
        given = {p.name: str(p.before) for p in self.parameters if p.before is not None}
        for name, value in stored.items():
            if name in today or name not in self.retired:
                text = str(value)
                given[name] = self.retired.get(name, {}).get(text, text)
        return self.settings(given)


@dataclass(frozen=True)
class ModelSpec(_Spec):
    """A model: frames -> contacts or plate poses.

    Attributes:
        name: Name by which users call it.
        target: ``"package.module:Class"``, a subclass of ``tactibench.Model``.
        summary: One line for ``tactibench list``.
        parameters: Parameters that a user may set.
        answers: Kinds of answer that it can be trained for, of "contacts" and "plate".
        reads: Kinds of signal that it reads, of "image" and "channels" (see ``Sensor.signal``).
        max_contacts: Most contacts in a frame; None: any number.
        uses_encoder: Whether it is trained through an encoder.
        encoders: Kinds of encoder that it can be trained through.
        default_encoder: Name of the encoder that it takes when the user names none; "": the
            protocol's.
        recipes: Value of the parameter ``recipe`` -> defaults that differ in that recipe, by name
            of the parameter.
        deterministic: Whether nothing is drawn at random in a training on one sensor, so that every
            seed gives the same weights; ``tactibench check`` holds it to that. On a board one seed
            of such a model is enough, if it ships with tactibench.
    """

    answers: tuple[str, ...] = ("contacts",)
    reads: tuple[str, ...] = field(default=(IMAGE,), kw_only=True)
    max_contacts: int | None = None
    uses_encoder: bool = False
    encoders: tuple[str, ...] = ("heat",)
    default_encoder: str = ""
    recipes: Mapping[str, Mapping[str, Value]] = field(
        default_factory=dict, hash=False, kw_only=True
    )
    deterministic: bool = field(default=False, kw_only=True)

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the value that every parameter has where only ``values`` are given."""
        return {**super().defaults(values), **self.recipes.get(str(values.get(RECIPE)), {})}

    def load(self) -> Callable[..., Model]:
        """Import and return the class.

        Raises:
            UserError: The target cannot be imported, or is not a complete subclass.
        """
        from tactibench.plugins.base import Model

        return import_subclass(self.name, self.target, Model)  # type: ignore[type-abstract]

    def __post_init__(self) -> None:
        super().__post_init__()
        answers: object = self.answers
        if not isinstance(answers, tuple) or not answers or set(answers) - set(ANSWERS):
            raise ValueError(f"{self.name!r} has answers {answers!r}; a tuple of {ANSWERS}")
        reads: object = self.reads
        if not isinstance(reads, tuple) or not reads or set(reads) - set(SIGNALS):
            raise ValueError(f"{self.name!r} has reads {reads!r}; a tuple of {SIGNALS}")
        _check_count(self.name, self.max_contacts)
        deterministic: object = self.deterministic
        if not isinstance(deterministic, bool):
            raise ValueError(f"{self.name!r} has deterministic {deterministic!r}; True or False")
        encoders: object = self.encoders
        if not isinstance(encoders, tuple) or not encoders or not all(map(_is_name, encoders)):
            raise ValueError(f"{self.name!r} has encoders {encoders!r}; a tuple of kinds")
        if self.default_encoder and not (self.uses_encoder and _is_name(self.default_encoder)):
            raise ValueError(
                f"{self.name!r} has default_encoder {self.default_encoder!r}; the name of an "
                "encoder, of a model that uses one"
            )
        _check_variants(self, RECIPE, self.recipes)


@dataclass(frozen=True)
class SensorSpec(_Spec):
    """A sensor: scenes -> frames.

    Attributes:
        name: Name by which users call it.
        target: ``"package.module:Class"``, a subclass of ``tactibench.Sensor``.
        summary: One line for ``tactibench list``.
        parameters: Parameters that a user may set.
        origin: "simulated" or "real".
        needs_data: Whether it reads the folder given with ``--data``.
        reference_of: Name of the sensor for which this one holds reference scenes (see
            ``Sensor.scenes``). Models are tested on them (``--test reference``), never trained. It
            is set as the other sensor is, as far as it has the same parameters.
        scenes: Words for the reference scenes, such as "finite-element scenes".
        versions: Value of the parameter ``version`` -> defaults that differ in that version, by
            name of the parameter.
    """

    origin: str = "simulated"
    needs_data: bool = False
    reference_of: str = ""
    scenes: str = ""
    versions: Mapping[int, Mapping[str, Value]] = field(
        default_factory=dict, hash=False, kw_only=True
    )

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the value that every parameter has where only ``values`` are given."""
        version = values.get(VERSION)
        of_version = self.versions.get(version, {}) if isinstance(version, int) else {}
        return {**super().defaults(values), **of_version}

    def load(self) -> Callable[..., Sensor]:
        """Import and return the class.

        Raises:
            UserError: The target cannot be imported, or is not a complete subclass.
        """
        from tactibench.plugins.base import Sensor

        return import_subclass(self.name, self.target, Sensor)  # type: ignore[type-abstract]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.origin not in ORIGINS:
            raise ValueError(f"{self.name!r} has origin {self.origin!r}; one of {ORIGINS}")
        if bool(self.reference_of) != bool(self.scenes):
            raise ValueError(f"{self.name!r} needs both reference_of and scenes, or neither")
        _check_variants(self, VERSION, self.versions)


@dataclass(frozen=True)
class EncoderSpec(_Spec):
    """An encoder: contacts <-> maps that a network draws.

    Attributes:
        name: Name by which users call it.
        target: ``"package.module:Class"``, a subclass of ``tactibench.Encoder``.
        summary: One line for ``tactibench list``.
        parameters: Parameters that a user may set.
        kind: "heat" for maps whose cells can be learned one by one (sigmoid, cross-entropy);
            "mixture" for contacts read from a mixture of distributions. A model names the kinds
            that it can be trained through.
        max_contacts: Most contacts in a frame; None: any number.
        shows_surface: Whether the first map is the depth of the skin in units of ``max_depth``, so
            that it can be scored as a surface.
    """

    kind: str = "heat"
    max_contacts: int | None = None
    shows_surface: bool = False

    def load(self) -> Callable[..., Encoder]:
        """Import and return the class.

        Raises:
            UserError: The target cannot be imported, or is not a complete subclass.
        """
        from tactibench.plugins.base import Encoder

        return import_subclass(self.name, self.target, Encoder)  # type: ignore[type-abstract]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _is_name(self.kind):
            raise ValueError(f"{self.name!r} has kind {self.kind!r}; a word such as 'heat'")
        _check_count(self.name, self.max_contacts)


@dataclass(frozen=True)
class CommandSpec:
    """A verb for the command line.

    Attributes:
        name: Name by which users call it.
        target: ``"package.module:command"``, a click command, imported when it is called.
        summary: One line for the list of verbs.
    """

    name: str
    target: str
    summary: str

    def __post_init__(self) -> None:
        _check_names(self.name, self.target)
        object.__setattr__(self, "summary", text_of(self.name, "summary", self.summary))

    def load(self) -> Any:
        """Import and return the click command.

        Raises:
            UserError: The target cannot be imported.
        """
        return import_target(self.name, self.target)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and _NAME.fullmatch(value) is not None


def _check_variants(spec: _Spec, by: str, variants: Mapping[Any, Mapping[str, Value]]) -> None:
    """Raise ValueError where a variant sets a parameter that the spec lacks.

    Args:
        spec: The spec.
        by: Name of the parameter that chooses the variant.
        variants: Value of that parameter -> defaults that differ, by name of the parameter.

    Raises:
        UserError: A default is not allowed.
    """
    by_name = {parameter.name: parameter for parameter in spec.parameters}
    for variant, values in variants.items():
        if missing := {by, *values} - set(by_name):
            raise ValueError(
                f"{by} {variant!r} of {spec.name!r} sets {sorted(missing)}, which it lacks"
            )
        for name, value in values.items():
            by_name[name].check(value)


def _check_count(name: str, most: int | None) -> None:
    if most is not None and most < 1:
        raise ValueError(f"{name!r} has max_contacts {most}; 1 or more")


def _check_names(name: object, target: object) -> None:
    if not _is_name(name):
        raise ValueError(f"name {name!r} may hold letters, digits, '_' and '-' only")
    if not isinstance(target, str) or not _TARGET.fullmatch(target):
        raise ValueError(f"target {target!r} of {name!r} is not of the form package.module:Class")
