"""The declared parameters of any kind of plugin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import ceil, floor
from typing import Any

from tactibench.errors import UserError, describe_exception
from tactibench.plugins.specs import Parameter, Value
from tactibench.testing.property import Failed, refused

Build = Callable[[Mapping[str, Value]], Any]


def check_parameters(spec: Any, values: Mapping[str, Value], build: Build) -> None:
    """Every value that is declared as allowed builds or is refused; every other is refused.

    build: makes the target from the values of all parameters. Raises Failed.
    """
    with refused("a parameter that is not declared"):
        spec.settings({"no_such_parameter": "1"})
    for parameter in spec.parameters:
        for text in _forbidden(parameter):
            with refused(f"{parameter.name}={text}"):
                spec.settings({parameter.name: text})
        for value in _edges(parameter):
            _builds(build, {**values, parameter.name: value}, f"{parameter.name}={value!r}")


def _builds(build: Build, values: Mapping[str, Value], what: str) -> None:
    try:
        build(values)
    except UserError:
        return
    except Exception as error:
        raise Failed(
            f"{what} is allowed, but building with it raised {describe_exception(error)}; narrow "
            "its bounds or refuse it with a UserError"
        ) from error


def _forbidden(parameter: Parameter) -> Iterator[str]:
    """Texts that no user may give."""
    if parameter.choices:
        yield "no such choice"
    elif not isinstance(parameter.default, str):
        yield "word"
    if isinstance(parameter.default, float):
        yield "nan"
    if isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool):
        if parameter.low is not None:
            yield str(type(parameter.default)(parameter.low - 1))
        if parameter.high is not None:
            yield str(type(parameter.default)(parameter.high + 1))


def _edges(parameter: Parameter) -> Iterator[Value]:
    """The allowed values that are likeliest not to have been thought of."""
    if parameter.choices:
        yield from parameter.choices
        return
    default = parameter.default
    if isinstance(default, bool):
        yield not default
    elif isinstance(default, str):
        yield "no such value"
    else:
        kind, whole = type(default), isinstance(default, int)
        low, high = parameter.low, parameter.high
        yield kind(-1) if low is None else kind(ceil(low) if whole else low)
        if low is None or low < 0:
            yield kind(0)
        if high is not None:
            yield kind(floor(high) if whole else high)
