"""The exception that users see as one sentence, and helpers that write such sentences."""

from __future__ import annotations

import difflib
import errno
import unicodedata
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

LONGEST_MESSAGE = 300
"""Characters of another exception's message that are repeated: about three lines of a terminal."""


class UserError(Exception):
    """A mistake that the user can fix. The command line prints it as one sentence and exits with 2.

    The message names the file, key or option, what was found, what is allowed, and what to do.
    """


class PluginError(Exception):
    """A call into a plugin raised; the message is one line, and the cause is the exception."""


class NotFiniteError(ValueError):
    """A value that must be a finite number is NaN or infinite."""


def is_full(error: OSError) -> bool:
    """Return whether a disk is full, or a quota used up."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def read_file(path: Path, kind: str = "") -> bytes:
    """Return the bytes of a file.

    Args:
        path: The file.
        kind: Words for it in messages, such as "protocol file".

    Raises:
        UserError: The file cannot be read, or is no regular one: a pipe could be waited for.
    """
    what = f"{kind} {path}".strip()
    try:
        if path.exists() and not path.is_file():
            raise UserError(f"{what} cannot be read: it is no regular file; check the path.")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in its name
        why = getattr(error, "strerror", None) or error
        raise UserError(f"{what} cannot be read: {why}; check the path.") from None


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return the end of a sentence about an unknown name.

    It is the close match; without one it is ``otherwise``, or the known names.
    """
    names = sorted(set(known))
    by_letters = {text.lower(): text for text in names}  # EXP1 is nearer to exp1 than to others
    close = difflib.get_close_matches(name.lower(), by_letters, n=1, cutoff=0.5)
    some = names[:40] + ["..."] * (len(names) > 40)  # a table may have thousands of columns
    otherwise = otherwise or f"known: {', '.join(some) or 'none'}."
    return f"did you mean {by_letters[close[0]]!r}?" if close else otherwise


def printable(text: str, keep: str = "") -> str:
    """Return a text with control characters as escapes (ESC: ``\\x1b``), safe to print.

    A terminal obeys such characters, so a name in a file, a record or a plugin could clear the
    screen or move the cursor. Marks that change the direction of writing are escaped as well.

    Args:
        text: Text from any source.
        keep: Control characters that stay, such as the line breaks of a page.
    """
    return text if text.isprintable() else "".join(_escape(sign, keep) for sign in text)


def _escape(sign: str, keep: str) -> str:
    """Return a sign, as an escape if Unicode's category is "other" (C) or "line" (Zl, Zp)."""
    category = unicodedata.category(sign)
    hidden = sign not in keep and (category.startswith("C") or category in ("Zl", "Zp"))
    return sign.encode("unicode_escape").decode("ascii") if hidden else sign


def describe_exception(error: BaseException) -> str:
    """Return type and message of an exception on one line, cut after 300 characters."""
    try:
        text = printable(" ".join(str(error).split()))
    except Exception as own:  # noqa: BLE001 - its class may be a plugin's
        text = f"its message cannot be read ({type(own).__name__})"
    if len(text) > LONGEST_MESSAGE:
        text = f"{text[: LONGEST_MESSAGE - 1]}…"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def call_plugin(function: Callable[[], T]) -> T:
    """Call a function of a plugin and return its result.

    Raises:
        PluginError: The function raises any exception but KeyboardInterrupt, SystemExit and other
            bare BaseExceptions included (bindings to other languages raise such exceptions).
    """
    try:
        return function()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginError(describe_exception(error)) from error
