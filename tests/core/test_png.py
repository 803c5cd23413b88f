"""PNG files: without loss, and never more pixels than any sensor has."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import UserError
from tactibench.png import ImageKind, check_png, decode_png, encode_png

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
