"""A property: a name, what it asserts, and the function that finds out whether it holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tactibench.errors import UserError, describe_exception


class Failed(AssertionError):  # noqa: N818 - reads as what came of it
    """A property does not hold; the message says what was found."""


class NotApplicable(Exception):  # noqa: N818 - no error: a property that says nothing of a subject
    """A property cannot be asked of this subject; the message says why."""


@dataclass(frozen=True)
class Property:
    """name: to be named in ``expected_failed_checks``. statement: what it asserts, one line.

    holds: called with the subject; raises Failed or NotApplicable, and returns when it holds.
    """

    name: str
    statement: str
    holds: Callable[[Any], None]

    @classmethod
    def of(cls, function: Callable[[Any], None]) -> Property:
        """From a documented function: its name, and the first paragraph of its docstring."""
        first = (function.__doc__ or "").strip().partition("\n\n")[0]
        return cls(function.__name__, " ".join(first.split()).rstrip("."), function)


def require(holds: object, found: str) -> None:
    """Raise Failed with what was found, where something does not hold."""
    if not holds:
        raise Failed(found)


@contextmanager
def refused(what: str) -> Iterator[None]:
    """What is done inside must end in a UserError. Raises Failed for a return or another error."""
    try:
        yield
    except UserError as error:
        require(str(error).strip(), f"{what} was refused without a word")
        return
    except Exception as error:
        raise Failed(f"{what} raised {describe_exception(error)} instead of a UserError") from error
    raise Failed(f"{what} was taken without a word")


@contextmanager
def guarded(what: str) -> Iterator[None]:
    """Name what was being done when something inside raises. Failed and NotApplicable pass."""
    try:
        yield
    except (Failed, NotApplicable):
        raise
    except Exception as error:
        raise Failed(f"{what} raised {describe_exception(error)}") from error
