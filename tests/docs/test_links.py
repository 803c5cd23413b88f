"""Every link in every page leads somewhere: files, and headings inside them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for path in [
        *ROOT.glob("*.md"),
        *(
            p
            for f in ("docs", "leaderboards", "protocols", "plugins")
            for p in (ROOT / f).rglob("*.md")
        ),
    ]
    if "node_modules" not in path.parts
)
LINK = re.compile(r"(?<!\\)!?\[(?:[^\]\\]|\\.)*\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
FENCE = re.compile(r"^(```|~~~).*?^\1\s*$", re.M | re.S)
CODE = re.compile(r"`[^`\n]*`")


@cache
def prose(path: Path) -> str:
    """A page without its code."""
    return FENCE.sub("", path.read_text(encoding="utf-8"))


def links(path: Path) -> Iterator[str]:
    return (match[1] for match in LINK.finditer(CODE.sub("", prose(path))))


def anchor(heading: str) -> str:
    """As GitHub makes it: lower case, without punctuation, blanks as hyphens."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")


@cache
def anchors(path: Path) -> frozenset[str]:
    found: list[str] = []
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", prose(path), re.M):
        name = anchor(heading)
        count = sum(
            one == name or re.fullmatch(rf"{re.escape(name)}-\d+", one) is not None for one in found
        )
        found.append(f"{name}-{count}" if count else name)
    return frozenset(found) | frozenset(re.findall(r'(?:id|name)="([^"]+)"', prose(path)))


def broken(path: Path) -> Iterator[str]:
    for link in links(path):
        if re.match(r"[a-z][a-z+.-]*:", link):  # https:, mailto:
            continue
        file, _, place = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists():
            yield f"{link}: there is no {file}"
        elif place and target.suffix == ".md" and place not in anchors(target):
            yield f"{link}: {target.name} has no heading #{place}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(path: Path) -> None:
    assert list(broken(path)) == []


def test_every_page_of_docs_is_reached_from_its_index() -> None:
    waiting, seen = [ROOT / "docs" / "index.md"], set[Path]()
    while waiting:
        page = waiting.pop()
        if page in seen or page.suffix != ".md" or not page.is_file():
            continue
        seen.add(page)
        files = (link.partition("#")[0] for link in links(page) if ":" not in link)
        waiting += [(page.parent / file).resolve() for file in files if file]
    assert {path for path in PAGES if ROOT / "docs" in path.parents} <= seen


def test_broken_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# One thing\n\n# `Two` & three\n\n# One thing\n")
    page = tmp_path / "page.md"
    page.write_text(
        "[a](other.md#one-thing) [b](other.md#two--three) [c](other.md#one-thing-1) [d](#here)\n"
        "# Here\n`[not](a-link.md)`\n```\n[nor](this.md)\n```\n[e](https://x.y/z)\n"
        "![f](gone.png) [g](other.md#four) [h](#there)\n"
    )
    assert [one.partition(":")[0] for one in broken(page)] == [
        "gone.png",
        "other.md#four",
        "#there",
    ]
