"""docs/reference/cli.md: every verb and option, from click."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint
from pathlib import Path

import click

from reference.text import anchor, cell, code, fenced, grid, prose
from tactibench.cli.main import INTERRUPTED, MISTAKE, VERBS, main
from tactibench.errors import UserError
from tactibench.plugins import GROUP, Origin, PluginHost

PROGRAM = "tactibench"


def lines(root: Path) -> list[str]:
    """Return the lines of the page.

    Raises:
        UserError: A plugin of this repository or one of its commands does not load.
    """
    verbs = commands(root)
    page = [
        "# Commands",
        "",
        f"`{PROGRAM} VERB`. Exit code 0; 1 where a verb says so; {MISTAKE} "
        f"after one sentence about a mistake; {INTERRUPTED} when interrupted, and the same "
        "command continues. Results go to stdout, progress and mistakes to stderr. `--debug` "
        "shows the traceback of a mistake.",
        "",
    ]
    rows = [
        [f"[`{name}`](#{anchor(f'{PROGRAM} {name}')})", cell(summary)]
        for name, (_, summary) in verbs.items()
    ]
    page += grid(["verb", "what"], rows)
    page += _options([main])
    for name, (command, _) in verbs.items():
        page += _section(f"{PROGRAM} {name}", command, level=2)
    return page


def commands(root: Path) -> dict[str, tuple[click.Command, str]]:
    """Return verb -> command and summary, of the core and of the plugins that ship with it.

    Verbs are in order of their names. Other installed plugins are left out, so that the page is the
    same on every machine.

    Raises:
        UserError: A plugin of this repository or one of its commands does not load.
    """
    verbs = {name: (_verb(main, name), summary) for name, (_, summary) in VERBS.items()}
    host = shipped_plugins(root)
    for problem in host.problems:
        raise UserError(f"plugin {problem.origin.plugin!r}: {problem.message}; mend it first.")
    for spec in host.commands:
        verbs[spec.name] = spec.load(), spec.summary
    return dict(sorted(verbs.items()))


def _verb(group: click.Group, name: str) -> click.Command:
    """Return a command of a group, which may import it now.

    Raises:
        UserError: The import of the command fails, or the group does not have it.
    """
    try:
        command = group.get_command(click.Context(group), name)
    except ImportError as error:
        raise UserError(f"verb {name!r} does not load ({error}); mend it first.") from error
    if command is None:
        raise UserError(f"verb {name!r} is listed, but there is none; mend its group first.")
    return command


def shipped_plugins(root: Path) -> PluginHost:
    """Return a host of the entry points in pyproject.toml, whatever is installed."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    points: Mapping[str, str] = project["entry-points"][GROUP]
    origins = [
        (EntryPoint(name, target, GROUP), Origin(name, project["name"], "0"))
        for name, target in points.items()
    ]
    return PluginHost(origins)


def _section(path: str, command: click.Command, level: int) -> Iterator[str]:
    yield from [f"{'#' * level} {path}", "", *fenced(_usage(path, command), "text")]
    yield from [*prose(command.help), ""]
    yield from _options([command])
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            yield from _section(f"{path} {name}", _verb(command, name), min(level + 1, 4))


def _usage(path: str, command: click.Command) -> str:
    words = [path]
    if any(isinstance(p, click.Option) for p in command.params):
        words.append("[OPTIONS]")
    for argument in command.params:
        if isinstance(argument, click.Argument):
            name = argument.metavar or (argument.name or "").upper()
            name = name if argument.required else f"[{name}]"
            words.append(f"{name}..." if argument.nargs == -1 else name)
    if isinstance(command, click.Group):
        words.append("VERB ...")
    return " ".join(words)


def _options(of: list[click.Command]) -> list[str]:
    options = [p for c in of for p in c.params if isinstance(p, click.Option) and not p.hidden]
    rows = [[_names(option), cell(_help(option))] for option in options]
    return grid(["option", "what"], rows) if rows else []


def _names(option: click.Option) -> str:
    """Return the names of an option with its value; "..." where it may be given several times."""
    value = "" if option.is_flag or option.count else f" {_value(option)}"
    off = f"/{'/'.join(option.secondary_opts)}" if option.secondary_opts else ""
    return code(f"{', '.join(option.opts)}{off}{value}{' ...' * option.multiple}")


def _value(option: click.Option) -> str:
    if option.metavar:
        return option.metavar
    kind = option.type
    if isinstance(kind, click.Choice):
        return "|".join(map(str, kind.choices))
    if isinstance(kind, click.Path):
        return "FOLDER" if not kind.file_okay else "FILE" if not kind.dir_okay else "PATH"
    return kind.name.split()[0].upper()


def _help(option: click.Option) -> str:
    """Return the help, the range of a number, and the default where it is a plain value."""
    sentences = [option.help or ""]
    kind = option.type
    if isinstance(kind, click.IntRange | click.FloatRange):
        low, high = ("" if end is None else f"{end:g}" for end in (kind.min, kind.max))
        sentences.append(f"{low}..{high}." if low and high else f"At least {low}." if low else "")
    default = option.default
    if isinstance(default, str | int | float | Path) and default not in ("", False, True):
        sentences.append(f"Default: `{default}`.")
    if option.required:
        sentences.append("Required.")
    return " ".join(filter(None, sentences))
