"""What ships holds what is asked of everybody; the slower ones when slow tests are asked for."""

from __future__ import annotations

import pytest

from tactibench.plugins.host import PluginHost
from tactibench.testing import Report, check

FAST = ("mean", "nearest")
HOST = PluginHost()
SHIPPED = sorted(spec.name for spec in HOST.models)
PRESSING = sorted(s.name for s in HOST.sensors if s.origin == "simulated" and not s.reference_of)
REFERENCES = sorted(s.name for s in HOST.sensors if s.reference_of)


def bad(report: Report) -> list[str]:
    return [finding.line() for finding in report.findings if not finding.well]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in FAST else [pytest.mark.slow]) for n in SHIPPED],
)
def test_models(name: str) -> None:
    report = check("model", name)
    assert bad(report) == []
    assert report.ran >= 15


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ["depth", "offset"])
def test_unet_through_other_encoders(encoder: str) -> None:
    assert bad(check("model", "unet", encoder=encoder)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESSING)
def test_simulated_sensors(name: str) -> None:
    report = check("sensor", name)
    assert bad(report) == []
    assert report.ran >= 14


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCES)
def test_sensors_of_reference_scenes(name: str) -> None:
    report = check("sensor", name)
    assert bad(report) == []
    assert report.ran >= 10
