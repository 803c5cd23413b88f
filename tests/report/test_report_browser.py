"""The page in headless Chromium, from a file: quiet, offline, sortable, on a phone, by key."""

from __future__ import annotations

import pytest
from browser import chromium

sync_api = pytest.importorskip("playwright.sync_api", reason="needs tactibench[browser]")
if chromium() is None:
    pytest.skip("no Chromium here; TACTIBENCH_CHROMIUM names one", allow_module_level=True)

READY = "html[data-ready]"
PATIENCE_MS = 120_000
CLIPPED = "[...document.querySelectorAll('.scroll')].filter(d => d.scrollWidth > d.clientWidth + 1)"


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        yield made
        made.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory, page_of, report_data):
    path = tmp_path_factory.mktemp("pages") / "plain.html"
    path.write_text(page_of(report_data), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def site(tmp_path_factory, report_data):
    from tactibench.report import site_pages

    folder = tmp_path_factory.mktemp("site")
    for name, text in site_pages(report_data):
        (folder / name).write_text(text, encoding="utf-8")
    return folder


class Tab:
    """A page with all that it complained about and asked for."""

    def __init__(self, browser, path, **more):
        self.context = browser.new_context(**more)
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", self._heard)
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector(f"{READY}, html[data-failed]", state="attached")
        assert self.page.get_attribute("html", "data-failed") is None

    def _heard(self, message):
        if message.type == "error":  # a browser without a graphics card warns of its own slowness
            self.said.append(message.text)

    def column(self, table, number):
        return [
            row.locator("td").nth(number).inner_text().split("\n")[0]
            for row in table.locator("tbody tr").all()
        ]


@pytest.fixture(scope="module")
def tab(browser, file):
    made = Tab(browser, file, viewport={"width": 1280, "height": 900})
    yield made
    made.context.close()


def test_every_picture_is_shown_without_a_word_or_a_request(tab):
    tab.page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    for choice in tab.page.locator("select[data-options]").all():
        options = choice.locator("option").count()
        name = choice.get_attribute("data-options")
        for number in range(options):
            choice.select_option(str(number))
            shown = tab.page.locator(f"figure[data-of='{name}']:visible")
            assert shown.count() == 1
            assert shown.get_attribute("data-option") == str(number)
    pictures = "[...document.querySelectorAll('.picture img')]"
    assert tab.page.evaluate(f"{pictures}.every(i => i.complete && i.naturalWidth > 100)")
    assert tab.said == []
    assert [url for url in tab.asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in tab.asked if url.startswith("file:")]) == 1


def test_a_head_sorts_by_click_and_by_key_numbers_as_numbers(tab):
    table = tab.page.locator("#exp1-0 .tables table.board").first
    heads = [head.inner_text() for head in table.locator("th").all()]
    number = next(k for k, head in enumerate(heads) if head.startswith("GOSPA"))
    before = tab.column(table, number)
    button = table.locator("th").nth(number).locator("button")
    button.click()
    assert tab.column(table, number) == sorted(before, key=float)
    assert table.locator("th").nth(number).get_attribute("aria-sort") == "ascending"
    button.focus()
    tab.page.keyboard.press("Enter")
    assert tab.column(table, number) == sorted(before, key=float, reverse=True)
    assert "sorted by" in tab.page.locator("#said").inner_text()
    tab.page.keyboard.press("Space")  # the third one restores the order of the ranks
    assert table.locator("th").nth(number).get_attribute("aria-sort") is None
    assert tab.column(table, number) == before


@pytest.mark.parametrize("width", [1280, 768, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_column_is_clipped_and_the_page_does_not_scroll_sideways(browser, file, width, scheme):
    size = {"width": width, "height": 800}
    tab = Tab(browser, file, viewport=size, color_scheme=scheme)
    tab.page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    tab.page.wait_for_function(f"{CLIPPED}.length === 0")  # folds tell that they opened a bit later
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
    tab.context.close()


def test_a_link_to_a_row_opens_what_hides_it(browser, site):
    index = Tab(browser, site / "index.html")
    link = index.page.locator("#glance td.who a").first
    name = link.get_attribute("href")
    file, anchor = name.split("#")
    link.click()
    index.page.wait_for_selector(READY, state="attached")
    row = index.page.locator(f"[id='{anchor}']")
    assert index.page.url.endswith(f"{file}#{anchor}")
    assert row.is_visible()
    assert "linked" in row.get_attribute("class")
    fold = index.page.locator(f"details.sensor:has([id='{anchor}'])")
    index.page.evaluate("location.hash = ''")
    fold.evaluate("fold => { fold.open = false; }")
    assert not row.is_visible()
    index.page.evaluate(f"location.hash = '{anchor}'")
    row.wait_for(state="visible")
    index.context.close()


def test_the_policy_stops_a_script_that_got_in(browser, file, tmp_path):
    html = file.read_text(encoding="utf-8")
    broken = tmp_path / "broken.html"
    inside = "<script>window.broken = 1</script><img src=x onerror='window.broken = 2'>"
    broken.write_text(html.replace("<main", f"{inside}<main"), encoding="utf-8")
    tab = Tab(browser, broken)
    assert tab.page.evaluate("window.broken") is None
    assert any("Content Security Policy" in text for text in tab.said)
    tab.context.close()
