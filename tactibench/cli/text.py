"""Lines on the terminal that only show themselves, whoever wrote what is in them."""

from __future__ import annotations

import click

from tactibench.errors import printable


def echo(text: str, *, err: bool = False) -> None:
    """Print lines, control characters in them escaped."""
    click.echo(printable(text, keep="\n\t"), err=err)
