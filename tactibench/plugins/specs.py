"""Specs: the light, frozen descriptions by which a plugin declares what it has.

``target`` names the class behind a spec as ``"package.module:Class"``; it is imported on use.
A spec that cannot be right raises ValueError when it is made, so its author sees it at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from math import inf, isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from tactibench.errors import PluginError, UserError, call_plugin, did_you_mean, printable

if TYPE_CHECKING:
    from tactibench.plugins.base import Encoder, Model, Prior, Sensor  # noqa: F401 - in bases

T = TypeVar("T")

Value = bool | int | float | str

_KINDS: dict[type, tuple[type, str]] = {
    bool: (bool, "yes or no"),
    str: (object, "a text"),
    int: (Integral, "a whole number"),
    float: (Real, "a finite number"),
}
"""Type of the default -> type of the values, numpy's included, and its words."""
_TRUTHS = {
    **dict.fromkeys(("yes", "true", "1"), True),
    **dict.fromkeys(("no", "false", "0"), False),
}
"""Texts for a parameter that is true or false: plain words, those of TOML, and digits."""

KINDS = ("model", "sensor", "encoder")
ANSWERS = ("contacts", "plate", "sites")
IMAGE, CHANNELS = "image", "channels"
SIGNALS = (IMAGE, CHANNELS)
"""Kinds of signal: uint8 images of a camera, float32 channels of any other sensor."""
ORIGINS = ("simulated", "real")
RECIPE = "recipe"
"""Parameter by which a model is chosen among its recipes."""
INSTANCE = "instance"
"""Parameter by which one sensor of a make is chosen; 0 is the nominal one."""
NOMINAL = 0
"""Number of the nominal instance."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # it becomes part of folder names
_TARGET = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


@dataclass(frozen=True)
class Parameter:
    """A number or word that a user may set with ``--param KIND.NAME=VALUE``.

    Attributes:
        name: Name of the keyword argument with which the class is built.
        default: Its type is the parameter's type.
        help: Explanation in a few words, with the unit.
        choices: The only allowed values, where there are any.
        low: Smallest allowed number.
        high: Largest allowed number.
        decode_only: For encoders: changes how maps are read, but not the maps that a model is
            trained on, so that trained weights stay valid.
        checks_only: For sensors: decides what is refused, and changes no frame; at its default it
            is no part of what identifies frames.

    Raises:
        ValueError: The name is no identifier, or the default is not allowed.
    """

    name: str
    default: Value
    help: str
    choices: tuple[Value, ...] = ()
    low: float | None = None
    high: float | None = None
    decode_only: bool = False
    checks_only: bool = False

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ValueError(f"parameter {self.name!r} has no name that Python could take")
        object.__setattr__(self, "help", printable(self.help))
        try:
            self.check(self.default)
        except UserError as error:
            raise ValueError(f"the default of {error}") from None

    def parse(self, text: str) -> Value:
        """Return the value of a text from the command line.

        Raises:
            UserError: The text does not have the type of the default, or its value is not allowed.
        """
        kind = type(self.default)
        try:
            value: Value = _TRUTHS[text.lower()] if kind is bool else kind(text)
        except (KeyError, ValueError):
            value = text
        self.check(value)
        return value

    def check(self, value: Any) -> None:
        """Raise UserError unless the value is allowed.

        It has the type of the default, is among the choices, finite, and within ``low``..``high``.
        """
        if self.choices and value not in self.choices:
            allowed = ", ".join(str(choice) for choice in self.choices)
            raise UserError(f"parameter {self.name!r} is {value!r}; allowed: {allowed}.")
        kind, wanted = _KINDS[type(self.default)]
        low = -inf if self.low is None else self.low
        high = inf if self.high is None else self.high
        wanted += f", at least {low:g}" * isfinite(low) + f", at most {high:g}" * isfinite(high)
        right = isinstance(value, kind) and isinstance(value, bool) is (kind is bool)
        if right and kind in (Integral, Real):
            right = isfinite(value) and low <= value <= high
        if not right:
            raise UserError(f"parameter {self.name!r} is {value!r}, but must be {wanted}.")


def training_parameters(*, mixing: bool) -> tuple[Parameter, ...]:
    """Return the parameters that every model trained by ``tactibench.training`` has.

    Args:
        mixing: Whether the model can learn from frames with several contacts that are made from
            single presses.
    """
    epochs = Parameter("epochs", 0, "epochs, 0: as many as the recipe has", low=0, high=1000)
    precision = Parameter(
        "precision",
        "recipe",
        "training arithmetic, recipe: as the recipe has it",
        choices=("recipe", "float32", "bf16"),
    )
    mixed_frames = Parameter(
        "mixing",
        0.0,
        "extra multi-contact frames made from single presses, share of the presses",
        low=0,
        high=10,
    )
    return (epochs, precision, mixed_frames) if mixing else (epochs, precision)


_REFINE = Parameter(
    "refine",
    "none",
    "fields: contacts are fitted to the pins by fields of single presses, and dropped where no "
    "field explains them",
    choices=("none", "fields"),
)
_REFINED = "tactibench.training:RefinedModel"
"""Class that refines another model's contacts. Packages above this one are named as targets are."""


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
        object.__setattr__(self, "summary", printable(self.summary))
        object.__setattr__(self, "parameters", tuple(self.parameters))
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError(f"{self.name!r} has two parameters of the same name")

    def load(self) -> Callable[..., T]:
        """Import and return the class.

        Raises:
            UserError: The target cannot be imported, or is not a complete subclass.
        """
        from tactibench.plugins import base

        loaded: Callable[..., T] = import_target(self.name, self.target, getattr(base, self._BASE))
        return loaded

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:  # noqa: ARG002
        """Return the value that every parameter has where only ``values`` are given."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def settings(self, given: Mapping[str, str]) -> dict[str, Value]:
        """Return the values of all parameters: those given as text, the others at their defaults.

        Raises:
            UserError: A parameter is unknown, or a value is not allowed.
        """
        set_values = {name: self._parameter(name).parse(text) for name, text in given.items()}
        return {**self.defaults(set_values), **set_values}

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise UserError for a parameter that is unknown, and for a value that is not allowed."""
        for name, value in values.items():
            self._parameter(name).check(value)

    def build(self, *context: Any, **values: Any) -> T:
        """Import the class and make an instance with some values of its parameters.

        Raises:
            UserError: The class cannot be used, a parameter is unknown, or a value is not allowed.
        """
        self.check(values)
        return self.load()(*context, **values)

    def _parameter(self, name: str) -> Parameter:
        by_name = {parameter.name: parameter for parameter in self.parameters}
        if name not in by_name:
            raise UserError(
                f"{self.name!r} has no parameter {name!r}; {did_you_mean(name, by_name)}"
            )
        return by_name[name]

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
        answers: Kinds of answer that it can be trained for, of "contacts", "plate" and "sites".
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
        of_sites: The model that has this name where named places are asked for, with parameters of
            its own; None: it is this one, if any.
        composes: Whether it explains a frame by single presses and a law of how they press
            together, so that it knows of several contacts without the parameter ``mixing``.
        refinable: Whether its contacts on images can be refined by fields of single presses, with
            the parameter ``refine``. The model itself is not built with this parameter.
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
    of_sites: ModelSpec | None = field(default=None, kw_only=True)
    composes: bool = field(default=False, kw_only=True)
    refinable: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.refinable:
            object.__setattr__(self, "parameters", (*self.parameters, _REFINE))
        super().__post_init__()
        _require_allowed(self.name, "answers", self.answers, ANSWERS)
        _require_allowed(self.name, "reads", self.reads, SIGNALS)
        by_name = {parameter.name: parameter for parameter in self.parameters}
        for recipe, values in self.recipes.items():
            if missing := {RECIPE, *values} - set(by_name):
                raise ValueError(
                    f"recipe {recipe!r} of {self.name!r} sets {sorted(missing)}, which it lacks"
                )
            for name, value in values.items():
                by_name[name].check(value)

    def build(self, *context: Any, **values: Any) -> Model:
        """Import the class and make an instance, whose contacts are refined where that is asked.

        Raises:
            UserError: The class cannot be used, a parameter is unknown, or a value is not allowed.
        """
        self.check(values)
        refines = self.refines(values)
        if self.refinable:
            values.pop(_REFINE.name, None)
        model = super().build(*context, **values)
        if not refines:
            return model
        from tactibench.plugins import base

        wrapper: Callable[..., Model] = import_target(self.name, _REFINED, base.Model)
        return wrapper(model)

    def refines(self, values: Mapping[str, Value]) -> bool:
        """Return whether a model with these values refines its contacts."""
        return self.refinable and values.get(_REFINE.name, _REFINE.default) != _REFINE.default

    def prior(self, values: Mapping[str, Value], answer: str, *, several: bool) -> Prior:
        """Return what a training knows of contacts that press together before it sees a frame.

        Args:
            values: Values of its parameters. ``mixing`` makes frames of several contacts,
                ``neighbours`` names the law by which they press together.
            answer: Kind of answer, "contacts", "plate" or "sites".
            several: Whether the training frames hold several contacts.
        """
        if answer == "plate" or not (self.refines(values) or values.get("mixing", self.composes)):
            return "none"
        if answer == "contacts" and self.composes and several:
            return "fitted to multi-contact labels"
        adds = answer == "sites" or values.get("neighbours") == "none"
        return "plain addition" if adds and not self.refines(values) else "nominal mechanics"

    def unrefined(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the same values without refinement: those of the model that is refined."""
        return {**values, _REFINE.name: _REFINE.default}

    def defaults(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return the value that every parameter has where only ``values`` are given."""
        plain = super().defaults(values)
        return {**plain, **self.recipes.get(str({**plain, **values}.get(RECIPE)), {})}


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
    """

    _BASE = "Sensor"

    origin: str = "simulated"
    needs_data: bool = False
    reference_of: str = ""
    scenes: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_allowed(self.name, "origin", (self.origin,), ORIGINS)
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
        object.__setattr__(self, "summary", printable(self.summary))

    def load(self) -> Any:
        """Import and return the click command.

        Raises:
            UserError: The target cannot be imported.
        """
        return import_target(self.name, self.target)


def _require_allowed(name: str, key: str, words: tuple[str, ...], allowed: tuple[str, ...]) -> None:
    """Raise ValueError unless there are words, all of them allowed."""
    if not words or not set(words) <= set(allowed):
        raise ValueError(f"{name!r} has {key} {words!r}; a tuple of {allowed}")


def _check_names(name: object, target: object) -> None:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(f"name {name!r} may hold letters, digits, '_' and '-' only")
    if not isinstance(target, str) or not _TARGET.fullmatch(target):
        raise ValueError(f"target {target!r} of {name!r} is not of the form package.module:Class")


def import_target(name: str, target: str, base: type[Any] | None = None) -> Any:
    """Import and return the object that a target names.

    Args:
        name: Name of the spec, for the error.
        target: ``"package.module:Class"``.
        base: The class that it must inherit from; None: it may be any object.

    Raises:
        UserError: The import fails, the module does not have the object, the class does not inherit
            from ``base``, or it lacks a method that must be written.
    """
    module, _, attribute = target.partition(":")
    try:
        loaded = call_plugin(lambda: getattr(import_module(module), attribute))
    except PluginError as error:
        raise UserError(
            f"{name!r} cannot be used, because {target} does not load ({error}); "
            "repair or reinstall its plugin."
        ) from error.__cause__
    if base is None:
        return loaded
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        kind = base.__name__
        raise UserError(
            f"{name!r} cannot be used, because {target} does not inherit from tactibench.{kind}; "
            f"import {kind} from tactibench and write `class {attribute}({kind}):`."
        )
    missing = sorted(getattr(loaded, "__abstractmethods__", ()))
    if missing:
        raise UserError(f"{name!r} cannot be used, because {target} lacks {', '.join(missing)}.")
    return loaded
