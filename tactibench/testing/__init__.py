"""The conformance kit: named properties that a model, a sensor or an encoder must have.

``tactibench check NAME`` prints them; in a plugin's own tests one line makes a test of each::

    from tactibench.testing import conformance

    test_conformance = conformance("model", "ridge")
"""

from __future__ import annotations

from tactibench.testing.case import conformance
from tactibench.testing.encoder import EncoderSubject
from tactibench.testing.kinds import check, expected_failures, properties, subject_of
from tactibench.testing.model import ModelSubject
from tactibench.testing.property import Failed, NotApplicable, Property
from tactibench.testing.report import Finding, Report, examine, run_checks
from tactibench.testing.sensor import SensorSubject

__all__ = [
    "EncoderSubject",
    "Failed",
    "Finding",
    "ModelSubject",
    "NotApplicable",
    "Property",
    "Report",
    "SensorSubject",
    "check",
    "conformance",
    "examine",
    "expected_failures",
    "properties",
    "run_checks",
    "subject_of",
]
