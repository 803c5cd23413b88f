"""Images that are not what they were are named with file and line, and nothing is made of them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from png_bytes import png
from small_data_sets import header, image

from tactibench import UserError
from tactibench.datasets import Writer, open_dataset, verify

NAME = "images/000000/000002.png"


def other_pixels(data: bytes) -> bytes:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    return cv2.imencode(".png", image ^ 1)[1].tobytes()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda data: b"", "is not a PNG"),
        (lambda data: b"GIF89a" + data, "is not a PNG"),
        (lambda data: data[:-1], "is cut short"),
        (lambda data: data[: len(data) // 2], "is cut short"),
        (lambda data: data[:50] + bytes([data[50] ^ 1]) + data[51:], "is damaged"),
        (other_pixels, "was changed after it was written"),
        (lambda data: png(90_000, 90_000, b""), "was changed after it was written"),
    ],
)
def test_a_changed_file_is_named_wherever_it_is_read(
    closed_set: Path, damage: Callable[[bytes], bytes], says: str
) -> None:
    path = closed_set / NAME
    path.write_bytes(damage(path.read_bytes()))
    dataset = open_dataset(closed_set)  # lazily: opening reads no image
    sentence = rf"000002\.png {says}.*\(metadata\.jsonl line 3\)"
    for work in (
        lambda: dataset.image(dataset.samples[2]),
        lambda: dataset.images(dataset.samples[:1]),
        lambda: dataset.images(dataset.samples[:1], size=4),
    ):
        with pytest.raises(UserError, match=sentence):
            work()
    assert list((closed_set / ".cache").glob("*.npy")) == []
    dataset.image(dataset.samples[1])
    (finding,) = verify(closed_set)
    assert "000002.png" in finding
    assert says in finding


def test_a_bomb_that_was_written_with_its_own_checksum_is_never_decoded(
    closed_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Size and pixels are those of the header before a byte is decompressed."""
    import hashlib

    monkeypatch.setattr(cv2, "imdecode", None)
    for data in (png(90_000, 90_000, zlib.compress(b"")), png(8, 9, zlib.compress(b"x" * 81))):
        (closed_set / NAME).write_bytes(data)
        journal = closed_set / "metadata.jsonl"
        lines = journal.read_bytes().splitlines(keepends=True)
        before = open_dataset(closed_set, repair=False) if data[16:20] == b"\0\1\x5f\x90" else None
        if before is not None:
            old = before.samples[2].sha256
        lines[2] = lines[2].replace(old.encode(), hashlib.sha256(data).hexdigest().encode())
        old = hashlib.sha256(data).hexdigest()
        journal.write_bytes(b"".join(lines))
        header = closed_set / "dataset.json"
        text = header.read_text()
        sealed = text.partition('"journal_sha256": "')[2][:64]
        now = hashlib.sha256(journal.read_bytes()).hexdigest()
        header.write_text(text.replace(sealed, now))
        dataset = open_dataset(closed_set)
        with pytest.raises(UserError, match=r"changed its size to .*it was 9x7"):
            dataset.image(dataset.samples[2])


def test_a_kept_png_must_be_plain(tmp_path: Path) -> None:
    deep = cv2.imencode(".png", image(0).astype(np.uint16) * 257)[1].tobytes()
    clear = cv2.imencode(".png", np.dstack([image(0)] * 4))[1].tobytes()
    colour = cv2.imencode(".png", np.dstack([image(0)] * 3))[1].tobytes()
    short = cv2.imencode(".png", image(0))[1].tobytes()[:-3]
    junk = png(7, 9, b"junk")
    with Writer(tmp_path / "set", header()) as writer:
        for data, says in (
            (deep, "not an 8-bit 9x7 gray PNG"),
            (clear, "not an 8-bit 9x7 gray PNG"),
            (colour, "not an 8-bit 9x7 gray PNG"),
            (short, "cut short"),
            (junk, "cannot be decoded"),
        ):
            with pytest.raises(UserError, match=f"the image of sample 0 .*{says}"):
                writer.add(data, id=0)
