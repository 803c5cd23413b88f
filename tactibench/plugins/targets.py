"""Import of the object that the target of a spec names: ``"package.module:Class"``."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar

from tactibench.errors import PluginError, UserError, call_plugin

T = TypeVar("T")


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
