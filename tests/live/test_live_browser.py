"""The page in headless Chromium: mouse, fingers, keys, sliders, a phone, hostile names, an end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser import chromium

from tactibench import Contacts
from tactibench.live import AnswerView, FrameView, PressPage, WatchPage

sync_api = pytest.importorskip("playwright.sync_api", reason="needs tactibench[browser]")
if chromium() is None:
    pytest.skip("no Chromium here; TACTIBENCH_CHROMIUM names one", allow_module_level=True)

pytestmark = pytest.mark.long
HOSTILE = "<img src=x onerror='window.broken=1'>"
PATIENCE_MS = 60_000


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        yield made
        made.close()


@pytest.fixture
def served(session: Any) -> Iterator[PressPage]:
    models = [("sayer", "#0072B2")]
    with PressPage(
        session,
        models,
        sensor="tactip-127",
        half_mm=12.8,
        learned_mm=6.4,
        dome_mm=20.0,
        instances=True,
    ) as page:
        yield page


class Tab:
    """A page with all that it complained about and asked for."""

    def __init__(self, browser: Any, url: str, **more: Any) -> None:
        self.context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **more})
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(url)
        self.page.wait_for_selector("html[data-ready]", state="attached")

    @property
    def dome(self) -> Any:
        return self.page.locator("#dome canvas")

    def at(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        box = self.dome.bounding_box()
        return tuple(
            box[low] + box[size] * (value / 12.8 + 1) / 2
            for low, size, value in (("x", "width", x_mm), ("y", "height", y_mm))
        )

    def until(self, text: str, selector: str = ".error") -> None:
        self.page.wait_for_function(
            "([s, t]) => new RegExp(t).test(document.querySelector(s).innerText)",
            arg=[selector, text],
        )

    def wait(self, condition: str) -> None:
        """Wait until JavaScript is true; as a function, which the page's policy lets pass."""
        self.page.wait_for_function(f"() => {condition}")

    def truth(self) -> list[list[float]]:
        found: list[list[float]] = self.page.evaluate("state.last.truth.map(t => t.slice(0, 3))")
        return found


@pytest.fixture
def tab(browser: Any, served: PressPage) -> Iterator[Tab]:
    made = Tab(browser, served.url)
    made.until("1 missed")
    yield made
    made.context.close()


def test_the_mouse_presses_where_it_points(tab: Tab, sayer: Any) -> None:
    sayer.says = Contacts.truth([[3.0, -2.0]], [2.0])
    tab.page.mouse.move(*tab.at(0, 0))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.at(3, -2), steps=4)
    tab.page.mouse.up()
    tab.until(r"off by 0\.0\d\d mm, depth by 0\.000 mm")
    assert tab.truth()[0] == pytest.approx([3.0, -2.0, 2.0], abs=0.05)
    assert "ms from mouse to answer" in tab.page.locator("#speed").inner_text()
    assert tab.said == []
    assert all(url.startswith((tab.page.url, "data:")) for url in tab.asked)


def test_sliders_change_the_press_the_frame_and_the_sensor(tab: Tab, sayer: Any) -> None:
    def slide(name: str, value: str) -> Any:
        asked = len(sayer.frames)
        tab.page.locator(f"input[name={name}]").fill(value)
        tab.wait("!state.busy && !state.changed")
        assert len(sayer.frames) > asked
        return sayer.frames[-1]

    nominal = slide("depth", "1")
    assert tab.truth()[0][2] == 1.0
    assert slide("light", "0.5").image.mean() < 0.6 * nominal.image.mean()
    slide("light", "1")
    assert not np.array_equal(slide("instance", "2").rest, nominal.rest)
    tab.page.click("button[type=reset]")
    tab.wait("!state.busy && !state.changed && state.last.truth[0][2] === 2")
    assert np.array_equal(sayer.frames[-1].rest, nominal.rest)


def test_a_refused_press_is_said_and_the_next_one_is_answered(tab: Tab) -> None:
    tab.page.locator("input[name=radius]").fill("2")
    tab.page.locator("input[name=depth]").fill("4")
    tab.until("press less deep", "#note")
    tab.page.locator("input[name=depth]").fill("1")
    tab.wait("document.querySelector('#note').innerText === ''")


def test_hostile_names_do_nothing(browser: Any) -> None:
    with WatchPage(HOSTILE, 12.8) as page:
        page.show(FrameView(np.zeros((8, 6), np.uint8), [], [AnswerView(None, 1.0)]))
        tab = Tab(browser, page.url)
        tab.until("no contact")
        assert tab.page.locator(".model b").inner_text() == HOSTILE
        assert tab.page.evaluate("window.broken") is None
        tab.context.close()


def test_a_camera_page_follows_and_says_when_it_is_over(browser: Any) -> None:
    with WatchPage("unet", 12.8) as page:
        tab = Tab(browser, page.url)
        for level in (10, 200):
            said = [AnswerView(Contacts.truth([[1.0, 2.0]], [level / 100]), 1.0)]
            page.show(FrameView(np.full((8, 8), level, np.uint8), [], said))
            tab.until(rf"\(\+1\.00, \+2\.00\) {level / 100:.2f} mm")
        assert tab.page.locator("#dome").is_hidden()
        assert tab.page.locator("#sliders").is_hidden()
        assert "mouse" not in tab.page.locator("#speed").inner_text()
    tab.until("The program has ended", "#note")
    tab.context.close()
