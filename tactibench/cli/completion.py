"""Completion of names in bash, zsh and fish, by click's own mechanism."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import click
from click.shell_completion import CompletionItem

Names = Callable[[click.Context], Iterable[str]]


class Name(click.types.StringParamType):
    """A name that a shell may complete; whether it exists is asked where it is used."""

    def __init__(self, names: Names) -> None:
        self._names = names

    def shell_complete(
        self, ctx: click.Context, _param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin with what was typed."""
        return [CompletionItem(name) for name in self._names(ctx) if name.startswith(incomplete)]


def _plugins(kind: str) -> Names:
    def names(_ctx: click.Context) -> Iterable[str]:
        from tactibench.plugins import PluginHost

        return sorted(getattr(PluginHost(), kind).specs)

    return names


def _protocols(_ctx: click.Context) -> Iterable[str]:
    from tactibench.protocols import protocol_files

    return sorted(protocol_files())


def _runs(ctx: click.Context) -> Iterable[str]:
    from tactibench.records import run_names

    store = Path(ctx.params.get("store") or "runs")
    return sorted(run_names(store)) if store.is_dir() else ()


MODEL = Name(_plugins("models"))
SENSOR = Name(_plugins("sensors"))
ENCODER = Name(_plugins("encoders"))
PROTOCOL = Name(_protocols)
RUN = Name(_runs)
