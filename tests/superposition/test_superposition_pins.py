"""Frames as displacements of pins, and which frames are single presses."""

import numpy as np
import pytest

from tactibench import Contacts, Frame, PlatePose, Pose, UserError
from tactibench.markers import PinTracker
from tactibench.superposition import contact_array, single_press_rows

ONE = Contacts.truth([[1.0, 2.0]], [3.0])
TWO = Contacts.truth([[1.0, 2.0], [4.0, 5.0]], [3.0, 6.0])


def test_rows_with_exactly_one_contact():
    truth = [ONE, TWO, Contacts.none(), ONE]
    assert single_press_rows(truth).tolist() == [0, 3]
    assert single_press_rows([]).tolist() == []
    assert single_press_rows([TWO]).tolist() == []


def test_a_plate_is_no_single_press():
    with pytest.raises(UserError, match="plate"):
        single_press_rows([ONE, PlatePose(1.0, 2.0)])


def test_contacts_as_rows():
    np.testing.assert_array_equal(contact_array([TWO, TWO]), [[[1, 2, 3], [4, 5, 6]]] * 2)
    assert contact_array([ONE] * 4).shape == (4, 1, 3)


def test_a_tracker_is_its_rest_image(singles):
    tracker = PinTracker.of(singles[0])
    again = PinTracker(tracker.rest_image.copy())
    images = tracker.images(singles[0][:5])
    np.testing.assert_array_equal(again.displacements(images), tracker.displacements(images))


def test_any_frame_with_a_rest_image_will_do(singles):
    bare = [Frame(frame.image, 0.0, Pose()) for frame in singles[0][:3]]
    tracker = PinTracker.of([*bare, singles[0][3]])
    np.testing.assert_array_equal(tracker.rest_image, singles[0][3].rest)


@pytest.mark.parametrize("count", [0, 3])
def test_without_a_rest_image_there_is_no_tracker(singles, count):
    with pytest.raises(UserError, match="rest image"):
        PinTracker.of([Frame(frame.image, 0.0, Pose()) for frame in singles[0][:count]])


def test_all_pins_that_were_seen_are_sure(singles, pins):
    tracker = PinTracker.of(singles[0])
    images = tracker.images(singles[0][:10])
    moved, sure = tracker.track(images)
    np.testing.assert_array_equal(moved, tracker.displacements(images))
    assert sure.shape == (10, len(pins))
    assert sure.dtype == np.bool_
    assert sure.mean() > 0.98
    assert tracker.pitch == pytest.approx(8.0, abs=0.05)


@pytest.mark.parametrize("lost", [0, 30, 60])
def test_around_a_pin_that_is_not_seen_all_are_doubtful(singles, pins, draw_pins, lost):
    """The lost one and its ring of neighbours at least; those far off are not."""
    tracker = PinTracker.of(singles[0])
    image = draw_pins(np.delete(pins, lost, axis=0))
    moved, sure = tracker.track(np.stack([image, draw_pins(pins)]))
    here = np.argmin(np.linalg.norm(tracker.rest - pins[lost], axis=1))
    spacings = np.linalg.norm(tracker.rest - tracker.rest[here], axis=1) / tracker.pitch
    assert not sure[0, spacings < 1.2].any()
    assert sure[0, spacings > 3].all()
    assert sure[1].all()
    assert np.isfinite(moved).all()
