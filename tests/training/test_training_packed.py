import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import UserError
from tactibench.training import pack_image, unpack_image


@given(arrays(np.uint8, st.tuples(st.integers(0, 9), st.integers(0, 9))))
@settings(max_examples=30, deadline=None)
def test_an_image_is_the_same_after_json(image):
    other = unpack_image(json.loads(json.dumps(pack_image(image))))
    assert np.array_equal(other, image)
    assert other.shape == image.shape
    assert other.dtype == np.uint8
    assert other.flags.writeable


def test_parts_of_an_image_are_packed_as_they_look():
    image = np.arange(60, dtype=np.uint8).reshape(6, 10)[::2, ::-3]
    assert np.array_equal(unpack_image(pack_image(image)), image)


def test_an_image_of_one_level_takes_little_room():
    assert len(pack_image(np.full((256, 256), 7, np.uint8))) < 200


@pytest.mark.parametrize(
    "break_it",
    [
        lambda text: "",
        lambda text: text[:-9],
        lambda text: text.replace("3 4", "3 5"),
        lambda text: text.replace("3 4", "3 x"),
        lambda text: text + "\u00e9",
        lambda text: text.split(" ")[2],
    ],
)
def test_a_broken_text_is_refused(break_it):
    text = pack_image(np.arange(12, dtype=np.uint8).reshape(3, 4))
    with pytest.raises(UserError, match="train the model again"):
        unpack_image(break_it(text))
