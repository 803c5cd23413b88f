"""The contract of an encoder, held by every encoder and decoder that ships.

``tactibench.testing`` has the properties; here are the limits of each one under noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from tactibench import Contacts, UserError
from tactibench.plugins import PluginHost
from tactibench.testing import EncoderSubject, examine, properties, subject_of

ASKED = {one.name: one for one in properties("encoder")}


@dataclass(frozen=True)
class Case:
    """noise: largest rms error of position, cells, of contacts 2 to 6 mm deep at noise 0.02."""

    encoder: str
    noise: float = 1.0
    parameters: dict[str, str] = field(default_factory=dict)
    expected_failed_checks: dict[str, str] = field(default_factory=dict)


# The Cramer-Rao bound of a peak of height A in noise s is s sqrt(2 / pi) / A cells, whatever its
# width: 0.016 for the heats of height 1, 0.028 on average over depths of 2 to 6 mm for "hertz".
CASES = {
    "hertz least-squares": Case("hertz", 0.08, {"decoder": "least-squares"}),
    "hertz free width": Case("hertz", 0.08, {"decoder": "least-squares", "width": "free"}),
    "hertz wide": Case("hertz", 0.06),
    "hertz maximum": Case("hertz", 1.5, {"decoder": "maximum"}),
    "depth least-squares": Case("depth", 0.03),
    "depth maximum": Case("depth", 0.4, {"decoder": "maximum"}),
    "offset": Case("offset", 0.045),
    "mixture": Case("mixture"),
}
HEAT = [name for name in CASES if name != "mixture"]


@cache
def subject(name: str) -> EncoderSubject:
    case = CASES[name]
    found = subject_of("encoder", case.encoder, parameters={"encoder": case.parameters})
    return replace(found, noise_cells=case.noise)


def test_every_encoder_is_among_the_cases() -> None:
    assert {case.encoder for case in CASES.values()} == set(PluginHost().encoders.specs)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("property_name", ASKED)
def test_conformance(name: str, property_name: str) -> None:
    expected = CASES[name].expected_failed_checks.get(property_name)
    finding = examine(ASKED[property_name], subject(name), expected)
    assert finding.ok, finding.line()


@pytest.mark.parametrize("name", HEAT)
def test_the_score_is_the_heat(name: str) -> None:
    encoder, grid = subject(name).encoder, subject(name).grid
    maps = encoder.encode(Contacts.truth([[1.2, -2.1]], [6.0]), grid)
    faint = [encoder.decode(np.float32(share) * maps, grid).score[0] for share in (0.8, 0.5)]
    assert faint == pytest.approx([0.8, 0.5], abs=0.05)


@pytest.mark.parametrize("name", HEAT)
@pytest.mark.parametrize("depth", [6.3, -0.1])
def test_a_depth_that_cannot_be_shown_is_refused(name: str, depth: float) -> None:
    with pytest.raises(UserError, match="max_depth"):
        subject(name).encoder.encode(Contacts.truth([[0, 0]], [depth]), subject(name).grid)
