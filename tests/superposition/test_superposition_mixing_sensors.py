"""Contact mixing on several sensors: each frame is its sensor's, as its camera sees it."""

import numpy as np
import pytest

from tactibench import Contacts, Frame, Pose
from tactibench.markers import PinTracker, Similarity
from tactibench.superposition import NeighbourLaw, contact_array, mix

pytestmark = pytest.mark.long

SENSORS = [  # turn of the camera, rad; shift, px; how far pins move, against the first sensor's
    (0.0, (0.0, 0.0), 1.0),
    (0.04, (1.0, -0.5), 1.4),
    (-0.03, (0.3, 0.7), 0.7),
]
NONE = NeighbourLaw.none()


@pytest.fixture(scope="module")
def views(pins):
    middle = pins.mean(axis=0)
    return [Similarity.of(np.array(shift), turn, 0.0, middle) for turn, shift, _ in SENSORS]


@pytest.fixture(scope="module")
def several(pins, views, draw_pins, push_pins, random_contacts):
    """60 presses of each sensor, one sensor after the other by turns: (frames, truth)."""
    contacts = random_contacts(180, np.random.default_rng(2))
    rests = [draw_pins(view(pins)) for view in views]
    frames = []
    for k, contact in enumerate(contacts):
        moved = SENSORS[k % 3][2] * push_pins(contact[None, None])[0].reshape(2, -1).T
        frames.append(Frame(draw_pins(views[k % 3](pins + moved)), 0.0, Pose(), rests[k % 3]))
    return frames, [Contacts.truth(one[None, :2], one[2:]) for one in contacts]


@pytest.fixture(scope="module")
def mixed(several):
    return mix(*several, 30, np.random.default_rng(4), NONE)


def sensor_of(frame, several):
    return next(k for k in range(3) if np.array_equal(frame.rest, several[0][k].rest))


def test_as_many_are_made_of_every_sensor(mixed, several):
    numbers = [sensor_of(frame, several) for frame in mixed[0]]
    assert np.bincount(numbers).tolist() == [10, 10, 10]
    assert numbers != sorted(numbers), "they stand in no order"


def test_pins_move_as_on_their_sensor_alone(mixed, several, views, pins, push_pins):
    """Of sums of fields, seen by the sensor's camera; another sensor's would be far off."""
    trackers = [PinTracker(several[0][k].rest) for k in range(3)]
    gains: list[list[float]] = [[], [], []]
    for frame, truth in zip(*mixed, strict=True):
        number = sensor_of(frame, several)
        tracker = trackers[number]
        moved = tracker.displacements(frame.image[None])[0].reshape(2, -1).T
        straight = moved @ np.linalg.inv(views[number].matrix).T
        apart = np.linalg.norm(views[number].back(tracker.rest)[:, None] - pins, axis=-1)
        wanted = push_pins(contact_array([truth]))[0].reshape(2, -1).T[apart.argmin(axis=1)]
        gains[number].append(float((straight * wanted).sum() / np.square(wanted).sum()))
    for found, (_, _, gain) in zip(gains, SENSORS, strict=True):
        assert np.median(found) == pytest.approx(gain, abs=0.1)


def test_a_sensor_with_few_presses_is_learned_from_and_not_drawn(several):
    frames, truth = several
    rows = [k for k in range(180) if k % 3 != 2 or k < 15]  # five of the third
    some, _ = mix([frames[k] for k in rows], [truth[k] for k in rows], 9, np.random.default_rng(4))
    assert {sensor_of(frame, several) for frame in some} == {0, 1}
