"""What a plugin declares: light, frozen descriptions that import nothing heavy.

``target`` names the class behind a spec as ``"package.module:Class"``; it is imported on use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tactibench.errors import UserError, did_you_mean

Value = bool | int | float | str


@dataclass(frozen=True)
class Parameter:
    """A number or word that a user may set with ``--param KIND.NAME=VALUE``.

    The default's type is the parameter's type. low and high are inclusive bounds.
    decode_only: of an encoder, changes reading of maps but not the maps a model is trained on.
    """

    name: str
    default: Value
    help: str
    choices: tuple[Value, ...] = ()
    low: float | None = None
    high: float | None = None
    decode_only: bool = False

    def parse(self, text: str) -> Value:
        """Read a value from the command line. Raises UserError when it is not allowed."""
        kind = type(self.default)
        try:
            if kind is bool:
                value: Value = {"true": True, "1": True, "false": False, "0": False}[text.lower()]
            else:
                value = kind(text)
        except (KeyError, ValueError):
            names = {bool: "true or false", int: "a whole number", float: "a number"}
            raise UserError(
                f"parameter {self.name!r} is {text!r}, but must be {names.get(kind, 'a word')}."
            ) from None
        return self.check(value)

    def check(self, value: Value) -> Value:
        """Return an allowed value as it is. Raises UserError for any other."""
        if self.choices and value not in self.choices:
            allowed = ", ".join(str(choice) for choice in self.choices)
            raise UserError(f"parameter {self.name!r} is {value!r}; allowed: {allowed}.")
        if isinstance(value, float) and value != value:
            raise UserError(f"parameter {self.name!r} is not a number.")
        if not isinstance(value, str):
            if self.low is not None and value < self.low:
                raise UserError(f"parameter {self.name!r} is {value}; it must be >= {self.low}.")
            if self.high is not None and value > self.high:
                raise UserError(f"parameter {self.name!r} is {value}; it must be <= {self.high}.")
        return value


@dataclass(frozen=True)
class _Spec:
    name: str
    target: str
    summary: str
    parameters: tuple[Parameter, ...] = ()

    def load(self) -> Any:
        """Import and return the class behind this spec."""
        module, _, attribute = self.target.partition(":")
        return getattr(import_module(module), attribute)

    def settings(self, given: Mapping[str, str]) -> dict[str, Value]:
        """All parameters with their values: the given texts read, the others at their defaults.

        Raises UserError for an unknown parameter or a value that is not allowed.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name in given:
            if name not in known:
                raise UserError(
                    f"{self.name!r} has no parameter {name!r}; {did_you_mean(name, known)}"
                )
        return {
            name: parameter.parse(given[name]) if name in given else parameter.default
            for name, parameter in known.items()
        }


@dataclass(frozen=True)
class ModelSpec(_Spec):
    """A model: frames -> contacts or plate poses.

    answers: what it returns, of "contacts" and "plate". max_contacts: per frame, None for any
    number. uses_encoder: whether it is trained through heatmaps.
    """

    answers: tuple[str, ...] = ("contacts",)
    max_contacts: int | None = None
    uses_encoder: bool = False


@dataclass(frozen=True)
class SensorSpec(_Spec):
    """A sensor: scenes -> frames. origin: "simulated" or "real"; needs_data: takes ``--data``."""

    origin: str = "simulated"
    needs_data: bool = False


@dataclass(frozen=True)
class EncoderSpec(_Spec):
    """An encoder: contacts <-> heatmaps."""


@dataclass(frozen=True)
class CommandSpec:
    """A verb for the command line; target is a click command, imported when it is called."""

    name: str
    target: str
    summary: str

    def load(self) -> Any:
        """Import and return the click command."""
        module, _, attribute = self.target.partition(":")
        return getattr(import_module(module), attribute)
