"""Plugins that are broken in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Break = Callable[[Any], Any]
"""The good class -> the broken one."""


def with_attributes(**attributes: Any) -> Break:
    """The good class with some attributes of its own."""
    return lambda good: type("Broken", (good,), attributes)


def changing(name: str, change: Callable[..., Any]) -> Break:
    """The good class with one method changed.

    change: the object, its good method and the arguments -> what the broken method returns.
    """

    def broken(good: Any) -> Any:
        def method(self: Any, *arguments: Any, **keys: Any) -> Any:
            return change(self, getattr(good, name).__get__(self), *arguments, **keys)

        return type("Broken", (good,), {name: method})

    return broken
