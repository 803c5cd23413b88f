"""What a page is sent: errors in closed form, pictures as they were."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tactibench import Contacts
from tactibench.live import (
    AnswerView,
    FrameView,
    contact_errors,
    pack,
)

ONE = Contacts.truth([[1.0, 2.0]], [1.5])
TWO = Contacts.truth([[1.0, 2.0], [-4.0, 0.0]], [1.5, 2.0])
NONE = Contacts.none()


@pytest.mark.parametrize(
    ("truth", "said", "expected"),
    [
        (ONE, ONE, (0.0, 0.0, 0, 0)),
        (ONE, Contacts.truth([[1.3, 2.4]], [1.0]), (0.5, 0.5, 0, 0)),
        (TWO, ONE, (0.0, 0.0, 1, 0)),
        (ONE, TWO, (0.0, 0.0, 0, 1)),
        (ONE, NONE, (None, None, 1, 0)),
        (NONE, ONE, (None, None, 0, 1)),
        (NONE, NONE, (None, None, 0, 0)),
        (ONE, Contacts.truth([[4.0, 2.0]], [1.5]), (None, None, 1, 1)),  # at the gate
        (TWO, Contacts.truth([[-4.0, 0.6], [1.0, 2.0]], [2.2, 1.5]), (0.3, 0.1, 0, 0)),
    ],
)
def test_errors_are_means_over_pairs_and_counts_of_the_rest(
    truth: Contacts, said: Contacts, expected: tuple[Any, ...]
) -> None:
    found = contact_errors(truth, said, gate_mm=3.0)
    assert tuple(found.values()) == pytest.approx(expected)


def test_pictures_come_back_as_they_were(read: Any) -> None:
    rng = np.random.default_rng(0)
    pictures = {
        "a": rng.integers(0, 256, (3, 5), dtype=np.uint8),
        "b": rng.random((4, 2), dtype=np.float32),
        "c": rng.integers(0, 256, (2, 2), dtype=np.uint8)[:, ::-1],
    }
    head = read(pack({"number": 7}, pictures))
    assert head["number"] == 7
    for name, picture in pictures.items():
        assert np.array_equal(head["pictures"][name], picture)


def test_a_view_shows_frame_map_contacts_and_error(read: Any) -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    maps = np.array([[[-0.1, 0.0], [0.5, 1.2]]], dtype=np.float32)
    answers = [AnswerView(ONE, 1.25, maps), AnswerView(None, 2.0)]
    view = FrameView(image, [(0.0, 1.0, 2.04, 3.0, True)], answers, TWO, 3.0, np.eye(2))
    head = read(view.message(3))
    assert np.array_equal(head["pictures"]["frame"], image)
    assert np.array_equal(head["pictures"]["skin"], np.eye(2))
    assert head["pictures"]["map0"].tolist() == [[0, 0], [127, 255]]
    assert "map1" not in head["pictures"]
    assert head["pins"] == [[0.0, 1.0, 2.0, 3.0, 1]]
    assert head["truth"] == [[1.0, 2.0, 1.5, 1.0], [-4.0, 0.0, 2.0, 1.0]]
    first, second = head["answers"]
    assert first["ms"] == 1.25
    assert first["contacts"] == [[1.0, 2.0, 1.5, 1.0]]
    assert first["error"] == {"mm": 0.0, "depth_mm": 0.0, "missed": 1, "false": 0}
    assert second["contacts"] == []
    assert second["error"]["missed"] == 2
