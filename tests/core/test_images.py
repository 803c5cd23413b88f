import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import Frame, Pose, UserError, gray_frames
from tactibench.png import ImageKind, check_png, decode_png, encode_png


def frame(image):
    return Frame(image, 0.0, Pose(0, 0, 0, 0, 1))


@pytest.fixture(scope="module")
def grey():
    return np.random.default_rng(0).integers(0, 256, (12, 16), dtype=np.uint8)


def read(image, size=8):
    return gray_frames([frame(image)], size)[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda image: image[..., None],
        lambda image: image[None],
        lambda image: np.stack([image] * 3, axis=-1),
        lambda image: np.stack([image] * 3),
        lambda image: np.dstack([image, image, image, np.zeros_like(image)]),
        lambda image: np.stack([image, image, image, np.zeros_like(image)]),
        lambda image: image.astype(np.int64),
        lambda image: image.astype(np.uint16),
        lambda image: image.astype(np.float32),
        lambda image: image.astype(np.float64) / 255,
        lambda image: (np.stack([image] * 3) / 255).astype(np.float32),
        lambda image: np.asfortranarray(image),
        lambda image: np.repeat(image, 2, axis=1)[:, ::2],
    ],
)
def test_what_is_clearly_the_same_picture_is_read_the_same(grey, change):
    assert np.array_equal(read(change(grey)), read(grey))


def test_colours_are_weighted_as_rgb_at_either_end():
    red, green, blue = np.zeros((3, 8, 8, 3), np.uint8)
    red[..., 0], green[..., 1], blue[..., 2] = 255, 255, 255
    for image, level in ((red, 76), (green, 150), (blue, 29)):  # 255 * (.299, .587, .114)
        assert (read(image) == level).all()
        assert (read(np.moveaxis(image, -1, 0)) == level).all()


def test_shrinking_averages_areas_and_keeps_the_mean(grey):
    half = read(grey[:, :12].repeat(4, 0).repeat(4, 1), 12)
    assert np.array_equal(half, grey[:, :12])


@given(st.floats(0, 1), st.sampled_from([np.float16, np.float32, np.float64]))
def test_floats_from_0_to_1_are_shares_of_white(share, kind):
    image = np.full((8, 8), share, dtype=kind)
    assert read(image)[0, 0] == round(255 * float(image[0, 0]))


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.full((8, 8), np.nan), "NaN"),
        (np.full((8, 8), np.inf, np.float32), "infinite"),
        (np.full((8, 8), -0.5), "-0.5"),
        (np.full((8, 8), 1.2), "1.2"),
        (np.full((8, 8), 256.0), "256"),
        (np.full((8, 8), 4095, np.uint16), "4095"),
        (np.full((8, 8), -1, np.int32), "-1"),
        (np.zeros((8, 8), complex), "complex"),
        (np.zeros((8, 8), "U1"), "U1"),
        (np.zeros((8, 8), object), "object"),
        (np.zeros((8, 8, 2), np.uint8), "shape"),
        (np.zeros((5, 8, 8), np.uint8), "shape"),
        (np.zeros((1, 1, 8, 8), np.uint8), "shape"),
        (np.zeros(8, np.uint8), "shape"),
        (np.zeros((0, 8), np.uint8), "shape"),
    ],
    ids=str,
)
def test_what_is_unclear_is_refused_by_number_and_reason(grey, image, words):
    with pytest.raises(UserError, match=r"frame 2 of 3") as caught:
        gray_frames([frame(grey), frame(image), frame(grey)], 8)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("image", "rest"),
    [
        ((128, 168), (128, 128)),
        ((128, 120), (128, 128)),
        ((128, 127), (128, 128)),
        ((256, 256), (128, 127)),
        ((3, 90, 64), (64, 64, 3)),
        ((64, 64), (64, 90)),
    ],
)
def test_a_frame_of_another_crop_than_its_rest_frame_is_refused(image, rest) -> None:
    for one, other in ((image, rest), (rest, image)):
        frame = Frame(np.zeros(one, np.uint8), 0.0, Pose(), np.zeros(other, np.uint8))
        with pytest.raises(UserError, match="another crop cannot"):
            gray_frames([frame], 32)


@pytest.mark.parametrize(
    ("image", "rest"),
    [
        ((256, 256), (128, 128)),
        ((128, 128, 3), (64, 64)),
        ((3, 48, 64), (96, 128)),
        ((101, 135), (480, 640)),
        ((64, 64, 1), (64, 64)),
    ],
)
def test_another_size_or_depth_of_colour_than_the_rest_frame_is_read(image, rest) -> None:
    levels = np.random.default_rng(0).integers(0, 256, image, dtype=np.uint8)
    for one, other in ((levels, np.zeros(rest, np.uint8)), (levels, None)):
        read = gray_frames([Frame(one, 0.0, Pose(), other)], 32)
        np.testing.assert_array_equal(read, gray_frames([Frame(levels, 0.0, Pose())], 32))


shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))
images = st.one_of(shapes, shapes.map(lambda shape: (*shape, 3))).flatmap(
    lambda shape: arrays(np.uint8, shape)
)


@given(images)
def test_round_trip(image: np.ndarray) -> None:
    data = encode_png(image)
    kind = check_png("x.png", data)
    assert kind.shape == image.shape
    assert np.array_equal(decode_png("x.png", data, kind), image)
    outside = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(outside if image.ndim == 2 else outside[..., ::-1], image)


@given(images, st.data())
def test_every_cut_and_every_flip_of_a_bit_is_noticed(image: np.ndarray, data: st.DataObject):
    whole = encode_png(image)
    with pytest.raises(UserError, match=r"x\.png is (not a PNG|cut short)"):
        check_png("x.png", whole[: data.draw(st.integers(0, len(whole) - 1))])
    at, bit = data.draw(st.integers(0, len(whole) - 1)), data.draw(st.integers(0, 7))
    flipped = bytearray(whole)
    flipped[at] ^= 1 << bit
    with pytest.raises(UserError, match=r"x\.png is (not a PNG|cut short|damaged)"):
        check_png("x.png", bytes(flipped))


def test_another_format_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pixels would not have been counted."""
    data = cv2.imencode(".jpg", np.zeros((9, 7), np.uint8))[1].tobytes()
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(UserError, match="cannot be decoded as PNG"):
        decode_png("x.png", data, ImageKind(9, 7, colour=False))


def test_a_bomb_is_counted_before_it_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "imdecode", None)
    head = b"IHDR" + struct.pack(">IIBBBBB", 20_000, 20_000, 8, 0, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n\0\0\0\r" + head + struct.pack(">I", zlib.crc32(head))
    kind = ImageKind(20_000, 20_000, colour=False)
    with pytest.raises(UserError, match="claims 20,000 x 20,000 pixels, allowed are 64,000,000"):
        decode_png("x.png", data, kind)
    with pytest.raises(UserError, match="changed its size to 20000x20000 meanwhile, it was 9x7"):
        decode_png("x.png", data, ImageKind(9, 7, colour=False))
