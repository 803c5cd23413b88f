"""Version 2 of the presets: how it is chosen, where its pins are, how large they are seen."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim.hooks import OPTICAL, tactibench_sensors
from tactibench_sim.mechanics import tables
from tactibench_sim.optics.camera import Optics, optics_from
from tactibench_sim.pins import layout, places_at_rest, tip_shares
from tactibench_sim.sensor import TACTIP_127_FITTED, TACTIP_331_FITTED, TacTip127, TacTip331

KINDS = [TacTip127, TacTip331]


def made(kind=TacTip331, **parameters):
    return kind(SensorContext(np.random.SeedSequence(0)), **parameters)


def plate(depth, tilt=0.0):
    return Scene(Indenter.plate(), Pose(yaw=0.0, tilt=tilt, depth=depth))


def spec_of(kind):
    return next(s for s in tactibench_sensors() if s.name == kind.preset.name)


@pytest.mark.parametrize("preset", [TACTIP_127_FITTED, TACTIP_331_FITTED])
def test_the_defaults_that_are_listed_are_those_of_the_version(preset):
    spec = next(s for s in tactibench_sensors() if s.name == preset.name)
    values = spec.settings({"version": "2"})
    assert optics_from(Optics(), {p.name: values[p.name] for p in OPTICAL}) == preset.optics
    assert values["pin_length"] == preset.pin_length_mm


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_given_counts_in_every_version(kind):
    """Also where it is what another version has by default."""
    values = spec_of(kind).settings({"version": "2", "camera_distance": "55"})
    sensor = made(kind, **values)
    assert sensor.optics.camera_distance_mm == 55
    assert sensor.optics.focal == kind.versions[1].optics.focal


@pytest.mark.parametrize("kind", KINDS)
def test_the_pins_are_where_the_real_ones_are_at_rest(kind):
    sensor = made(kind, version=2)
    x, y, _ = sensor.renderer.project(sensor.points([plate(0.0)]))
    middle, size = (sensor.optics.size - 1) / 2, sensor.optics.size
    assert np.stack([x[0], y[0]], 1) == pytest.approx(
        middle + size * places_at_rest(sensor.preset.pins), abs=1e-6 * size
    )


def test_the_first_version_is_the_default_and_says_nothing():
    nominal, again, second = made(), made(version=1), made(version=2)
    assert nominal.describe() == again.describe()
    assert not {"version"} & set(nominal.describe())
    assert not {"glare_scatter", "glare_seed"} & set(nominal.describe()["optics"])
    assert np.array_equal(nominal.rest().image, again.rest().image)
    assert np.array_equal(nominal.directions, layout(331))
    assert second.describe()["version"] == 2


def test_there_is_no_third_version():
    with pytest.raises(UserError, match="version 3"):
        made(version=3)
    with pytest.raises(UserError):
        spec_of(TacTip331).settings({"version": "3"})


def test_radii_of_discs_follow_the_law_and_the_magnification():
    """On the axis a tip h mm from the pupil, behind a gel only, is seen f s / (air + gel / n)."""
    sensor = made(version=2)
    optics = sensor.optics
    points = sensor.points([plate(0.0), plate(3.0)])
    radius = sensor.renderer.project(points)[2]
    for scene in range(2):
        gel = points[scene, 0, 2] - 20 + optics.gel_mm
        expected = optics.focal * optics.size * optics.marker_radius_mm
        assert radius[scene, 0] == pytest.approx(
            expected / (optics.air_mm + gel / optics.gel_index), rel=1e-6
        )
    assert radius[1, 0] > 1.1 * radius[0, 0]


def test_areas_of_the_drawn_discs_follow_the_law():
    """The light of one disc, over that of the centre pin, is the square of the radii's ratio."""
    preset = TACTIP_331_FITTED
    sensor = made(version=2, size=512, noise=False, vignetting=0.0, background=0.0)
    x, y, radius = (axis[0] for axis in sensor.renderer.project(sensor.points([plate(0.0)])))
    areas = []
    for pin in (0, 200, 330):
        light = sensor.renderer.clean_discs(*(a[None, [pin]] for a in (x, y, radius)))
        areas.append(light.sum() / sensor.optics.brightness)
    # A soft disc has the area of the hard one and a little of its edge.
    assert np.array(areas) == pytest.approx(np.pi * radius[[0, 200, 330]] ** 2, rel=0.02)
    shares = tip_shares(331, preset.tip_square, preset.tip_fourth)
    assert shares[0] == 1
    assert shares[-1] == pytest.approx(1 + preset.tip_square + preset.tip_fourth)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tilted_plate_holds_the_skin_in_the_second_version_alone(kind):
    """Without sway the field of a tilted plate is that of a level one, turned."""
    sensor = made(kind, version=2)
    tilt = np.radians(15.0)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    directions = sensor.directions[np.arccos(sensor.directions[:, 2]) < np.radians(40)]
    for one, is_turned in ((sensor, True), (made(kind), False)):
        field = [
            one.mechanics.displacement(one.mechanics.loads(tips), where)[0][0]
            for tips, where in (
                (tips_at(3.0, 0.0), directions),
                (tips_at(3.0, 15.0), directions @ turn.T),
            )
        ]
        off = np.abs(field[0] @ turn.T - field[1]).max()
        assert (off < 1e-6) == is_turned


