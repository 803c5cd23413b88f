"""Pins and images of a sensor as another sees them: camera, pose and layout are undone."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_pins import hexagon
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import Frame, Pose, UserError
from tactibench.frames import FAULTS
from tactibench.markers import (
    AlignedImages,
    AlignedPins,
    AlignedSensors,
    Outline,
    PinTracker,
    Similarity,
    common_lattice,
    common_view,
    kriging_weights,
)

SIZE = 200


def turned(degrees=5.0, stretch=0.06, shift=(4.0, -7.0)):
    return Similarity.of(np.array(shift), np.radians(degrees), stretch, np.full(2, SIZE / 2))


@pytest.fixture
def layout(hexagon):
    return hexagon(17.0, SIZE)


@pytest.fixture
def pins_of(drawn):
    """Pins of sharp discs, to which nothing is fitted: that takes a second a sensor."""
    return lambda places, soft=False: PinTracker(drawn(places, 4.0, SIZE, soft=soft))


def test_a_similarity_is_a_turn_a_stretch_and_a_shift():
    view, places = turned(90.0, np.log(2.0), (1.0, 0.0)), np.array([[100.0, 100.0], [110.0, 100.0]])
    np.testing.assert_allclose(view(places), [[101.0, 100.0], [101.0, 120.0]], atol=1e-9)
    np.testing.assert_allclose(view.back(view(places)), places)
    np.testing.assert_allclose(turned().after(view)(places), turned()(view(places)))


def test_a_turned_nearer_camera_sees_the_same_displacements(layout, pins_of, drawn):
    rng, view = np.random.default_rng(1), turned()
    step = rng.uniform(-3, 3, layout.shape)
    aligned = AlignedPins(pins_of(view(layout), soft=True), layout)
    image = drawn(view(layout + step), 4.0, SIZE, soft=True)[None]
    moved, sure = aligned.track(image)
    assert sure.all()
    np.testing.assert_allclose(moved[0], step.T.reshape(-1), atol=0.05)
    again, seen = aligned.retrack(image, moved + 0.5)
    assert seen.all()
    np.testing.assert_allclose(again, moved, atol=0.05)
    assert aligned.layout_clues[0] == pytest.approx(0.06, abs=1e-3)


@pytest.mark.parametrize("degrees", [-20, 9])
def test_a_turn_of_the_camera_is_found(layout, pins_of, degrees):
    aligned = AlignedPins(pins_of(turned(degrees)(layout)), layout)
    np.testing.assert_allclose(aligned.view(layout), turned(degrees)(layout), atol=0.1)


def test_a_pin_without_a_tip_is_not_sure(layout, pins_of):
    lost = [7, 30]
    aligned = AlignedPins(pins_of(np.delete(turned()(layout), lost, axis=0)), layout)
    _, sure = aligned.track(aligned.pins.rest_image[None])
    assert np.flatnonzero(~sure[0]).tolist() == lost


def test_pins_that_do_not_fit_are_refused(layout, pins_of):
    other = np.random.default_rng(2).permutation(layout)[:30]
    with pytest.raises(UserError, match="same make"):
        AlignedPins(pins_of(other), layout)


@pytest.mark.parametrize("light", [0.3, 1.4])
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


SIDE = 120


@pytest.fixture
def small_layout(hexagon):
    return hexagon(10.2, SIDE)


@pytest.fixture
def draw(drawn):
    return lambda places, size=SIDE: drawn(places, 2.4 * size / SIDE, size, soft=True)


def frame(image, rest):
    return Frame(image, 0.0, Pose(), rest)


def difference(one, other):
    """Rms grey levels, of two images away from their border."""
    return np.sqrt(np.square(one[10:-10, 10:-10].astype(float) - other[10:-10, 10:-10]).mean())


def test_the_reference_sensor_is_seen_as_it_is(small_layout, draw):
    rest, pressed = draw(small_layout), draw(small_layout + np.array([1.5, 0.0]))
    aligned = AlignedImages.of([frame(pressed, rest)], SIDE)
    seen = aligned([frame(pressed, rest), frame(pressed, rest.copy()), Frame(pressed, 0.0, Pose())])
    for image, still in seen:
        np.testing.assert_array_equal(image, pressed)
        np.testing.assert_array_equal(still, rest)


@pytest.mark.parametrize(("degrees", "stretch", "shift"), [(15, 0.0, (3, -4)), (-2, 0.05, (0, 0))])
def test_a_remounted_camera_shows_the_same_images(small_layout, draw, degrees, stretch, shift):
    view = Similarity.of(np.array(shift), np.radians(degrees), stretch, np.full(2, SIDE / 2))
    moved = small_layout + np.random.default_rng(1).uniform(-1.8, 1.8, small_layout.shape)
    aligned = AlignedImages(draw(small_layout))
    ((image, still),) = aligned([frame(draw(view(moved)), draw(view(small_layout)))])
    assert difference(draw(view(moved)), draw(moved)) > 30
    # Discs are drawn of one size, whatever the stretch.
    most = 8 if not stretch else 16
    assert difference(image, draw(moved)) < most
    assert difference(still, draw(small_layout)) < most


@pytest.mark.long
def test_frames_of_another_size_are_seen_at_the_same_place(small_layout, draw):
    """Pixels' centres are places: the middle of the first pixel of a frame of half the size."""
    view = Similarity.of(np.array([2.0, 1.0]), np.radians(3), 0.0, np.full(2, SIDE / 2))
    double = 2 * view(small_layout) + 0.5
    aligned = AlignedImages(draw(small_layout))
    ((image, _),) = aligned([frame(draw(double, 2 * SIDE), draw(double, 2 * SIDE))])
    assert difference(image, draw(small_layout)) < 8


