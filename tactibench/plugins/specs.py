"""Specs: the light, frozen descriptions by which a plugin declares what it has.

``target`` names the class behind a spec as ``"package.module:Class"``; it is imported on use.
A spec that cannot be right raises ValueError when it is made, so its author sees it at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from tactibench.errors import PluginError, UserError, call_plugin, did_you_mean
from tactibench.plugins.parameter import Parameter, Value, text_of

if TYPE_CHECKING:
    from tactibench.plugins.base import Encoder, Model, Sensor  # noqa: F401 - in bases, as texts

T = TypeVar("T")

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
class _Spec(Generic[T]):
    """The fields that models, sensors and encoders have in common.

    Attributes:
        _BASE: Name of the class in ``tactibench.plugins.base`` that the target inherits from.
    """

    _BASE = ""

    name: str
    target: str
    summary: str
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        _check_names(self.name, self.target)
        object.__setattr__(self, "summary", text_of(self.name, "summary", self.summary))
        object.__setattr__(self, "parameters", tuple(self.parameters))
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError(f"{self.name!r} has two parameters of the same name")
        self._check_variants()

    def load(self) -> Callable[..., T]:
        """Import and return the class.

        Raises:
            UserError: The target cannot be imported, or is not a complete subclass.
        """
        from tactibench.plugins import base

        return import_subclass(self.name, self.target, getattr(base, self._BASE))

    def _variants(self) -> tuple[str, Mapping[Any, Mapping[str, Value]]]:
        """Return the parameter that chooses a variant, and its value -> defaults that differ."""
        return "", {}

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the value that every parameter has where only ``values`` are given."""
        plain = {parameter.name: parameter.default for parameter in self.parameters}
        by, variants = self._variants()
        differing = {str(variant): differs for variant, differs in variants.items()}
        return {**plain, **differing.get(str({**plain, **values}.get(by)), {})}

    def _check_variants(self) -> None:
        """Raise ValueError where a variant sets a parameter that the spec lacks.

        Raises:
            UserError: A default is not allowed.
        """
        by, variants = self._variants()
        by_name = {parameter.name: parameter for parameter in self.parameters}
        for variant, values in variants.items():
            if missing := {by, *values} - set(by_name):
                raise ValueError(
                    f"{by} {variant!r} of {self.name!r} sets {sorted(missing)}, which it lacks"
                )
            for name, value in values.items():
                by_name[name].check(value)

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
        set_values = {name: by_name[name].parse(text) for name, text in given.items()}
        return {**self.defaults(set_values), **set_values}

    def settings_of_record(self, stored: Mapping[str, object]) -> dict[str, Value]:
        """Return the settings that a record holds; parameters that this spec lacks are left out.

        Args:
            stored: Name of a parameter -> value in the record.

        Raises:
            UserError: A value is not allowed.
        """
        known = {parameter.name for parameter in self.parameters}
        return self.settings({name: str(stored[name]) for name in stored if name in known})


@dataclass(frozen=True)
class ModelSpec(_Spec["Model"]):
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

    _BASE = "Model"

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

    def _variants(self) -> tuple[str, Mapping[Any, Mapping[str, Value]]]:
        """Return the parameter that chooses a recipe, and the recipes."""
        return RECIPE, self.recipes

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


@dataclass(frozen=True)
class SensorSpec(_Spec["Sensor"]):
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

    _BASE = "Sensor"

    origin: str = "simulated"
    needs_data: bool = False
    reference_of: str = ""
    scenes: str = ""
    versions: Mapping[int, Mapping[str, Value]] = field(
        default_factory=dict, hash=False, kw_only=True
    )

    def _variants(self) -> tuple[str, Mapping[Any, Mapping[str, Value]]]:
        """Return the parameter that chooses a version, and the versions."""
        return VERSION, self.versions

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.origin not in ORIGINS:
            raise ValueError(f"{self.name!r} has origin {self.origin!r}; one of {ORIGINS}")
        if bool(self.reference_of) != bool(self.scenes):
            raise ValueError(f"{self.name!r} needs both reference_of and scenes, or neither")


@dataclass(frozen=True)
class EncoderSpec(_Spec["Encoder"]):
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

    _BASE = "Encoder"

    kind: str = "heat"
    max_contacts: int | None = None
    shows_surface: bool = False

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


def _check_count(name: str, most: int | None) -> None:
    if most is not None and most < 1:
        raise ValueError(f"{name!r} has max_contacts {most}; 1 or more")


def _check_names(name: object, target: object) -> None:
    if not _is_name(name):
        raise ValueError(f"name {name!r} may hold letters, digits, '_' and '-' only")
    if not isinstance(target, str) or not _TARGET.fullmatch(target):
        raise ValueError(f"target {target!r} of {name!r} is not of the form package.module:Class")


def import_target(name: str, target: str) -> Any:
    """Import and return the object that a target names.

    Args:
        name: Name of the spec, for the error.
        target: ``"package.module:Class"``.

    Raises:
        UserError: The import fails, or the module does not have the object.
    """
    module, _, attribute = target.partition(":")
    try:
        return call_plugin(lambda: getattr(import_module(module), attribute))
    except PluginError as error:
        raise UserError(
            f"{name!r} cannot be used, because {target} does not load ({error}); "
            "repair or reinstall its plugin."
        ) from error.__cause__


def import_subclass(name: str, target: str, base: type[T]) -> Callable[..., T]:
    """Import and return the class that a target names.

    Args:
        name: Name of the spec, for the error.
        target: ``"package.module:Class"``.
        base: The class that it must inherit from.

    Raises:
        UserError: The import fails, the class does not inherit from ``base``, or it lacks a method
            that must be written.
    """
    loaded = import_target(name, target)
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        kind, own = base.__name__, target.partition(":")[2]
        raise UserError(
            f"{name!r} was written for an older tactibench, because {target} does not inherit from "
            f"tactibench.{kind}; import {kind} from tactibench and write `class {own}({kind}):`."
        )
    missing = sorted(getattr(loaded, "__abstractmethods__", ()))
    if missing:
        raise UserError(f"{name!r} cannot be used, because {target} lacks {', '.join(missing)}.")
    return loaded