def tips_at(depth, tilt):
    from tactibench_sim.mechanics.contact import tips_of

    return tips_of([plate(depth, tilt)])


def test_spheres_are_pressed_alike_in_both_versions():
    scene = Scene(Indenter.single(), Pose(x=3.0, y=-2.0, depth=2.0))
    first, second = made(), made(version=2)
    assert np.array_equal(first.surface(scene, grid()), second.surface(scene, grid()))
    assert first.error_bounds([scene]) == second.error_bounds([scene])
    assert tables.holding_plates(tables.shipped()) is tables.holding_plates(tables.shipped())


def grid():
    from tactibench import Grid

    return Grid.centred(9, 1.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ranges", [1, 2])
def test_instances_start_from_the_version(kind, ranges):
    nominal = made(kind, version=2)
    for instance in (1, 2, 3, 4, 5):
        one = made(kind, version=2, instance=instance, ranges=ranges)
        assert one.optics.air_mm > 0
        assert one.optics.lens == "fisheye"
        assert abs(one.pin_length - nominal.pin_length) <= 0.2 + 1e-12
        assert abs(one.optics.focal / nominal.optics.focal - 1) <= 0.05 + 1e-12
        assert np.array_equal(one.directions, nominal.directions)
        assert not np.array_equal(one.rest().image, nominal.rest().image)


def test_training_instances_are_of_the_version():
    sensor = made(version=2, instances=3, tier="superpose")
    frames = list(sensor.press_many([Scene(Indenter.single(), Pose(depth=2.0))] * 6))
    rests = {frame.rest.tobytes() for frame in frames}
    assert 1 < len(rests) <= 3
    one = made(version=2, instance=sensor.instances.number_of(0), ranges=2, tier="superpose")
    assert np.array_equal(frames[0].rest, one.rest().image)


def test_presets_differ_in_what_was_fitted_alone():
    for kind in KINDS:
        first, second = (dataclasses.asdict(p) for p in kind.versions)
        differ = {k for k, v in first["optics"].items() if second["optics"][k] != v}
        assert differ == {
            "camera_distance_mm",
            "lens",
            "focal",
            "gel_mm",
            "window_mm",
            "marker_radius_mm",
            "threshold_grey",
        }


@pytest.mark.parametrize("kind", KINDS)
def test_the_second_version_names_the_frames_that_it_was_fitted_to(kind):
    assert made(kind).calibrated_on() == {}
    ((_, frames),) = made(kind, version=2).calibrated_on().items()
    assert len(frames) == 400