def test_there_are_none_where_a_frame_has_no_rest_image(small_layout, draw):
    image = draw(small_layout)
    assert AlignedImages.of([frame(image, image), Frame(image, 0.0, Pose())], SIDE) is None
    assert AlignedImages.of([], SIDE) is None
    assert AlignedImages.of([frame(image, image)], 50).rest.shape == (50, 50)


RING = np.array(
    [
        (k * np.cos(a), k * np.sin(a)) if k else (0.0, 0.0)
        for k in range(11)
        for a in 2 * np.pi * np.arange(max(1, 6 * k)) / max(1, 6 * k)
    ]
)
"""331 pins in ten rings, radius 10."""


def dimple(places):
    """(P, 2) units: pins flee from a contact, as under a plate."""
    away = places - [0.1, -0.2]
    return 0.1 * away * np.exp(-(away**2).sum(axis=1, keepdims=True) / (2 * 0.4**2))


def packed(field):
    return field.T.reshape(1, -1)


@given(st.floats(0.7, 1.4), st.floats(20, 200), st.floats(-50, 50))
def test_an_outline_undoes_an_uneven_resize(uneven, size, shift):
    stretched = RING * [size, uneven * size] + shift
    found = Outline.of(stretched)
    np.testing.assert_allclose(found.centre, shift, atol=1e-6 * size)
    np.testing.assert_allclose(found.scale, [10 * size, 10 * uneven * size], rtol=1e-9)


@settings(max_examples=20)
@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_linear_fields_are_carried_exactly(slope):
    points = common_lattice()
    matrix, shift = np.array(slope[:4]).reshape(2, 2), np.array(slope[4:])
    weights = kriging_weights(RING / 10, points)
    found = weights @ (RING / 10 @ matrix + shift)
    np.testing.assert_allclose(found, points @ matrix + shift, atol=1e-9)


@pytest.mark.parametrize("lost", [0, 12])
def test_two_layouts_give_one_view_also_without_some_pins(lost):
    points = common_lattice()
    found = []
    for layout, px in ((RING, 13.0), (hexagon(6, 10 / 6, 0.0), 9.0)):
        keep = np.random.default_rng(0).permutation(len(layout))[lost:]
        keep = np.union1d(keep, np.argsort(np.hypot(*layout.T))[-6:])
        rest = layout[np.sort(keep)] * px + [180, 130]
        moved = 10 * px * dimple((rest - [180, 130]) / (10 * px))
        found.append(common_view(rest, points)(packed(moved)))
    np.testing.assert_allclose(found[0], found[1], atol=0.004)  # of a field of 0.024
    if not lost:
        np.testing.assert_allclose(found[0], packed(dimple(points)), atol=0.001)


def test_pins_on_a_line_and_too_few_are_refused():
    for rest in (np.column_stack([np.arange(9.0), np.zeros(9)]), RING[:6]):
        with pytest.raises(UserError, match="outline"):
            Outline.of(rest)
