"""Check of the declared parameters, the same for every kind of plugin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import ceil, floor
from typing import Any

from tactibench.errors import UserError, describe_exception
from tactibench.plugins import Parameter, Value
from tactibench.testing.runner import Failed, must_refuse

Build = Callable[[Mapping[str, Value]], Any]


def check_parameters(spec: Any, values: Mapping[str, Value], build: Build) -> None:
    """Check that every allowed value builds or is refused, and that every other value is refused.

    Args:
        spec: The spec whose parameters are checked.
        values: Values of all parameters; one at a time is changed.
        build: Function that builds the target from the values of all parameters.

    Raises:
        Failed: A forbidden value is not refused, or an allowed value raises something else than a
            UserError.
    """
    with must_refuse("a parameter that is not declared"):
        spec.settings({"no_such_parameter": "1"})
    for parameter in spec.parameters:
        for text in _forbidden_texts(parameter):
            with must_refuse(f"{parameter.name}={text}"):
                spec.settings({parameter.name: text})
        for value in _edge_values(parameter):
            try:
                build({**values, parameter.name: value})
            except UserError:
                continue
            except Exception as error:
                raise Failed(
                    f"{parameter.name}={value!r} is allowed, but building with it raised "
                    f"{describe_exception(error)}; narrow its bounds or refuse it with a UserError"
                ) from error


def _forbidden_texts(parameter: Parameter) -> Iterator[str]:
    default = parameter.default
    if parameter.choices:
        yield "no such choice"
    elif not isinstance(default, str):
        yield "word"
    if isinstance(default, float):
        yield "nan"
    if isinstance(default, int | float) and not isinstance(default, bool):
        if parameter.low is not None:
            yield str(type(default)(parameter.low - 1))
        if parameter.high is not None:
            yield str(type(default)(parameter.high + 1))


def _edge_values(parameter: Parameter) -> Iterator[Value]:
    """Yield allowed values that an author may have forgotten."""
    if parameter.choices:
        yield from parameter.choices
        return
    default = parameter.default
    if isinstance(default, bool):
        yield not default
    elif isinstance(default, str):
        yield "no such value"
    else:
        kind, is_integer = type(default), isinstance(default, int)
        low, high = parameter.low, parameter.high
        yield kind(-1) if low is None else kind(ceil(low) if is_integer else low)
        if low is None or low < 0:
            yield kind(0)
        if high is not None:
            yield kind(floor(high) if is_integer else high)
