"""mkdocs hook: pages outside docs/ become part of the site, with links that hold.

The mark ``<!-- metrics -->`` becomes a table of all metrics.
"""

from __future__ import annotations

import html
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from tactibench.metrics import all_metrics

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = (
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "LICENSE",
    "CITATION.cff",
    "leaderboards/*.md",
    "leaderboards/hidden/*.md",
    "protocols/*.md",
)
FOLDER = "repository"
"""Folder of these pages in the site: at its top, `README.md` would be the site's index."""
_LINK = re.compile(r"(\]\()([^)\s#:]*)(#[^)\s]*)?(?=\))")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages outside docs/."""
    for pattern in OUTSIDE:
        for path in sorted(ROOT.glob(pattern)):
            name = f"{FOLDER}/{path.relative_to(ROOT).as_posix()}"
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:  # noqa: ARG001
    """Point links that leave or enter docs/ to the place of their page in the site."""
    markdown = markdown.replace("<!-- metrics -->", _metrics())
    source = Path(str(page.file.abs_src_path)).resolve()
    folder = posixpath.dirname(page.file.src_uri) or "."

    def moved(match: re.Match[str]) -> str:
        before, link, place = match[1], match[2], match[3] or ""
        if not link:
            return match[0]
        target = (source.parent / link).resolve()
        found = _site_name(target)
        return match[0] if found is None else f"{before}{_relative(found, folder)}{place}"

    return _LINK.sub(moved, markdown)


def _metrics() -> str:
    """Return a Markdown table of all metrics."""
    rows = [
        f"| `{spec.name}` | {spec.unit or '1'} | {spec.better} | {_cell(spec.formula)} |"
        for spec in all_metrics().values()
    ]
    return "\n".join(["| metric | unit | better | formula |", "|---|---|---|---|", *rows])


def _cell(text: str) -> str:
    """Return text that is shown as it is in a cell of a table."""
    return html.escape(text).replace("|", "&#124;").replace("*", "&#42;").replace("_", "&#95;")


def _site_name(target: Path) -> str | None:
    """Return the name in the site of a file of the repository, None outside of the repository.

    A folder stands for its README, if it has one.
    """
    docs = ROOT / "docs"
    if target.is_relative_to(docs):
        return target.relative_to(docs).as_posix()
    if target.is_dir() and (target / "README.md").is_file():
        target /= "README.md"
    if not target.is_relative_to(ROOT):
        return None
    return f"{FOLDER}/{target.relative_to(ROOT).as_posix()}"


def _relative(name: str, here: str) -> str:
    return posixpath.relpath(name, here)
