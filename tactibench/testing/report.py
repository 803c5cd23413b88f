"""Asking properties one by one, and what came of it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from tactibench.errors import UserError, describe_exception, did_you_mean
from tactibench.testing.property import Failed, NotApplicable, Property

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
EXPECTED, UNEXPECTED = "failed as expected", "passed unexpectedly"
RAN = (PASSED, FAILED, EXPECTED, UNEXPECTED)
BAD = (FAILED, UNEXPECTED)


@dataclass(frozen=True)
class Finding:
    """One property of one subject.

    outcome: one of the words above. found: on failure what was found, else why it was skipped or
    expected to fail, or "".
    """

    asked: Property
    outcome: str
    found: str
    seconds: float

    @property
    def well(self) -> bool:
        return self.outcome not in BAD

    def line(self) -> str:
        """Outcome, name, what is asserted, and what was found."""
        found = f" -- {self.found}" if self.found else ""
        return f"{self.outcome:<19} {self.asked.name:<16} {self.asked.statement}{found}"


@dataclass(frozen=True)
class Report:
    """All findings about one subject. title: kind, name and where it is from."""

    title: str
    findings: tuple[Finding, ...]

    def count(self, *outcomes: str) -> int:
        return sum(finding.outcome in outcomes for finding in self.findings)

    @property
    def ran(self) -> int:
        return self.count(*RAN)

    @property
    def well(self) -> bool:
        """Whether something ran and all of it came out as it should."""
        return self.ran > 0 and all(finding.well for finding in self.findings)

    def summary(self) -> str:
        """``20 ran: 18 passed, 1 failed, 1 failed as expected; 2 skipped``."""
        counts = Counter(finding.outcome for finding in self.findings)
        shown = [f"{counts[word]} {word}" for word in RAN if counts[word] or word in RAN[:2]]
        text = f"{self.ran} ran: {', '.join(shown)}; {counts[SKIPPED]} skipped"
        return text if self.ran else f"{text}; nothing ran, which proves nothing"

    def rows(self) -> list[dict[str, Any]]:
        """What is counted, as ``--json`` writes it."""
        counted = {"ran": self.ran, **{word: self.count(word) for word in (*RAN, SKIPPED)}}
        same = {"group": self.title, "unit": "properties"}
        return [
            {"metric": word.replace(" ", "_"), "value": value, **same}
            for word, value in counted.items()
        ]


def examine(one: Property, subject: Any, expected: str | None = None) -> Finding:
    """Ask one property. expected: why it is expected to fail; None: it is not."""
    start = time.perf_counter()
    outcome, found = _outcome(one, subject)
    if expected is not None and outcome == FAILED:
        outcome, found = EXPECTED, f"{expected} ({found})"
    elif expected is not None and outcome == PASSED:
        outcome = UNEXPECTED
        found = f"it was expected to fail ({expected}), but holds: take it off the list"
    return Finding(one, outcome, found, time.perf_counter() - start)


def _outcome(one: Property, subject: Any) -> tuple[str, str]:
    try:
        one.holds(subject)
    except NotApplicable as reason:
        return SKIPPED, str(reason)
    except Failed as found:
        return FAILED, str(found)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin's, and it is reported
        return FAILED, f"raised {describe_exception(error)}"
    return PASSED, ""


def run_checks(
    properties: Iterable[Property],
    subject: Any,
    expected_failed_checks: Mapping[str, str] | None = None,
    tell: Callable[[Finding], None] = lambda _: None,
) -> Report:
    """Ask all properties. tell: called with each finding as it comes.

    Raises UserError for an expected failure that names no property.
    """
    asked, expected = tuple(properties), dict(expected_failed_checks or {})
    known_names(asked, expected)
    findings = []
    for one in asked:
        findings.append(examine(one, subject, expected.get(one.name)))
        tell(findings[-1])
    return Report(subject.title, tuple(findings))


def known_names(properties: Iterable[Property], expected: Mapping[str, str]) -> None:
    """Raise UserError for an expected failure of no such property, or without a reason."""
    names = [one.name for one in properties]
    for name, reason in expected.items():
        if name not in names:
            raise UserError(
                f"expected_failed_checks names the property {name!r}, which is not among those "
                f"asked; {did_you_mean(name, names)}"
            )
        if not isinstance(reason, str) or not reason.strip():
            raise UserError(
                f"the property {name!r} is expected to fail without a reason; say why in words."
            )
