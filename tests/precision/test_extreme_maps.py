"""Every encoder on maps at the ends of what numbers can be: read to finite contacts, or refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactibench import Contacts, Grid
from tactibench.plugins import PluginHost

GRID = Grid.centred(32, 0.8)
EDGE = GRID.axes()[0][-1]
KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    "wide": ("hertz", {}),
    "least-squares": ("hertz", {"decoder": "least-squares", "width": "free"}),
    "maximum": ("hertz", {"decoder": "maximum"}),
    "depth": ("depth", {"sigma": 1.6, "reach": 4.0}),
    "offset": ("offset", {"sigma": 1.6, "reach": 4.0}),
    "mixture": ("mixture", {}),
}


@pytest.fixture(scope="module")
def encoders() -> dict[str, Any]:
    host = PluginHost()
    assert {name for name, _ in KINDS.values()} == {spec.name for spec in host.encoders}
    return {kind: host.encoders[name].build(**more) for kind, (name, more) in KINDS.items()}


@pytest.fixture(params=KINDS)
def encoder(request: pytest.FixtureRequest, encoders: dict[str, Any]) -> Any:
    return encoders[request.param]


def flat(encoder: Any, value: float) -> np.ndarray:
    return np.full((encoder.channels, *GRID.shape), value, dtype=np.float32)


def sound(found: Contacts, encoder: Any) -> None:
    """Finite by construction of Contacts; on the grid, a cell of straying and all steps allowed."""
    step = float(getattr(encoder, "reach", 0.0)) + 2 * GRID.pitch
    assert (np.abs(found.xy) <= EDGE + step).all()
    assert ((found.score >= 0) & (found.score <= 1)).all()


@pytest.mark.parametrize("kind", ["ones", "checks", "rim", "half"])
def test_ties_plateaus_and_borders_are_read(encoder: Any, kind: str) -> None:
    rows, columns = np.indices(GRID.shape)
    heat = {
        "ones": (rows > 8) & (rows < 20) & (columns > 8) & (columns < 20),
        "checks": (rows + columns) % 2 == 0,
        "rim": (rows % 31 == 0) | (columns % 31 == 0),
        "half": columns < 16,
    }[kind]
    maps = flat(encoder, 0.0)
    maps[:] = heat
    found = encoder.decode(maps, GRID)
    assert len(found) <= 6
    sound(found, encoder)
    again = encoder.decode_batch(np.stack([maps, maps]), GRID)
    for one in again:
        np.testing.assert_array_equal(one.xy, found.xy)


@pytest.mark.parametrize("place", [(EDGE, 0.0), (-EDGE, EDGE)])
@pytest.mark.parametrize("depth", [0.3, 6.0])
def test_peaks_on_the_border_and_in_corners(
    encoder: Any, place: tuple[float, float], depth: float
) -> None:
    found = encoder.decode(encoder.encode(Contacts.truth([place], [depth]), GRID), GRID)
    assert len(found) == 1
    assert np.abs(found.xy - place).max() <= 0.5 * GRID.pitch + 1e-9
    assert abs(found.depth[0] - depth) <= 0.05 * depth + 0.01


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("hertz", {"blur": 0.1, "radius": 0.0}),
        ("hertz", {"blur": 100.0, "radius": 100.0}),
        ("depth", {"sigma": 0.1}),
        ("depth", {"sigma": 100.0, "reach": 100.0}),
        ("offset", {"sigma": 0.1}),
        ("offset", {"sigma": 100.0, "reach": 100.0}),
    ],
)
def test_the_narrowest_and_the_widest_kernels_give_finite_maps_and_contacts(
    name: str, values: dict[str, float]
) -> None:
    reach = {"reach": 4.0} if name in ("depth", "offset") else {}
    encoder = PluginHost().encoders[name].build(**{**reach, **values})
    for place in (GRID.xy(16, 16), GRID.xy(16.5, 16.5), GRID.xy(0, 0)):
        maps = encoder.encode(Contacts.truth([place], [3.0]), GRID)
        assert np.isfinite(maps).all()
        found = encoder.decode(maps, GRID)
        assert len(found) <= 1
        sound(found, encoder)
