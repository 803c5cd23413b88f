"""``tactibench compare``: runs against each other, press by press."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.completion import RUN
from tactibench.cli.options import json_option, save_json, store_option


@click.command()
@click.argument("names", nargs=-1, required=True, metavar="RUN RUN [RUN...]", type=RUN)
@click.option("--distances", is_flag=True, help="Also at every true distance of the tips.")
@store_option
@json_option
def compare(names: tuple[str, ...], distances: bool, store: Path, json_file: Path | None) -> None:
    """Compare stored runs (names in the store, or folders) that answered the same test frames.

    Paired differences of every metric that is a mean over presses, with intervals over presses,
    permutation p, and Holm's adjustment over everything that is shown.

    \b
    tactibench compare exp2-superpose-single-s0-1a2b3c4d exp2-unet-single-s0-5e6f7a8b
    """
    from tactibench import api
    from tactibench.cli.output import Terminal
    from tactibench.report import print_comparisons

    compared = api.compare(*names, distances=distances, store=store)
    print_comparisons(Terminal().out, compared.runs, compared.pairs)
    save_json(json_file, compared.rows)
