"""The exception that reaches a user as one sentence, and helpers to write such sentences."""

from __future__ import annotations

import difflib
import errno
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")

LONGEST_MESSAGE = 300
"""Characters of another exception's message that are repeated: about three lines of a terminal."""


class UserError(Exception):
    """A mistake that the user can fix. The command line prints it as one sentence and exits with 2.

    The message names the file, key or option, what was found, what is allowed, and what to do.
    """


class PluginError(Exception):
    """A call into a plugin that raised; the message is one line, the cause is the exception."""


class NotFiniteError(ValueError):
    """A value that must be a finite number is NaN or infinite."""


def is_full(error: OSError) -> bool:
    """Return whether a disk is full, or a quota used up."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown name: the close match, or all known names."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"known: {', '.join(names) or 'none'}."


def printable(text: str) -> str:
    """Return a text that only shows itself: control characters as Python writes them (``\\x1b``).

    Line breaks and tabs stay. A name in a file, a record or a plugin could clear the screen, or
    turn the order of letters around.
    """
    return "".join(
        sign
        if sign.isprintable() or sign in "\n\t"
        else sign.encode("unicode_escape").decode("ascii")
        for sign in text
    )


def describe_exception(error: BaseException) -> str:
    """Return type and message of an exception on one line, cut after 300 characters."""
    text = " ".join(str(error).split())
    if len(text) > LONGEST_MESSAGE:
        text = f"{text[: LONGEST_MESSAGE - 1]}…"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def call_plugin(function: Callable[[], T]) -> T:
    """Return what a function of a plugin returns.

    Raises:
        PluginError: For whatever it raises, SystemExit and other bare BaseExceptions included
            (bindings to other languages raise such). Only KeyboardInterrupt, which is the user's,
            passes.
    """
    try:
        return function()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginError(describe_exception(error)) from error
