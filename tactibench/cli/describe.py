"""``tactibench describe``: everything a spec or a protocol states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.text import echo
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from tactibench.protocols import Axis, Draw


@click.command()
@click.argument("name")
def describe(name: str) -> None:
    """Show the details of a model, sensor, encoder or protocol called NAME."""
    from tactibench.plugins import PluginHost
    from tactibench.protocols import protocol_files

    host = PluginHost()
    files = protocol_files()
    known = [*files, *(spec.name for catalogue in host.catalogues for spec in catalogue)]
    shown = 0
    for catalogue in host.catalogues:
        if name in catalogue:
            _show_spec(catalogue.kind, catalogue[name], catalogue.origins[name])
            shown += 1
    if name in files or name.endswith(".toml") or name.partition("@")[0] in files:
        _show_protocol(name)
        shown += 1
    if not shown:
        raise UserError(f"nothing is called {name!r}; {did_you_mean(name, known)}")


def _show_spec(kind: str, spec: Any, origin: Any) -> None:
    echo(f"{kind} {spec.name}: {spec.summary}")
    echo(f"  from      plugin {origin}")
    echo(f"  class     {spec.target}")
    for field, label in (
        ("answers", "answers"),
        ("reads", "reads"),
        ("max_contacts", "contacts"),
        ("kind", "kind"),
        ("uses_encoder", "encoder"),
        ("origin", "origin"),
        ("needs_data", "--data"),
    ):
        if hasattr(spec, field):
            echo(f"  {label:<9} {_describe_field(field, spec)}")
    for p in spec.parameters:
        allowed = f" ({', '.join(map(str, p.choices))})" if p.choices else _range(p)
        echo(f"  --param {kind}.{p.name}={p.default}{allowed}")
        echo(f"            {p.help}")
    for version, values in getattr(spec, "versions", {}).items():
        own = " ".join(f"{name}={value}" for name, value in values.items())
        echo(f"  by default, with version={version}: {own}")


def _describe_field(field: str, spec: Any) -> str:
    value = getattr(spec, field)
    if field == "max_contacts":
        return "any number" if value is None else f"at most {value}"
    if field == "uses_encoder" and value:
        default = f", by default {spec.default_encoder}" if spec.default_encoder else ""
        return f"of kind {' or '.join(spec.encoders)}{default}"
    if isinstance(value, tuple):
        return ", ".join(value)
    return {True: "yes", False: "no"}.get(value, str(value))


def _range(parameter: Any) -> str:
    low, high = parameter.low, parameter.high
    if low is None and high is None:
        return ""
    return f" ({'' if low is None else low}..{'' if high is None else high})"


def _show_protocol(name: str) -> None:
    from tactibench.protocols import load_protocol

    protocol = load_protocol(name)
    spec = protocol.spec
    echo(f"protocol {protocol.label}: {spec.title}")
    echo(f"  hash      {protocol.hash}")
    echo(f"  asks for  {spec.answer}")
    for draw in spec.draws:
        count = draw.count or (draw.per_distance or 0) * len(draw.distances_mm)
        echo(f"  draw      {draw.name}: {count:,} {_kind(draw)} presses")
    for regime, extra in spec.regimes.items():
        echo(f"  regime    {regime}: {' + '.join(['the training share', *extra])}")
    for axis in spec.axes:
        echo(f"  {_family(axis)}")
    echo(f"  tested on {', '.join(spec.test.sets)}; gate {spec.test.gate_mm} mm")
    for apart in spec.test.apart:
        on = f" on instances {', '.join(map(str, apart.instances))}" if apart.instances else ""
        echo(f"  apart     {apart.name}: {', '.join(apart.sets)}{on}")
    echo(f"  metrics   {', '.join(spec.metrics.names)}")
    echo(f"  published {', '.join(spec.published.tables) or 'none'}")


def _kind(draw: Draw) -> str:
    several = draw.offsets_mm or draw.tip_count
    return f"{draw.tips}-tip" if several else draw.indenter


def _family(axis: Axis) -> str:
    """Return ``family    grazing: depth of a shallow contact, mm: easy 2; 0.5, 0.3``."""
    unit = f", {axis.unit}" if axis.unit else ""
    easy = "" if axis.easy is None else f"easy {axis.easy:g}; "
    return (
        f"family    {axis.family}: {axis.title}{unit}: {easy}"
        f"{', '.join(f'{value:g}' for value in axis.values)}"
    )
