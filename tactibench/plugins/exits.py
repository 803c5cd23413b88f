"""Calls by which a plugin would end the whole process."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn

OWN = frozenset({"tactibench", "__main__", "distributed"})
"""Top-level modules beside the standard library's that may end the process at once: a worker of
dask does so when the process that started it has died."""


class ProcessExitError(BaseException):
    """A plugin called ``os._exit`` or ``os.abort``; the message is the call."""


def forbid_exit() -> None:
    """Make ``os._exit`` and ``os.abort`` raise ProcessExitError where a plugin calls them.

    Otherwise the process would end without a message and with the plugin's exit code, perhaps 0.
    The standard library, this package, dask, and processes that are forked from this one end as
    before.
    """
    for name in ("_exit", "abort"):
        end = getattr(os, name)
        if end.__module__ != __name__:  # not guarded yet
            guarded = _guard(name, end)
            for module in ("os", "posix", "nt"):
                if module in sys.modules:
                    setattr(sys.modules[module], name, guarded)


def _guard(name: str, end: Callable[..., NoReturn]) -> Callable[..., NoReturn]:
    owner = os.getpid()

    def exit_process(*arguments: Any) -> NoReturn:
        caller = str(sys._getframe(1).f_globals.get("__name__", "")).partition(".")[0]
        allowed = caller in OWN or caller in sys.stdlib_module_names
        if allowed or os.getpid() != owner:
            end(*arguments)
        raise ProcessExitError(f"os.{name}({', '.join(map(repr, arguments))})")

    return exit_process
