"""``tactibench list``: names and summaries, without importing what stands behind them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from tactibench.plugins.host import PluginHost

KINDS = ("models", "sensors", "encoders", "protocols")


@click.command("list")
@click.argument("kind", type=click.Choice(KINDS), required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def listing(kind: str | None, as_json: bool) -> None:
    """List models, sensors, encoders and protocols."""
    from tactibench.plugins.host import PluginHost

    host = PluginHost()
    found = {name: _rows(host, name) for name in KINDS if kind in (None, name)}
    if as_json:
        click.echo(json.dumps(found, indent=1))
    else:
        _print(found)
    count = len(host.problems)
    if count:
        plural = "s" if count > 1 else ""
        click.echo(f"{count} plugin problem{plural}: run `tactibench doctor`.", err=True)


def _print(found: dict[str, list[dict[str, str]]]) -> None:
    for name, rows in found.items():
        width = max((len(row["name"]) for row in rows), default=0)
        click.echo(f"{name}:")
        for row in rows:
            click.echo(f"  {row['name']:<{width}}  {row['summary']}")


def _rows(host: PluginHost, kind: str) -> list[dict[str, str]]:
    if kind == "protocols":
        from tactibench.protocols.loader import protocol_titles

        return [
            {"name": name, "summary": title, "version": str(version)}
            for name, (version, title) in protocol_titles().items()
        ]
    catalogue = next(found for found in host.parts if f"{found.kind}s" == kind)
    return [
        {
            "name": spec.name,
            "summary": spec.summary,
            "plugin": catalogue.origins[spec.name].plugin,
            "distribution": catalogue.origins[spec.name].distribution,
        }
        for spec in catalogue
    ]
