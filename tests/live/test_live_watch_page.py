"""The page of a camera: the newest frame, once, and the end."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from asked_page import ask_page

from tactibench import UserError
from tactibench.live import AnswerView, FrameView, WatchPage, pages


def view(level: int) -> FrameView:
    return FrameView(np.full((4, 4), level, np.uint8), [], [AnswerView(None, 1.0)])


def after(page: WatchPage, number: int) -> bytes:
    body = json.dumps({"after": number}).encode()
    return ask_page(page.url, "/next", body)[0]


def test_the_newest_frame_is_shown_and_none_twice(read: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(pages, "PATIENCE_S", 0.0)
    with WatchPage("unet", 12.8) as page:
        assert "answers" not in read(after(page, 0))
        page.show(view(1))
        page.show(view(2))
        head = read(after(page, 0))
        assert head["number"] == 2
        assert head["pictures"]["frame"].max() == 2
        assert head["truth"] is head["answers"][0]["error"] is None
        assert "answers" not in read(after(page, 2))
        assert read(after(page, 7))["number"] == 2, "a page of an earlier program sees this one's"


def test_a_page_that_waits_is_told_of_the_end(read: Any) -> None:
    page = WatchPage("unet", 12.8)
    with page:
        page.show(view(1))
    assert read(page._next(b'{"after": 1}'))["ended"] is True


@pytest.mark.parametrize("body", [b"", b'{"after": -1}', b'{"after": "1"}', b'{"after": 1e99}'])
def test_other_requests_are_refused(body: bytes) -> None:
    page = WatchPage("unet", 12.8)
    with page, pytest.raises(UserError, match="names no frame"):
        page._next(body)


def test_the_page_and_its_settings_are_served() -> None:
    with WatchPage("unet<b>", 12.8) as page:
        for path, kind in (("", "html"), ("page.js", "javascript"), ("page.css", "css")):
            assert ask_page(page.url, f"/{path}")[1] == f"text/{kind}; charset=utf-8"
        settings = json.loads(ask_page(page.url, "/settings.json")[0])
    assert settings["kind"] == "watch"
    assert settings["models"][0]["label"] == "unet<b>"
