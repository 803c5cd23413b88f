"""The conformance kit: named properties that a model, a sensor or an encoder must have.

``tactibench check NAME`` prints them. In a plugin's own tests one line makes a test of each of
them::

    from tactibench.testing import conformance

    test_conformance = conformance("model", "ridge")
"""

from __future__ import annotations

from tactibench.testing.checks import (
    conformance,
    expected_failures,
    properties,
    subject_of,
)
from tactibench.testing.subjects import (
    EXPECTED,
    FAILED,
    PASSED,
    SKIPPED,
    UNEXPECTED,
    EncoderSubject,
    Failed,
    Finding,
    ModelSubject,
    NotApplicable,
    Property,
    Report,
    SensorSubject,
    check_names,
    examine,
    run_checks,
)

__all__ = [
    "EXPECTED",
    "FAILED",
    "PASSED",
    "SKIPPED",
    "UNEXPECTED",
    "EncoderSubject",
    "Failed",
    "Finding",
    "ModelSubject",
    "NotApplicable",
    "Property",
    "Report",
    "SensorSubject",
    "check_names",
    "conformance",
    "examine",
    "expected_failures",
    "properties",
    "run_checks",
    "subject_of",
]
