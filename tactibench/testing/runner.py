"""Properties of plugins, and the runner that checks them one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any

from tactibench.errors import (
    PluginError,
    UserError,
    call_plugin,
    describe_exception,
    did_you_mean,
    printable,
)
from tactibench.plugins import Owners

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
EXPECTED, UNEXPECTED = "failed as expected", "passed unexpectedly"
RAN = (PASSED, FAILED, EXPECTED, UNEXPECTED)


class Failed(AssertionError):  # noqa: N818 - the name of an outcome
    """A property does not hold; the message tells what was seen."""


class NotApplicable(Exception):  # noqa: N818 - the name of an outcome
    """A property does not apply to this subject; the message tells why."""


@dataclass(frozen=True)
class Property:
    """A behaviour that every plugin of a kind must have.

    Attributes:
        name: Short name, as in ``expected_failed_checks``.
        statement: The assertion in one line.
        check: Function of the subject that raises `Failed` or `NotApplicable`, or returns.
    """

    name: str
    statement: str
    check: Callable[[Any], None]

    @classmethod
    def from_function(cls, check: Callable[[Any], None]) -> Property:
        """Return the property of a function; its docstring's first paragraph is the statement."""
        first_paragraph = (check.__doc__ or "").strip().partition("\n\n")[0]
        return cls(check.__name__, " ".join(first_paragraph.split()).rstrip("."), check)


def properties_of(module: ModuleType) -> tuple[Property, ...]:
    """Return a property for every public function that a module defines, in the module's order."""
    return tuple(
        Property.from_function(value)
        for name, value in vars(module).items()
        if isinstance(value, FunctionType)
        and value.__module__ == module.__name__
        and not name.startswith("_")
    )


@dataclass(frozen=True)
class Finding:
    """The outcome of one property for one subject.

    Attributes:
        checked: The property.
        outcome: PASSED, FAILED, SKIPPED, EXPECTED or UNEXPECTED.
        message: On failure what was seen; otherwise why the property was skipped or expected to
            fail, or "".
        raised: Whether the plugin raised where it must not, so that further properties would tell
            nothing more.
    """

    checked: Property
    outcome: str
    message: str
    raised: bool = False

    @property
    def ok(self) -> bool:
        """True where the property holds, was skipped or failed as expected."""
        return self.outcome not in (FAILED, UNEXPECTED)

    def line(self) -> str:
        """Return outcome, name, statement and message on one line."""
        message = f" -- {self.message}" if self.message else ""
        text = f"{self.outcome:<19} {self.checked.name:<16} {self.checked.statement}{message}"
        return printable(text)


@dataclass(frozen=True)
class Report:
    """All findings about one subject.

    Attributes:
        title: Kind, name and plugin of the subject.
        findings: One for each property, in their order.
        unchecked: Number of properties that were left out because the plugin raised before.
    """

    title: str
    findings: tuple[Finding, ...]
    unchecked: int = 0

    def count(self, *outcomes: str) -> int:
        """Return the number of findings with one of the outcomes."""
        return sum(finding.outcome in outcomes for finding in self.findings)

    @property
    def ran(self) -> int:
        """Number of properties that were not skipped."""
        return self.count(*RAN)

    @property
    def ok(self) -> bool:
        """True where a property was checked, and all findings are ok."""
        return self.ran > 0 and all(finding.ok for finding in self.findings)

    def summary(self) -> str:
        """Return "20 ran: 18 passed, 1 failed, 1 failed as expected; 2 skipped" and the like."""
        counts = Counter(finding.outcome for finding in self.findings)
        always = (PASSED, FAILED)
        parts = [f"{counts[name]} {name}" for name in RAN if counts[name] or name in always]
        text = f"{self.ran} ran: {', '.join(parts)}; {counts[SKIPPED]} skipped"
        if self.unchecked:
            text = f"{text}; {self.unchecked} not checked, fix this first"
        return text if self.ran else f"{text}; nothing ran, which proves nothing"

    def rows(self) -> list[dict[str, Any]]:
        """Return the counts as ``--json`` writes them."""
        counts = {"ran": self.ran, **{name: self.count(name) for name in (*RAN, SKIPPED)}}
        return [
            {
                "metric": name.replace(" ", "_"),
                "value": value,
                "group": self.title,
                "unit": "properties",
            }
            for name, value in counts.items()
        ]


