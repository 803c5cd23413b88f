"""Contact mixing: the frames and their truth; frames of several contacts are never read."""

from collections.abc import Sequence

import numpy as np
import pytest

from tactibench import UserError
from tactibench.markers import PinTracker
from tactibench.superposition import CLOSEST_MM, FEWEST, NeighbourLaw, contact_array, mix


def made(singles, count=24, seed=3, **more):
    return mix(*singles, count, np.random.default_rng(seed), **more)


@pytest.fixture(scope="module")
def mixed(singles):
    return made(singles)


@pytest.fixture(scope="module")
def duals(press):
    """(frames, truth) of 15 presses with two or three contacts."""
    rng = np.random.default_rng(21)
    pairs = [
        press(np.array([[-3.5, 1.0, 2.0], [3.5, -1.0, 3.0], [0.0, 5.5, 1.0]])[: 2 + k % 2])
        for k in rng.integers(0, 2, 15)
    ]
    frames, truth = zip(*pairs, strict=True)
    return list(frames), list(truth)


class Watched(Sequence):
    """Rows that remember which of them were read."""

    def __init__(self, rows):
        self.rows, self.read = rows, set()

    def __len__(self):
        return len(self.rows)

    def __getitem__(self, row):
        taken = range(len(self.rows))[row]
        self.read |= set(taken) if isinstance(row, slice) else {taken}
        return self.rows[row]


def shuffled(singles, others):
    """Both sets in one order; and which rows are single."""
    frames, truth = singles[0] + others[0], singles[1] + others[1]
    order = np.random.default_rng(5).permutation(len(frames))
    rows = [k for k, source in enumerate(order) if source < len(singles[0])]
    return [frames[k] for k in order], [truth[k] for k in order], rows


def in_order(frames, truth, rows):
    return [frames[k] for k in rows], [truth[k] for k in rows]


def assert_same(one, other):
    assert len(one[0]) == len(other[0])
    for a, b in zip(one[0], other[0], strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.rest, b.rest)
    for a, b in zip(one[1], other[1], strict=True):
        np.testing.assert_array_equal(a.xy, b.xy)
        np.testing.assert_array_equal(a.depth, b.depth)


def test_only_rows_of_single_presses_are_read(singles, duals):
    frames, truth, rows = shuffled(singles, duals)
    watched = Watched(frames)
    found = mix(watched, truth, 6, np.random.default_rng(3))
    assert watched.read == set(rows)
    assert_same(found, made(in_order(frames, truth, rows), 6))


def test_two_and_three_are_equally_frequent(singles, monkeypatch):
    from tactibench.superposition import PinPicture

    monkeypatch.setattr(
        PinPicture, "draw", lambda self, pins, *_: np.zeros((len(pins), 80, 80), np.uint8)
    )
    _, truth = made(singles, 1200)
    share = np.mean([len(one) == 2 for one in truth])
    assert abs(share - 0.5) < 4 * 0.5 / np.sqrt(1200)
    places = np.concatenate([np.column_stack([one.xy, one.depth]) for one in truth])
    known = contact_array(singles[1])[:, 0]
    low, high = known.min(axis=0), known.max(axis=0)
    assert (places >= low).all()
    assert (places <= high).all()
    # Depths fill their range evenly.
    assert np.histogram(places[:, 2], 4, (low[2], high[2]))[0] == pytest.approx(
        len(places) / 4, rel=0.12
    )
    for one in truth:
        gaps = np.linalg.norm(one.xy[:, None] - one.xy[None], axis=-1)
        assert gaps[np.triu_indices(len(one), 1)].min() >= CLOSEST_MM
        assert (one.score == 1).all()


def test_the_same_rng_the_same_frames(singles, mixed):
    assert_same(mixed, made(singles))
    other = made(singles, 3, seed=4)
    assert any((a.image != b.image).any() for a, b in zip(mixed[0], other[0], strict=False))


def test_the_pins_stand_where_the_fields_add_up(singles, push_pins):
    """Without a law of neighbours: displacements are the sums of the known field."""
    frames, truth = made(singles, 40, law=NeighbourLaw.none())
    tracker = PinTracker.of(singles[0])
    moved = tracker.displacements(tracker.images(frames))
    # Pins by place: the tracker's order is its own.
    wanted = np.stack([push_pins(np.column_stack([one.xy, one.depth])[None])[0] for one in truth])
    off = np.abs(moved - wanted)
    assert np.abs(wanted).mean() > 0.2
    assert np.median(off) < 0.05
    assert off.mean() < 0.1 * np.abs(wanted).mean() + 0.05


def test_a_law_of_neighbours_moves_the_pins(singles):
    none, law = (made(singles, 12, law=one) for one in (NeighbourLaw.none(), None))
    for a, b in zip(none[1], law[1], strict=True):  # the truth is no equivalent
        np.testing.assert_array_equal(a.xy, b.xy)
        np.testing.assert_array_equal(a.depth, b.depth)
    tracker = PinTracker.of(singles[0])
    moved = (tracker.displacements(tracker.images(made_frames)) for made_frames, _ in (none, law))
    ways = [np.abs(each).sum(axis=1) for each in moved]
    assert (np.abs(ways[0] - ways[1]) > 0.1).any()


@pytest.mark.parametrize("count", [0, FEWEST - 1])
def test_too_few_single_presses_are_refused(singles, duals, count):
    frames, truth = singles[0][:count] + duals[0], singles[1][:count] + duals[1]
    with pytest.raises(UserError, match=f"at least {FEWEST} single presses and found {count}"):
        mix(frames, truth, 4, np.random.default_rng(0))


def test_a_range_too_small_for_three_contacts_is_refused(press):
    rng = np.random.default_rng(6)
    contacts = rng.uniform([-1.5, -1.5, 1], [1.5, 1.5, 4], (40, 3))
    frames, truth = zip(*(press(one[None]) for one in contacts), strict=True)
    with pytest.raises(UserError, match="too little") as caught:
        mix(frames, truth, 10, np.random.default_rng(0))
    assert f"{CLOSEST_MM:g} mm" in str(caught.value)
