"""The report: its data, the newest and whole runs; its page, which allows itself one script."""

from __future__ import annotations

import base64
import hashlib
import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import pytest
from report_material import HOSTILE, contact_parts, store_of
from stored_answers import store_run

from tactibench import UserError
from tactibench.board import add
from tactibench.report import gather

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def store(tmp_path_factory, fabricate):
    folder = tmp_path_factory.mktemp("made") / "runs"
    store_of(folder, fabricate)
    return folder


def names(data):
    return {board.name: len(board.records) for board in data.boards}


def test_what_is_asked_is_what_is_shown(store):
    assert names(gather(store, None)) == {"exp1": 4, "exp2": 2}
    made = gather(None, ROOT / "leaderboards")
    shown = {board.protocol.spec.id for board in made.boards}
    assert shown >= {"exp1", "exp2", "exp3", "surface"}
    assert "committed records" in made.origin


def test_both_takes_the_newest_of_a_row_and_seed(store, tmp_path, fabricate):
    board = tmp_path / "leaderboards"
    old = contact_parts(seed=7)
    was = fabricate(created="2020-01-01T00:00:00+00:00", name="exp1-unet-old", error=0.9)
    add(store_run(tmp_path / "old", was, old), board)
    add(store_run(tmp_path / "old", fabricate(model="vgnn", encoder=None), old), board)
    made = gather(store, board)
    records = {r.name for b in made.boards if b.name == "exp1" for r in b.records}
    assert "exp1-unet-old" not in records
    assert len(records) == 5
    assert made.origin.startswith("Made from 1 committed record and 6 runs stored in ")
    assert names(gather(None, board)) == {"exp1": 2}


def test_partial_runs_are_counted_and_left_out(tmp_path, fabricate):
    parts = contact_parts()
    for partial in (True, False):
        record = fabricate(partial=partial, name=f"exp1-unet-{partial}")
        store_run(tmp_path / "runs", record, parts)
    made = gather(tmp_path / "runs", None)
    assert names(made) == {"exp1": 1}
    assert "Left out: 1 partial, other or older run." in made.origin


def test_a_damaged_run_is_named(tmp_path, fabricate):
    run = store_run(tmp_path / "runs", fabricate(), contact_parts())
    (run.folder / "predictions.npz").unlink()
    with pytest.raises(UserError, match=r"predictions\.npz does not exist"):
        gather(tmp_path / "runs", None)


@pytest.mark.parametrize(
    ("store", "board", "protocols", "sentence"),
    [
        ("runs", None, ("exp9",), "unknown protocol 'exp9'"),
        ("runs", None, (), "no complete run to show in .*runs; run a protocol"),
        ("runs", None, ("exp2",), "no complete run of exp2 to show in .*runs"),
        (None, "none", (), "there is no folder"),
    ],
)
def test_mistakes_get_a_sentence(tmp_path, store, board, protocols, sentence):
    places = [None if name is None else tmp_path / name for name in (store, board)]
    with pytest.raises(UserError, match=sentence):
        gather(*places, protocols=protocols)


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
    assert len(pictures) >= 5
    assert all(a["src"].startswith("data:image/") and a["alt"] for a in pictures)
    for tag, attributes in found:
        if tag == "select":
            of = [a for _, a in found if a.get("data-of") == attributes["data-options"]]
            assert [a["data-option"] for a in of] == [str(k) for k in range(len(of))]
            assert ["hidden" in a for a in of] == [False] + [True] * (len(of) - 1)


def test_it_says_what_it_was_made_from_and_on_what(html):
    text = re.sub(r"<[^>]+>", " ", html)
    assert "Made from 6 runs stored in" in text
    for word in ("Speed against error", "Error against distance", "Worst frames", "AMD EPYC"):
        assert word in text, word


def test_every_chapter_and_sensor_can_be_linked_to(html):
    ids = [a["id"] for _, a in elements(html).found if "id" in a]
    assert {"glance", "exp1", "exp2", "exp1-0"} <= set(ids)
    assert len(set(ids)) == len(ids)


def test_hostile_names_add_no_element_and_can_be_read(page_of, hostile):
    html = page_of(hostile)
    found = elements(html)
    assert {tag for tag, _ in found.found} <= set(TAGS.split())
    assert not any(name.startswith("on") for _, attributes in found.found for name in attributes)
    assert all((a.get("href") or "#").startswith("#") for _, a in found.found)
    assert html.count("</script>") == 1
    shown = unescape(html)
    for text in HOSTILE:
        assert text in shown or " ".join(text.split()) in shown.replace("\u2028", " ")


def test_one_file_is_written(cli, made_store, tmp_path):
    code, out, err = cli("report", "--store", made_store, "--protocol", "exp2")
    assert (code, err) == (0, "")
    assert out.startswith("Made from 2 runs stored in ")
    assert "wrote report.html (" in out
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["report.html"]
    assert b'id="exp1"' not in (tmp_path / "report.html").read_bytes()


def test_a_site_has_an_index_a_page_a_protocol_and_a_link_a_row(cli, made_store, tmp_path):
    code, out, err = cli("report", "--store", made_store, "--site", "public/boards")
    assert (code, err) == (0, "")
    folder = tmp_path / "public" / "boards"
    assert "index.html (3 pages, " in out
    assert {path.name for path in folder.iterdir()} >= {"index.html", "exp1.html", "exp2.html"}
    index = (folder / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([a-z0-9-]+\.html)#([a-z0-9-]+)"', index)
    assert links
    for file, anchor in links:
        assert f'<tr id="{anchor}">' in (folder / file).read_text(encoding="utf-8")
    assert 'id="exp2"' not in (folder / "exp1.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "page.html", "--site", "public"), "--out names one file and --site a folder"),
        (("--out", "page.pdf"), "page.pdf is no HTML file; call it page.html"),
        (("--store", "none"), "there is no run store in none"),
        (("--board", "none"), "there is no folder none; name another with"),
    ],
)
def test_mistakes_get_a_sentence_and_nothing_is_written(refused, tmp_path, arguments, words):
    assert words in refused("report", *arguments)
    assert not any(path.suffix == ".html" for path in tmp_path.rglob("*"))
