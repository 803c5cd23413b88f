"""One pytest test of each property."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from tactibench.testing.kinds import expected_failures, properties, subject_of
from tactibench.testing.report import EXPECTED, FAILED, SKIPPED, UNEXPECTED, examine, known_names


def conformance(
    kind: str,
    name: str,
    *,
    expected_failed_checks: Mapping[str, str] | None = None,
    **options: Any,
) -> Callable[[str], None]:
    """A test function with a parameter for every property of a model, sensor or encoder.

    Assign it to a name that pytest collects: ``test_conformance = conformance("model", "ridge")``.
    expected_failed_checks: property -> why it is expected to fail; one that holds all the same is a
    failure. options: of ``subject_of``. The plugin must be installed; it is looked for, and
    trained, when the first test runs. Raises UserError at once for an unknown kind or property.
    """
    import pytest

    asked = {one.name: one for one in properties(kind)}
    known_names(asked.values(), expected_failed_checks or {})

    @cache
    def subject() -> Any:
        return subject_of(kind, name, **options)

    @pytest.mark.parametrize("property_name", list(asked))
    def test_conformance(property_name: str) -> None:
        expected = expected_failures(subject(), expected_failed_checks)
        finding = examine(asked[property_name], subject(), expected.get(property_name))
        said = f"{finding.asked.statement}: {finding.found}"
        if finding.outcome == SKIPPED:
            pytest.skip(finding.found)
        if finding.outcome == EXPECTED:
            pytest.xfail(finding.found)
        if finding.outcome in (FAILED, UNEXPECTED):
            pytest.fail(said, pytrace=False)

    test_conformance.__doc__ = f"Every property of the {kind} {name!r}."
    return test_conformance
