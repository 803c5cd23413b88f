"""Text on the terminal: lines that only show themselves, and exceptions as one sentence."""

from __future__ import annotations

import click

from tactibench.errors import UserError, is_full, printable


def echo(text: str, *, err: bool = False) -> None:
    """Print lines, control characters in them escaped."""
    click.echo(printable(text, keep="\n\t"), err=err)


def sentence(error: BaseException) -> str | None:
    """Return what went wrong and what to do, on one line that ends like a sentence.

    None: it is neither a mistake of the user's nor an exception of a plugin.
    """
    if isinstance(error, OSError):
        text = _about_files(error)
    elif isinstance(error, click.ClickException):
        text = error.format_message()
    elif isinstance(error, UserError):
        text = str(error)
    else:
        from tactibench.plugins import describe_failure

        return describe_failure(error)
    text = printable(" ".join(text.split()))
    if isinstance(error, click.UsageError) and error.ctx and not text.endswith(("?", ")")):
        text = f"{text.rstrip('.')}; see `{error.ctx.command_path} --help`."
    return text if text.endswith((".", "?", ")")) else f"{text}."


def _about_files(error: OSError) -> str:
    place = f" {error.filename}" if error.filename else ""
    if is_full(error):
        where = f" while writing{place}" if place else ""
        return (
            f"the disk is full{where}; free some space, or put the store elsewhere with --store "
            "and the cache with TACTIBENCH_CACHE, then run the same command again."
        )
    from tactibench.plugins import Owners

    what = error.strerror or str(error) or type(error).__name__
    at = Owners().place_of_error(error)
    source = "" if at is None else f" (plugin {at.origin} asked in {at})"
    return (
        f"the file system refused{place}{source}: {what}; check the path, its permissions and "
        "limits."
    )
