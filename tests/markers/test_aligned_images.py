"""Images of other sensors of one make, as on the layout of the first one."""

import numpy as np
import pytest

from tactibench import Frame, Pose
from tactibench.markers import AlignedImages, Similarity

SIZE = 120


@pytest.fixture
def layout():
    """(61, 2) px: a hexagon around the middle."""
    steps = range(-4, 5)
    axial = np.array([(i, j) for i in steps for j in steps if abs(i + j) <= 4])
    return 10.2 * axial @ [[1.0, 0.0], [0.5, np.sqrt(3) / 2]] + SIZE / 2


@pytest.fixture
def draw(drawn):
    return lambda places, size=SIZE: drawn(places, 2.4 * size / SIZE, size, soft=True)


def frame(image, rest):
    return Frame(image, 0.0, Pose(), rest)


def difference(one, other):
    """Rms grey levels, of two images away from their border."""
    return np.sqrt(np.square(one[10:-10, 10:-10].astype(float) - other[10:-10, 10:-10]).mean())


def test_the_reference_sensor_is_seen_as_it_is(layout, draw):
    rest, pressed = draw(layout), draw(layout + np.array([1.5, 0.0]))
    aligned = AlignedImages.of([frame(pressed, rest)], SIZE)
    seen = aligned([frame(pressed, rest), frame(pressed, rest.copy()), Frame(pressed, 0.0, Pose())])
    for image, still in seen:
        np.testing.assert_array_equal(image, pressed)
        np.testing.assert_array_equal(still, rest)


@pytest.mark.parametrize(("degrees", "stretch", "shift"), [(5, 0.0, (3, -4)), (-2, 0.05, (0, 0))])
def test_a_remounted_camera_shows_the_same_images(layout, draw, degrees, stretch, shift):
    view = Similarity.of(np.array(shift), np.radians(degrees), stretch, np.full(2, SIZE / 2))
    moved = layout + np.random.default_rng(1).uniform(-1.8, 1.8, layout.shape)
    aligned = AlignedImages(draw(layout))
    ((image, still),) = aligned([frame(draw(view(moved)), draw(view(layout)))])
    assert difference(draw(view(moved)), draw(moved)) > 30
    # Discs are drawn of one size, whatever the stretch.
    most = 8 if not stretch else 16
    assert difference(image, draw(moved)) < most
    assert difference(still, draw(layout)) < most


def test_frames_of_another_size_are_seen_at_the_same_place(layout, draw):
    """Pixels' centres are places: the middle of the first pixel of a frame of half the size."""
    view = Similarity.of(np.array([2.0, 1.0]), np.radians(3), 0.0, np.full(2, SIZE / 2))
    double = 2 * view(layout) + 0.5
    aligned = AlignedImages(draw(layout))
    ((image, _),) = aligned([frame(draw(double, 2 * SIZE), draw(double, 2 * SIZE))])
    assert difference(image, draw(layout)) < 8


def test_what_has_no_pins_or_others_is_seen_as_it_is(layout, draw):
    black = np.zeros((SIZE, SIZE), np.uint8)
    others = draw(layout[::2])
    aligned = AlignedImages(draw(layout))
    seen = aligned([frame(black, black), frame(others, others)])
    np.testing.assert_array_equal(seen[0], [black, black])
    np.testing.assert_array_equal(seen[1], [others, others])


def test_there_are_none_where_a_frame_has_no_rest_image(layout, draw):
    image = draw(layout)
    assert AlignedImages.of([frame(image, image), Frame(image, 0.0, Pose())], SIZE) is None
    assert AlignedImages.of([], SIZE) is None
    assert AlignedImages.of([frame(image, image)], 50).rest.shape == (50, 50)
