"""The page: chapters, figures, plan and environment in one file that asks no network for anything.

The same material gives the same bytes. A Content-Security-Policy names the two scripts by their
hashes, so that nothing else runs, whatever a name or note says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from tactibench import __version__
from tactibench.board.html.bundle import Bundle, missing, plotly_bundle, script_source
from tactibench.board.html.chapter import Chapter, chapter, measured_sections
from tactibench.board.html.drawn import Drawer
from tactibench.board.html.facts import Table, leaders, machines, plan, software
from tactibench.board.html.inert import script_json
from tactibench.board.html.material import Material
from tactibench.plugins.host import PluginHost
from tactibench.records.record import Record

POLICY = (
    "default-src 'none'; script-src '{}' '{}'; style-src 'unsafe-inline'; img-src data: blob:; "
    "base-uri 'none'; form-action 'none'"
)
"""Plotly writes style rules of its own; styles fetch nothing, because nothing may be fetched."""


def report_page(
    material: Material, cache: Path, *, advance: Callable[[str], None] = lambda _: None
) -> str:
    """The HTML of a report. cache: of frames. advance: is told what is being worked on.

    Raises UserError where a library of the extra ``report`` is missing.
    """
    template, bundle = _template(), plotly_bundle()
    host = PluginHost()
    sections = [(board, measured_sections(board)) for board in material.boards]
    chapters = []
    for board, found in sections:
        advance(board.name)
        chapters.append(chapter(board, found, Drawer(board.protocol, host, cache), cache))
    advance("page")
    records = [record for board in material.boards for record in board.records]
    script, style = (_asset(name) for name in ("page.js", "page.css"))
    figures = dict(_specs(chapters))
    html: str = template.render(
        origin=material.origin,
        version=__version__,
        chapters=chapters,
        style=style,
        script=script,
        policy=_policy(script, bundle),
        bundle=bundle,
        figures=script_json(figures),
        key=_figure_key,
        leaders=leaders(sections),
        plans=[plan(board) for board in material.boards],
        environment=_environment(records),
    )
    return html


def _environment(records: Sequence[Record]) -> list[Table]:
    return [machines(records), software(records)]


def _policy(script: str, bundle: Bundle) -> str:
    return POLICY.format(script_source(script.encode()), bundle.source)


def _specs(chapters: list[Chapter]) -> Iterator[tuple[str, Any]]:
    """What Plotly is given, by the place of every figure."""
    for one in chapters:
        for shown in one.sections:
            for p, panel in enumerate(shown.panels):
                for o, option in enumerate(panel.options):
                    for f, figure in enumerate(option.figures):
                        spec = {"data": figure.data, "layout": figure.layout}
                        yield _figure_key(shown.key, p, o, f), spec


def _figure_key(section: str, panel: int, option: int, figure: int) -> str:
    return f"{section}-{panel}-{option}-{figure}"


def _asset(name: str) -> str:
    return (files("tactibench.board.html") / "assets" / name).read_text(encoding="utf-8")


def _coded(text: str) -> Any:
    """Text whose `commands` stand in a fixed pitch; all of it is escaped first."""
    from markupsafe import Markup, escape

    parts = str(escape(text)).split("`")
    text = "".join(f"<code>{p}</code>" if k % 2 else p for k, p in enumerate(parts))
    return Markup(text)  # noqa: S704 - every part is escaped  # nosec B704


def _template() -> Any:
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError:
        raise missing("jinja2") from None
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["coded"] = _coded
    return environment.from_string(_asset("page.html.j2"))
