"""``tactibench list`` and ``describe``: what is installed and stored, and all that it states."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import OneOf, echo, json_option, save_json, store_option
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from tactibench.plugins import PluginHost
    from tactibench.protocols import Axis, Draw

PLUGINS = ("models", "sensors", "encoders", "protocols")
KINDS = (*PLUGINS, "runs", "weights")
MIB = 2**20

Row = dict[str, Any]


@click.command("list")
@click.argument("kind", type=OneOf(KINDS), required=False)
@json_option
@store_option
def listing(kind: str | None, json_file: Path | None, store: Path) -> None:
    """List plugins and protocols, or what is stored.

    models, sensors, encoders and protocols are listed by default; runs are those of --store,
    weights those in the cache.
    """
    if kind == "runs":
        rows: Any = _list_runs(store)
    elif kind == "weights":
        rows = _list_weights()
    else:
        rows = _list_plugins((kind,) if kind else PLUGINS)
    save_json(json_file, rows)


def _list_plugins(kinds: tuple[str, ...]) -> dict[str, list[Row]]:
    """Print names and summaries without importing what stands behind them."""
    from tactibench.plugins import PluginHost

    host = PluginHost()
    rows = {kind: _plugin_rows(host, kind) for kind in kinds}
    for kind, listed in rows.items():
        width = max((len(row["name"]) for row in listed), default=0)
        echo(f"{kind}:")
        for row in listed:
            echo(f"  {row['name']:<{width}}  {row['summary']}")
    if host.problems:
        echo(f"plugin problems: {len(host.problems)}; run `tactibench doctor`.", err=True)
    return rows


def _plugin_rows(host: PluginHost, kind: str) -> list[Row]:
    if kind == "protocols":
        from tactibench.protocols import protocol_titles

        return [
            {"name": name, "summary": title, "version": str(version)}
            for name, (version, title) in protocol_titles().items()
        ]
    catalogue = host.catalogue(kind.removesuffix("s"))
    return [
        {
            "name": spec.name,
            "summary": spec.summary,
            "plugin": catalogue.origins[spec.name].plugin,
            "distribution": catalogue.origins[spec.name].distribution,
        }
        for spec in catalogue
    ]


def _list_runs(store: Path) -> list[Row]:
    from tactibench.records import stored_runs

    rows = [
        {
            "name": run.folder.name,
            "protocol": run.record.protocol.id,
            "model": run.record.model.name,
            "seed": run.record.seed,
            "created": run.record.created,
            "partial": run.record.partial,
        }
        for run in stored_runs(store)
    ]
    _print(rows, f"no runs in {store}; `tactibench run` leaves its own there")
    return rows


def _list_weights() -> list[Row]:
    from tactibench.plugins import PluginHost
    from tactibench.records import cache_folder
    from tactibench.report import duration, number
    from tactibench.run import cached_weights

    host = PluginHost()
    rows: list[Row] = [
        {**row, "label": _weights_label(row["model"], row["parameters"], host)}
        for row in cached_weights(cache_folder())
    ]
    columns = ["encoder", "regime", "presses", "seed", "device", "epochs"]
    shown = [
        {
            "model": row["label"],
            **{name: row[name] for name in columns},
            "training": duration(row["training_s"]),
            "MiB": number(row["bytes"] / MIB, 1),
            "folder": row["folder"],
        }
        for row in rows
    ]
    _print(shown, f"no trained weights in {cache_folder()}; a run leaves its own there")
    return rows


def _weights_label(model: str, parameters: Mapping[str, Any], host: PluginHost) -> str:
    """Return the model with the parameters that are not at their defaults, as far as known."""
    from tactibench.records import Component

    spec = host.models.specs.get(model)
    defaults = spec.defaults(parameters) if spec else {}
    other = [name for name, value in parameters.items() if defaults.get(name) != value]
    return Component(name=model, parameters=dict(parameters), settings=other).label


def _print(rows: list[Row], empty: str) -> None:
    """Print rows as a table; without rows, say where they would come from."""
    from tactibench.cli.output import Terminal
    from tactibench.report import print_table, table

    if rows:
        cells = [[_text(value) for value in row.values()] for row in rows]
        print_table(Terminal().out, table(rows[0], cells))
    else:
        echo(empty)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:,}" if isinstance(value, int) else str("n/a" if value is None else value)


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
        ("deterministic", "training"),
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
    if field == "deterministic":
        return "draws no random numbers" if value else "draws random numbers"
    if field == "uses_encoder" and value:
        default = f", by default {spec.default_encoder}" if spec.default_encoder else ""
        return f"of kind {' or '.join(spec.encoders)}{default}"
    if isinstance(value, tuple):
        return ", ".join(value)
    return {True: "yes", False: "no"}.get(value, str(value))


def _range(parameter: Any) -> str:
    low, high = ("" if end is None else end for end in (parameter.low, parameter.high))
    return f" ({low}..{high})" if (low, high) != ("", "") else ""


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
        learns = " + ".join(["the training share", *extra])
        if spec.sites is not None:
            most = spec.sites.most.get(regime)
            learns = f"trials with at most {most} touched" if most else "all but the tested fold"
        echo(f"  regime    {regime}: {learns}")
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
