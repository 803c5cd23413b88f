#!/usr/bin/env python
"""Write docs/reference from the code.

    python scripts/make_reference.py            # writes the pages that differ
    python scripts/make_reference.py --check    # exit code 1 when a page is not what the code gives

Neither torch nor OpenCV is imported: hooks, commands, schemas and metrics are light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import click
from reference import (
    api_page,
    commands_page,
    helpers_page,
    hooks_page,
    metrics_page,
    schemas_page,
)
from reference.text import single_spaced

from tactibench.errors import UserError
from tactibench.records import atomic

ROOT = Path(__file__).resolve().parents[1]
COMMAND = "python scripts/make_reference.py"
NOTE = f"<!-- Made by `{COMMAND}`; do not edit. -->"
PAGES: Mapping[str, Callable[[Path], list[str]]] = {
    "api.md": api_page.lines,
    "cli.md": commands_page.lines,
    "helpers.md": helpers_page.lines,
    "hooks.md": hooks_page.lines,
    "metrics.md": metrics_page.lines,
    "schemas.md": schemas_page.lines,
}


def text_of(name: str, root: Path = ROOT) -> str:
    """Return the text of a page as the code gives it.

    Args:
        name: Name of the page's file.
        root: Root of the repository.

    Raises:
        UserError: A key, hook, metric or optional method has no description, keys.toml describes
            something that is gone, or a plugin of this repository does not load.
    """
    title, *rest = PAGES[name](root)
    return "\n".join(single_spaced([title, "", NOTE, *rest])) + "\n"


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when a page is out of date.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=ROOT / "docs" / "reference",
    help="Folder of the pages. [default: docs/reference]",
)
@click.pass_context
def main(ctx: click.Context, check: bool, out: Path) -> None:
    """Write the pages of docs/reference from the code."""
    try:
        wanted = {out / name: text_of(name) for name in PAGES}
    except UserError as error:
        raise click.ClickException(str(error)) from None
    stale = [path for path, text in wanted.items() if _found(path) != text]
    for path in stale:
        if check:
            click.echo(f"{path.name} is not what the code gives; run `{COMMAND}`.", err=True)
        else:
            with atomic(path) as stream:
                stream.write(wanted[path].encode())
            click.echo(f"{path.name}: written")
    if check and stale:
        ctx.exit(1)
    if not stale:
        click.echo(f"{len(wanted)} pages are what the code gives")


def _found(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


if __name__ == "__main__":
    main()
