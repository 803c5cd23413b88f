"""The contract of a sensor, held by every simulated sensor and every set of reference scenes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tactibench import Grid, Indenter, Pose, Scene, UserError
from tactibench.plugins import PluginHost
from tactibench.testing import (
    Finding,
    Property,
    SensorSubject,
    examine,
    expected_failures,
    properties,
    subject_of,
)

ONE_OF_EACH = ("tactip-127", "tactip-127-fem", "fitted-127", "planar-grid")
"""A sensor of each class; all others differ from one of them in parameters."""
NAMES = [
    pytest.param(spec.name, marks=[] if spec.name in ONE_OF_EACH else pytest.mark.long)
    for spec in PluginHost().sensors
    if spec.origin == "simulated"
]
SMALL = {"size": "64"}
LEAST = 9
"""Properties that say something of every one of them."""


@cache
def subject(name: str) -> SensorSubject:
    return subject_of("sensor", name, parameters={"sensor": SMALL})


@cache
def examine_once(asked: Property, name: str) -> Finding:
    return examine(asked, subject(name), expected_failures(subject(name)).get(asked.name))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "asked",
    [
        # It makes a sensor for every value of every parameter.
        pytest.param(one, marks=[pytest.mark.long] if one.name == "parameters" else [], id=one.name)
        for one in properties("sensor")
    ],
)
def test_conformance(name: str, asked: Property) -> None:
    finding = examine_once(asked, name)
    assert finding.ok, finding.line()


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_most_properties_apply(name: str) -> None:
    findings = [examine_once(asked, name) for asked in properties("sensor")]
    assert sum(finding.outcome == "passed" for finding in findings) >= LEAST


@pytest.mark.parametrize("name", NAMES)
def test_noise_follows_the_seed(name: str) -> None:
    scene = subject(name).scenes[0]
    first, again, other = (subject(name).press(scene, seed=seed)[0] for seed in (0, 0, 1))
    assert (first.image == again.image).all()
    assert (first.image != other.image).any()


@pytest.mark.parametrize("name", NAMES)
def test_the_bound_is_the_root_of_the_covariance_or_both_are_unknown(name: str) -> None:
    sensor, scene = subject(name).unopened, Scene(Indenter.single(), Pose(1.0, 2.0, depth=2.0))
    try:
        bound, covariance = sensor.bound(scene), sensor.covariance(scene)
    except UserError:
        pytest.skip("it presses other scenes")
    if bound is None or covariance is None:
        assert bound is None
        assert covariance is None
        return
    assert bound.ravel() == pytest.approx(np.sqrt(np.diag(covariance)))
    for nuisance in sensor.nuisances:
        wider = sensor.covariance(scene, [nuisance])
        assert wider is not None
        assert (np.diag(wider) >= np.diag(covariance) * (1 - 1e-6)).all()
    with pytest.raises(UserError, match="moonlight"):
        sensor.covariance(scene, ["moonlight"])


@pytest.mark.parametrize("name", NAMES)
def test_a_surface_that_is_known_is_that_of_the_skin_alone(name: str) -> None:
    """Nothing depends on the camera: two seeds have one surface."""
    scene, grid = Scene(Indenter.single(), Pose(depth=2.0)), Grid.centred(16, 1.6)
    surfaces = [subject(name).build(seed=seed).surface(scene, grid) for seed in (0, 1)]
    if surfaces[0] is None:
        assert surfaces[1] is None
        return
    assert (surfaces[0] == surfaces[1]).all()


@pytest.mark.parametrize("name", NAMES)
def test_forces_in_the_truth_grow_with_depth(name: str) -> None:
    checked = subject(name)
    if "modulus" not in checked.values:
        pytest.skip("it knows no forces")
    presses = [Scene(Indenter.dual(6.0), Pose(depth=depth)) for depth in (0.5, 1.0, 2.0)]
    with checked.build(values={**checked.values, "modulus": 1.0}) as sensor:
        forces = [frame.force for frame in sensor.press_many(presses)]
    assert [np.shape(force) for force in forces] == [(2, 3)] * 3
    assert (np.diff([force[:, 2].sum() for force in forces if force is not None]) < 0).all()
