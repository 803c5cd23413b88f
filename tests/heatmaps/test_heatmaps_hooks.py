"""The declarations and the classes behind them agree."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from tactibench import Contacts, EncoderSpec, Grid
from tactibench_heatmaps.hooks import tactibench_encoders

SPECS = {spec.name: spec for spec in tactibench_encoders()}
# what changes the maps that a model is trained on, and so its weights
SHAPING = {
    "hertz": {"max_depth", "radius", "blur"},
    "depth": {"max_depth", "sigma", "reach"},
    "offset": {"max_depth", "sigma", "reach"},
}


@pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)
def test_declared_defaults_are_the_classes(spec: EncoderSpec) -> None:
    signature = inspect.signature(spec.load()).parameters
    assert spec.settings({}) == {name: p.default for name, p in signature.items()}
    encoder = spec.load()(**spec.settings({}))
    assert encoder.channels >= 1
    assert encoder.tolerance > 0
    assert encoder.separation > 0


@pytest.mark.parametrize("name", SHAPING)
def test_what_shapes_the_maps_is_not_decode_only(name: str) -> None:
    assert {p.name for p in SPECS[name].parameters if not p.decode_only} == SHAPING[name]


CHOICES = [
    pytest.param(spec, {parameter.name: str(choice)}, id=f"{name}, {parameter.name}={choice}")
    for name, spec in SPECS.items()
    for parameter in spec.parameters
    for choice in parameter.choices
]


@pytest.mark.parametrize(("spec", "chosen"), CHOICES)
def test_every_choice_reads_what_it_drew(spec: EncoderSpec, chosen: dict[str, str]) -> None:
    encoder, usual = (spec.load()(**spec.settings(given)) for given in (chosen, {}))
    assert encoder.channels == usual.channels
    assert encoder.separation > 0
    assert encoder.tolerance > 0
    grid, truth = Grid.centred(64, 0.4), Contacts.truth([[1.31, -2.17]], [3.4])
    maps = encoder.encode(truth, grid)
    np.testing.assert_array_equal(maps, usual.encode(truth, grid))  # choices are of the decoder
    found = encoder.decode(maps, grid)
    assert len(found) == 1
    np.testing.assert_allclose(found.xy, truth.xy, rtol=0, atol=encoder.tolerance)
    np.testing.assert_allclose(found.depth, truth.depth, rtol=0, atol=encoder.tolerance)


def test_kinds_and_counts() -> None:
    assert {name for name in SHAPING if SPECS[name].kind == "heat"} == set(SHAPING)
    assert {name for name, spec in SPECS.items() if spec.shows_surface} == {"hertz"}
