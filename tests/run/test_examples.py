"""Frames that stay with a run, and what the layers of a model made of one of them."""

from __future__ import annotations

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, Pose, UserError
from tactibench.run import CHANNELS, EXAMPLES, example_arrays, pack_features, unpack_features


class Shows(StubModel):
    def __init__(self):
        self.seen = []

    def features(self, frame):
        self.seen.append(frame)
        scale = np.arange(8.0)[:, None, None]
        return {"one": scale * np.eye(4)[None], "two. b": np.ones((2, 3, 3))}


def frames(count):
    return [Frame(np.full((2, 2), k, np.uint8), float(k), Pose(depth=1.0)) for k in range(count)]


def contacts(count):
    return Contacts.truth(np.zeros((count, 2)) + np.arange(count)[:, None], np.ones(count))


def test_frames_are_spread_over_all():
    arrays = example_arrays(frames(100), [contacts(1)] * 100, StubModel())
    assert len(arrays["index"]) == EXAMPLES
    assert (arrays["images"][:, 0, 0] == arrays["index"]).all()
    assert set(arrays) == {"index", "images"}


def test_features_are_of_the_first_frame_with_the_most_contacts_and_blind():
    truth = [contacts(1 + (k in (3, 5))) for k in range(8)]
    model = Shows()
    arrays = example_arrays(frames(8), truth, model)
    assert int(arrays["features_row"]) == 3
    (seen,) = model.seen
    assert (seen.image == 3).all()
    assert seen.pose == Pose()
    assert seen.timestamp == 0.0


def test_the_most_varied_channels_stay_in_the_order_of_the_layers():
    one, two = unpack_features(pack_features(Shows().features(None)))
    assert (one[0], one[1], one[2].shape) == ("one", 8, (CHANNELS, 4, 4))
    assert one[2].max(axis=(1, 2)).tolist() == [7, 6, 5, 4, 3, 2]
    assert (two[0], two[1], two[2].shape) == ("two. b", 2, (2, 3, 3))
    assert unpack_features({"index": np.zeros(1)}) == []


@pytest.mark.parametrize("values", [np.ones((3, 3)), np.full((1, 2, 2), np.nan)])
def test_features_that_are_no_finite_maps_are_refused(values):
    with pytest.raises(UserError, match="must be finite and of shape"):
        pack_features({"bad": values})
