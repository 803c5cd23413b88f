"""Pins of a sensor on the layout of another: the camera's place and turn are undone."""

import numpy as np
import pytest

from tactibench import Frame, Pose, UserError
from tactibench.frames import FAULTS
from tactibench.markers import AlignedPins, AlignedSensors, PinTracker, Similarity

SIZE = 200


def turned(degrees=5.0, stretch=0.06, shift=(4.0, -7.0)):
    return Similarity.of(np.array(shift), np.radians(degrees), stretch, np.full(2, SIZE / 2))


@pytest.fixture
def layout(hexagon):
    return hexagon(17.0, SIZE)


@pytest.fixture
def pins_of(drawn):
    return lambda places: PinTracker(drawn(places, 4.0, SIZE, soft=True))


def test_a_similarity_is_a_turn_a_stretch_and_a_shift():
    view, places = turned(90.0, np.log(2.0), (1.0, 0.0)), np.array([[100.0, 100.0], [110.0, 100.0]])
    np.testing.assert_allclose(view(places), [[101.0, 100.0], [101.0, 120.0]], atol=1e-9)
    np.testing.assert_allclose(view.back(view(places)), places)
    np.testing.assert_allclose(turned().after(view)(places), turned()(view(places)))


def test_the_similarity_between_places_is_found_in_noise(layout):
    noise = 0.01 * np.random.default_rng(0).normal(size=layout.shape)
    found = Similarity.between(layout, turned()(layout) + noise)
    np.testing.assert_allclose(found.matrix, turned().matrix, atol=1e-4)
    np.testing.assert_allclose(found(layout), turned()(layout), atol=0.02)


def test_the_layouts_own_sensor_is_seen_as_it_is(layout, pins_of):
    pins = pins_of(layout)
    aligned = AlignedPins(pins, pins.rest)
    images = pins.rest_image[None]
    np.testing.assert_allclose(aligned.track(images)[0], pins.displacements(images), atol=1e-9)
    np.testing.assert_allclose(aligned.layout_clues, 0.0, atol=1e-12)


def test_a_turned_nearer_camera_sees_the_same_displacements(layout, pins_of, drawn):
    rng, view = np.random.default_rng(1), turned()
    step = rng.uniform(-3, 3, layout.shape)
    aligned = AlignedPins(pins_of(view(layout)), layout)
    image = drawn(view(layout + step), 4.0, SIZE, soft=True)[None]
    moved, sure = aligned.track(image)
    assert sure.all()
    np.testing.assert_allclose(moved[0], step.T.reshape(-1), atol=0.05)
    again, seen = aligned.retrack(image, moved + 0.5)
    assert seen.all()
    np.testing.assert_allclose(again, moved, atol=0.05)
    assert aligned.layout_clues[0] == pytest.approx(0.06, abs=1e-3)


@pytest.mark.parametrize("degrees", [-20, -9, 4, 9, 15, 20])
def test_a_turn_of_the_camera_is_found(layout, pins_of, degrees):
    aligned = AlignedPins(pins_of(turned(degrees)(layout)), layout)
    np.testing.assert_allclose(aligned.view(layout), turned(degrees)(layout), atol=0.05)


def test_a_motion_since_rest_is_undone(layout, pins_of, drawn):
    motion, view = turned(1.0, 0.0, (1.5, 0.5)), turned()
    aligned = AlignedPins(pins_of(view(layout)), layout)
    image = drawn(view(motion(layout)), 4.0, SIZE, soft=True)[None]
    assert np.abs(aligned.track(image)[0]).max() > 1.0
    np.testing.assert_allclose(aligned.moved(motion).track(image)[0], 0.0, atol=0.05)


def test_a_pin_without_a_tip_is_not_sure(layout, pins_of):
    lost = [7, 30]
    aligned = AlignedPins(pins_of(np.delete(turned()(layout), lost, axis=0)), layout)
    _, sure = aligned.track(aligned.pins.rest_image[None])
    assert np.flatnonzero(~sure[0]).tolist() == lost


def test_pins_that_do_not_fit_are_refused(layout, pins_of):
    other = np.random.default_rng(2).permutation(layout)[:30]
    with pytest.raises(UserError, match="same make"):
        AlignedPins(pins_of(other), layout)


