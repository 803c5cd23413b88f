"""The page: one file, the same bytes every time, nothing in it but what the page allows itself."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser

import pytest
from report_material import HOSTILE

pytestmark = pytest.mark.long

LARGEST = 5_000_000
TAGS = """
html head meta title style body a header div h1 span p button nav main noscript section h2
h3 h4 h5 table thead tbody tr th td label input details summary select option figure img
sub br em code pre ul li footer script strong
"""


class Elements(HTMLParser):
    """Every element with its attributes; scripts with their text."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self._script: dict[str, str | None] | None = None

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        self._script = dict(attrs) if tag == "script" else None

    def handle_data(self, data):
        if self._script is not None:
            self.scripts.append((self._script, data))
            self._script = None


def elements(html: str) -> Elements:
    parser = Elements()
    parser.feed(html)
    parser.close()
    return parser


@pytest.fixture(scope="module")
def html(page_of, report_data):
    return page_of(report_data)


def test_it_is_small_and_the_same_every_time(html, page_of, report_data):
    assert len(html.encode()) < LARGEST
    assert html == page_of(report_data)


def test_nothing_is_fetched_and_only_one_script_may_run(html):
    found = elements(html)
    for tag, attributes in found.found:
        assert tag not in {"link", "iframe", "object", "embed", "base", "form"}
        assert not any(name.startswith("on") for name in attributes)
        for name in ("src", "href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:image/"))
    policy = next(
        a["content"] for t, a in found.found if a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    assert "'unsafe-inline'" not in policy.split(";")[1]
    ((_, script),) = found.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"'sha256-{digest}'" in policy


def test_every_figure_has_its_picture_a_text_for_who_cannot_see_it_and_a_choice(html):
    found = elements(html).found
    pictures = [attributes for tag, attributes in found if tag == "img"]
    assert len(pictures) >= 8
    assert all(a["src"].startswith("data:image/") and a["alt"] for a in pictures)
    for tag, attributes in found:
        if tag == "select":
            of = [a for _, a in found if a.get("data-of") == attributes["data-options"]]
            assert [a["data-option"] for a in of] == [str(k) for k in range(len(of))]
            assert ["hidden" in a for a in of] == [False] + [True] * (len(of) - 1)


def test_it_says_what_it_was_made_from_and_on_what(html):
    text = re.sub(r"<[^>]+>", " ", html)
    assert "Made from 6 runs stored in" in text
    for word in (
        "Speed against error",
        "Error against distance",
        "Seen as two",
        "Worst frames",
        "Predicted heatmap in relief",
        "Plan",
        "AMD EPYC",
        "Simulated sensor tactip-127",
        "Signature",
    ):
        assert word in text, word


def test_every_chapter_and_sensor_can_be_linked_to(html):
    ids = [a["id"] for _, a in elements(html).found if "id" in a]
    assert {"glance", "exp1", "exp2", "exp1-0", "plan", "environment"} <= set(ids)
    assert len(set(ids)) == len(ids)


def test_hostile_names_add_no_element(page_of, hostile):
    html = page_of(hostile)
    found = elements(html)
    assert {tag for tag, _ in found.found} <= set(TAGS.split())
    assert not any(name.startswith("on") for _, attributes in found.found for name in attributes)
    assert all((a.get("href") or "#").startswith("#") for _, a in found.found)
    assert html.count("</script>") == 1
    assert "{{7*7}}" in html


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_can_be_read(page_of, hostile, text):
    from html import unescape

    assert " ".join(text.split()) in unescape(page_of(hostile)).replace("\u2028", " ") or (
        text in unescape(page_of(hostile))
    )
