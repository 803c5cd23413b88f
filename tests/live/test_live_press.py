"""Presses by hand: the truth is that of the scene, requests are bounded, failures are named."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tactibench import Contacts, UserError
from tactibench.live import MOST_TIPS, PressRequest

USUAL = {"tips": [[1.0, -2.0]], "depth": 1.5, "radius": 3.0}


def request(**changes: Any) -> PressRequest:
    return PressRequest.read(json.dumps({**USUAL, **changes}).encode())


def test_the_truth_is_what_was_pressed(session: Any, read: Any) -> None:
    tips = [[1.0, -2.0], [-3.0, 4.0], [5.0, 3.0]]
    head = read(session.press(request(tips=tips)))
    assert np.allclose(sorted(row[:3] for row in head["truth"]), sorted([*t, 1.5] for t in tips))
    assert head["pictures"]["frame"].shape == (128, 128)
    assert len(head["pins"]) == 127
    assert head["answers"][0]["error"]["missed"] == 3


def test_a_right_answer_has_no_error(session: Any, sayer: Any, read: Any) -> None:
    sayer.says = Contacts.truth([[1.0, -2.0]], [1.5])
    error = read(session.press(request()))["answers"][0]["error"]
    assert error == {"mm": 0.0, "depth_mm": 0.0, "missed": 0, "false": 0}


def test_without_tips_the_sensor_rests(session: Any, sayer: Any, read: Any) -> None:
    head = read(session.press(request(tips=[])))
    assert head["truth"] == []
    assert "skin" not in head["pictures"]
    frame = sayer.frames[0]
    assert np.array_equal(frame.signal, frame.rest)


def test_light_and_shift_change_the_frame_and_not_its_rest(session: Any, sayer: Any) -> None:
    session.press(request())
    session.press(request(light=0.5))
    session.press(request(shift=3.0))
    plain, dim, moved = (frame.image.astype(float) for frame in sayer.frames)
    assert dim.mean() == pytest.approx(plain.mean() / 2, rel=0.05)
    assert np.corrcoef(moved[:, 3:].ravel(), plain[:, :-3].ravel())[0, 1] > 0.97
    rests = [frame.rest for frame in sayer.frames]
    assert all(np.array_equal(rest, rests[0]) for rest in rests)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        json.dumps({**USUAL, "more": 1}).encode(),
        *(
            json.dumps({**USUAL, **changes}).encode()
            for changes in ({"tips": [[0.0, 0.0]] * (MOST_TIPS + 1)}, {"tips": [[21.0, 0.0]]})
        ),
        b'{"tips": [], "depth": NaN, "radius": 3.0}',
    ],
)
def test_a_request_beyond_its_bounds_is_refused_in_a_sentence(body: bytes) -> None:
    with pytest.raises(UserError, match="the press is not understood: ") as error:
        PressRequest.read(body)
    assert len(str(error.value)) < 300


def test_a_press_that_the_sensor_refuses_is_a_sentence(session: Any, read: Any) -> None:
    with pytest.raises(UserError, match="press less deep"):
        session.press(request(radius=2.0, depth=4.0))
    assert read(session.press(request()))["truth"], "the next press is answered"


def test_a_model_that_fails_is_named(session: Any, sayer: Any, read: Any) -> None:
    sayer.says = ZeroDivisionError("by nothing")
    with pytest.raises(UserError, match="model sayer failed on this frame: ZeroDivisionError"):
        session.press(request())
    sayer.says = Contacts.none()
    assert read(session.press(request()))["truth"]
