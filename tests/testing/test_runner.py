"""Counts, expected failures, and one test a property under pytest."""

from __future__ import annotations

from typing import Any

import pytest

from tactibench import UserError
from tactibench.testing import (
    EXPECTED,
    FAILED,
    PASSED,
    SKIPPED,
    UNEXPECTED,
    Failed,
    NotApplicable,
    Property,
    checks,
    conformance,
    examine,
    properties,
    run_checks,
    subject_of,
)


class Subject:
    title = "model thing"


def good(_: Any) -> None:
    """It is good.

    More words.
    """


def bad(_: Any) -> None:
    """It is bad."""
    raise Failed("3 where 4 was due")


def elsewhere(_: Any) -> None:
    """It is not asked."""
    raise NotApplicable("it has no such thing")


def crash(_: Any) -> None:
    """It does not end."""
    raise SystemExit(4)


GOOD, BAD, ELSEWHERE, CRASH = map(Property.from_function, (good, bad, elsewhere, crash))


def outcomes(*asked: Property, **expected: str) -> list[str]:
    return [one.outcome for one in run_checks(asked, Subject(), expected).findings]


def test_a_property_is_named_and_told_by_its_function() -> None:
    assert (GOOD.name, GOOD.statement) == ("good", "It is good")


@pytest.mark.parametrize("kind", ["model", "sensor", "encoder"])
def test_every_property_says_what_it_asserts_on_one_line(kind: str) -> None:
    asked = properties(kind)
    assert len({one.name for one in asked}) == len(asked) > 10
    for one in asked:
        assert 20 < len(one.statement) <= 100
        assert one.name.isidentifier()


def test_outcomes() -> None:
    assert outcomes(GOOD, BAD, ELSEWHERE, CRASH) == [PASSED, FAILED, SKIPPED, FAILED]
    report = run_checks((GOOD, BAD, ELSEWHERE), Subject())
    assert report.summary() == "2 ran: 1 passed, 1 failed; 1 skipped"
    assert not report.ok
    (line,) = [one.line() for one in report.findings if one.outcome == FAILED]
    assert line.endswith("It is bad -- 3 where 4 was due")
    assert "SystemExit: 4" in examine(CRASH, Subject()).message


def test_an_expected_failure_is_none_and_a_surprise_is_one() -> None:
    assert outcomes(GOOD, BAD, bad="as designed") == [PASSED, EXPECTED]
    report = run_checks((GOOD, BAD), Subject(), {"bad": "as designed"})
    assert report.ok
    assert report.summary() == "2 ran: 1 passed, 0 failed, 1 failed as expected; 0 skipped"
    assert outcomes(GOOD, good="as designed") == [UNEXPECTED]
    assert not run_checks([GOOD], Subject(), {"good": "as designed"}).ok
    assert outcomes(ELSEWHERE, elsewhere="as designed") == [SKIPPED]


def test_nothing_that_ran_proves_nothing() -> None:
    report = run_checks([ELSEWHERE], Subject())
    assert (report.ran, report.ok) == (0, False)
    assert "nothing ran" in report.summary()
    assert not run_checks([], Subject()).ok


def test_expected_failures_must_be_known_and_reasoned() -> None:
    with pytest.raises(UserError, match="did you mean 'good'"):
        run_checks([GOOD], Subject(), {"goof": "why"})
    with pytest.raises(UserError, match="without a reason"):
        run_checks([GOOD], Subject(), {"good": " "})
    with pytest.raises(UserError, match="did you mean 'nan_frame'"):
        conformance("model", "mean", expected_failed_checks={"nan_frames": "why"})
    with pytest.raises(UserError, match="no kind 'modle'"):
        conformance("modle", "mean")


def test_conformance_is_one_test_a_property(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "properties", lambda kind: (GOOD, BAD, ELSEWHERE, CRASH))
    made: list[str] = []

    def subject(kind: str, name: str, **options: Any) -> Any:
        made.append(name)
        return Subject()

    monkeypatch.setattr(checks, "subject_of", subject)
    monkeypatch.setattr(checks, "expected_failures", lambda _, given: dict(given or {}))
    test = conformance("model", "thing", expected_failed_checks={"crash": "as designed"})
    (mark,) = test.pytestmark  # type: ignore[attr-defined]
    assert mark.args[1] == ["good", "bad", "elsewhere", "crash"]
    assert made == [], "nothing is built when tests are collected"
    test("good")
    with pytest.raises(pytest.fail.Exception, match="3 where 4 was due"):
        test("bad")
    with pytest.raises(pytest.skip.Exception, match="no such thing"):
        test("elsewhere")
    with pytest.raises(pytest.xfail.Exception, match="as designed"):
        test("crash")
    assert made == ["thing"], "one subject for all its properties"
    surprised = conformance("model", "thing", expected_failed_checks={"good": "as designed"})
    with pytest.raises(pytest.fail.Exception, match="take it off the list"):
        surprised("good")


def test_what_a_class_expects_of_itself_is_read(host: Any, target: Any) -> None:
    honest = type("Honest", (target("model"),), {"expected_failed_checks": {"seed": "by design"}})
    subject = subject_of("model", "good_model", host=host("model", honest))
    assert checks.expected_failures(subject, {"batch": "too"}) == {
        "seed": "by design",
        "batch": "too",
    }


@pytest.mark.parametrize(
    ("kind", "name", "options", "said"),
    [
        ("model", "good_modle", {}, "did you mean 'good_model'"),
        ("model", "good_model", {"encoder": "good_encoder"}, "uses no encoder"),
        ("model", "good_model", {"parameters": {"sensor": {"size": "9"}}}, "sensor.NAME"),
        ("model", "good_model", {"parameters": {"model": {"siz": "9"}}}, "did you mean 'size'"),
        ("model", "good_model", {"sensor": "good"}, "did you mean 'good_sensor'"),
        ("sensor", "good_sensor", {"data": "here"}, "takes no --data"),
        (
            "encoder",
            "good_encoder",
            {"sensor": "good_sensor"},
            "--sensor does not belong to the check of encoders",
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(
    host: Any, kind: str, name: str, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(UserError, match=said):
        subject_of(kind, name, host=host(), **options)
