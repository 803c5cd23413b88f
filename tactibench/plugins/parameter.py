"""A parameter of a plugin: a number or word that a user may set."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from tactibench.errors import UserError, printable

Value = bool | int | float | str

_TRUTHS = {
    **dict.fromkeys(("yes", "true", "1"), True),
    **dict.fromkeys(("no", "false", "0"), False),
}
"""Texts for a parameter that is true or false: plain words, those of TOML, and digits."""


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
        built_in: For a parameter that can name a file: the values that need no file of the user;
            empty for all others. A committed record has one of them, because no file that a record
            names is opened.
        checks_only: For sensors: decides what is refused, and changes no frame; at its default it
            is no part of what identifies frames.

    Raises:
        ValueError: The name is no identifier, the help is no text, the default is neither a number
            nor a text, a default or a choice is not printable, or the default is not allowed.
    """

    name: str
    default: Value
    help: str
    choices: tuple[Value, ...] = ()
    low: float | None = None
    high: float | None = None
    decode_only: bool = False
    built_in: tuple[Value, ...] = ()
    checks_only: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"parameter {self.name!r} has no name that Python could take")
        object.__setattr__(self, "help", text_of(self.name, "help", self.help))
        default: object = self.default  # whatever an untyped plugin hands over
        if not isinstance(default, Value):
            kind = type(default).__name__
            raise ValueError(f"parameter {self.name!r} has a default of type {kind}")
        for value in (self.default, *self.choices):
            if printable(str(value)) != str(value):  # a user types it, a terminal shows it
                raise ValueError(f"parameter {self.name!r} has the unprintable value {value!r}")
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
            if kind is bool:
                value: Value = _TRUTHS[text.lower()]
            else:
                value = kind(text)
        except (KeyError, ValueError):
            names = {bool: "yes or no", int: "a whole number", float: "a number"}
            raise UserError(
                f"parameter {self.name!r} is {text!r}, but must be {names[kind]}."
            ) from None
        return self.check(value)

    def check(self, value: Value) -> Value:
        """Return an allowed value as it is.

        Raises:
            UserError: The value is not among the choices, not finite, below ``low`` or above
                ``high``.
        """
        if self.choices and value not in self.choices:
            allowed = ", ".join(str(choice) for choice in self.choices)
            raise UserError(f"parameter {self.name!r} is {value!r}; allowed: {allowed}.")
        if isinstance(value, float) and not isfinite(value):
            raise UserError(f"parameter {self.name!r} is {value}; it must be a finite number.")
        if not isinstance(value, str):
            if self.low is not None and value < self.low:
                raise UserError(f"parameter {self.name!r} is {value}; it must be >= {self.low}.")
            if self.high is not None and value > self.high:
                raise UserError(f"parameter {self.name!r} is {value}; it must be <= {self.high}.")
        return value


def text_of(name: str, key: str, text: object) -> str:
    """Return a text as a terminal may show it.

    Raises:
        ValueError: The value is not a text, so that no listing could show it.
    """
    if not isinstance(text, str):
        raise ValueError(f"{name!r} has a {key} of type {type(text).__name__}; a text")
    return printable(text)