@pytest.mark.parametrize("light", [0.3, 0.6, 1.4])
def test_pins_are_seen_in_the_light_of_the_rest_frame(layout, pins_of, light):
    pins = pins_of(layout)
    dim = np.rint(light * pins.rest_image).clip(0, 255).astype(np.uint8)
    lit = pins.images([Frame(dim, 0.0, Pose())])[0].astype(int)
    assert np.abs(np.median(lit) - np.median(pins.rest_image)) <= 1
    assert np.abs(lit.max() - pins.rest_image.max()) < 12


@pytest.mark.parametrize(("fault", "value"), [("blur", 1.0), ("lost-pins", 0.2), ("glare", 8.0)])
def test_what_is_no_other_light_stays_to_the_last_bit(layout, pins_of, fault, value):
    """It changes how bright pins are and not the ground."""
    pins = pins_of(layout)
    spoiled = FAULTS[fault](pins.rest_image, value, np.random.default_rng(1))
    np.testing.assert_array_equal(pins.images([Frame(spoiled, 0.0, Pose())])[0], spoiled)


def test_usual_light_stays_to_the_last_bit(layout, pins_of):
    pins = pins_of(layout)
    almost = np.rint(1.03 * pins.rest_image).astype(np.uint8)
    np.testing.assert_array_equal(pins.images([Frame(almost, 0.0, Pose())])[0], almost)


@pytest.fixture
def framed(drawn):
    """A frame of pins of some radius at places (P, 2), with its rest frame."""

    def _framed(places, rest, radius=4.0, rest_radius=4.0):
        still = None if rest is None else drawn(rest, rest_radius, SIZE, soft=True)
        return Frame(drawn(places, radius, SIZE, soft=True), 0.0, Pose(), still)

    return _framed


def test_frames_of_the_first_sensor_are_tracked_to_the_last_bit_as_its_own(layout, framed):
    step = np.random.default_rng(3).uniform(-3, 3, (4, *layout.shape))
    frames = [framed(layout + one, layout) for one in step]
    sensors = AlignedSensors.of(frames)
    tracks = sensors.tracks([*frames[:3], Frame(frames[3].image, 0.0, Pose())])
    own = sensors.first.tracker.track(np.stack([frame.image for frame in frames]))
    np.testing.assert_array_equal(tracks.xy, own.xy)
    np.testing.assert_array_equal(tracks.seen, own.seen)
    np.testing.assert_array_equal(tracks.radius, own.radius)


def test_a_turned_nearer_camera_with_larger_pins_gives_the_tracks_of_the_first(layout, framed):
    view, step = turned(), np.random.default_rng(4).uniform(-3, 3, layout.shape)
    first = framed(layout + step, layout, 4.2)
    other = framed(view(layout + step), view(layout), 4.2 * 1.1, 4.0 * 1.1)
    tracks = AlignedSensors.of([first]).tracks([other, first])
    assert tracks.seen.all()
    np.testing.assert_allclose(tracks.xy[0], tracks.xy[1], atol=0.06)
    np.testing.assert_allclose(tracks.radius[0], tracks.radius[1], rtol=0.01)


def test_a_pin_that_a_sensor_lacks_stands_at_rest_and_is_not_seen(layout, framed):
    sensors, view = AlignedSensors.of([framed(layout, layout)]), turned()
    rest, lost = sensors.first.rest, [7, 30]
    few = [np.delete(view(places), lost, axis=0) for places in (rest + 2.0, rest)]
    tracks = sensors.tracks([framed(*few)])
    assert np.flatnonzero(~tracks.seen[0]).tolist() == lost
    np.testing.assert_array_equal(tracks.xy[0, lost], rest[lost])
    np.testing.assert_allclose(np.delete(tracks.xy[0] - rest, lost, axis=0), 2.0, atol=0.06)


def test_sensors_without_a_rest_image_begin_with_the_other_frame(layout, framed):
    frames, still = [framed(layout + 3.0, None)], framed(layout, None)
    tracks = AlignedSensors.of(frames, still).tracks([still, *frames])
    np.testing.assert_allclose(tracks.xy[1] - tracks.xy[0], 3.0, atol=0.06)
    with pytest.raises(UserError, match="no rest image"):
        AlignedSensors.of(frames)