def require(condition: object, message: str) -> None:
    """Raise `Failed` with the message unless the condition is true."""
    if not condition:
        raise Failed(message)


@contextmanager
def must_refuse(case: str) -> Iterator[None]:
    """Require that the block ends in a UserError with a message.

    Args:
        case: Words for the action of the block, with which the message of `Failed` begins.

    Raises:
        Failed: The block raises something else, or nothing.
    """
    try:
        yield
    except UserError as error:
        require(str(error).strip(), f"{case} was refused without a word")
        return
    except Exception as error:
        raise Failed(f"{case} raised {describe_exception(error)} instead of a UserError") from error
    raise Failed(f"{case} was taken without a word")


@contextmanager
def must_work(case: str) -> Iterator[None]:
    """Turn every exception of the block into `Failed`; `Failed` and `NotApplicable` pass.

    Args:
        case: Words for the action of the block, with which the message begins.

    Raises:
        Failed: The block raises an exception.
    """
    try:
        yield
    except (Failed, NotApplicable):
        raise
    except Exception as error:
        raise Failed(f"{case} raised {describe_exception(error)}") from error


def examine(checked: Property, subject: Any, expected: str | None = None) -> Finding:
    """Check one property of a subject.

    Args:
        checked: The property.
        subject: Argument of its function.
        expected: Reason why the property is expected to fail; None where it is not.
    """
    outcome, message, raised = PASSED, "", False
    try:
        call_plugin(lambda: checked.check(subject))
    except PluginError as failure:
        error = failure.__cause__
        if isinstance(error, NotApplicable):
            return Finding(checked, SKIPPED, str(error))
        raised = not isinstance(error, Failed)
        outcome, message = FAILED, f"raised {failure}" if raised else str(error)
        cause = error if raised or error is None else error.__cause__
        place = None if cause is None else Owners().place_of_error(cause)
        message += "" if place is None else f" in {place}"
    if expected is not None and outcome == FAILED:
        outcome, message = EXPECTED, f"{expected} ({message})"
    elif expected is not None:
        outcome = UNEXPECTED
        message = f"it was expected to fail ({expected}), but holds: take it off the list"
    return Finding(checked, outcome, message, raised)


def run_checks(
    properties: Iterable[Property],
    subject: Any,
    expected_failed_checks: Mapping[str, str] | None = None,
    on_finding: Callable[[Finding], None] = lambda _: None,
) -> Report:
    """Check properties one by one, until the plugin raises where it must not.

    Further properties would fail or be skipped for the same cause.

    Args:
        properties: The properties to check.
        subject: Subject of all properties, with a ``title``.
        expected_failed_checks: Name of a property -> reason why it is expected to fail.
        on_finding: Function that is called with each finding.

    Raises:
        UserError: An expected failure names no property, or has no reason.
    """
    checked, expected = tuple(properties), dict(expected_failed_checks or {})
    check_names(checked, expected)
    findings = []
    for one_property in checked:
        findings.append(examine(one_property, subject, expected.get(one_property.name)))
        on_finding(findings[-1])
        if findings[-1].raised and not findings[-1].ok:
            break
    return Report(subject.title, tuple(findings), len(checked) - len(findings))


def check_names(properties: Iterable[Property], expected: Mapping[str, str]) -> None:
    """Raise UserError for an expected failure of an unknown property, or without a reason."""
    names = [one_property.name for one_property in properties]
    for name, reason in expected.items():
        if name not in names:
            raise UserError(
                f"expected_failed_checks names the property {name!r}, which is not among those "
                f"checked; {did_you_mean(name, names)}"
            )
        if not isinstance(reason, str) or not reason.strip():
            raise UserError(
                f"the property {name!r} is expected to fail without a reason; say why in words."
            )
