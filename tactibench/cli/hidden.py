"""``tactibench hidden``: publishing the hash of a secret seed of test presses."""

from __future__ import annotations

from pathlib import Path

import click

from tactibench.cli.options import board_option
from tactibench.errors import UserError


@click.group()
def hidden() -> None:
    """Hidden test presses: the hash of their seed is published beforehand, the seed never.

    \b
    export TACTIBENCH_HIDDEN_SEED=$(openssl rand -hex 32)
    tactibench hidden commit exp1
    tactibench run exp1 --model unet --hidden-seed
    """


@hidden.command()
@click.argument("protocol")
@board_option
def commit(protocol: str, board_folder: Path) -> None:
    """Write the hash of the seed in TACTIBENCH_HIDDEN_SEED for PROTOCOL. It is written once."""
    from tactibench.protocols.hidden_seed import (
        commitment_file,
        commitment_text,
        given_seed,
        read_commitment,
    )
    from tactibench.protocols.loader import load_protocol
    from tactibench.records.files import atomic

    loaded = load_protocol(protocol)
    if loaded.keys.split is None:
        raise UserError(
            f"protocol {loaded.keys.id!r} takes recorded presses, which no seed draws; take one "
            "that draws its presses."
        )
    seed = given_seed(loaded)
    path = commitment_file(loaded.keys.id, board_folder / "hidden")
    if path.exists():
        same = read_commitment(path) == seed.commitment
        if same:
            click.echo(f"{path} holds the hash of this seed already")
            return
        raise UserError(
            f"{path} holds the hash of another seed; a seed is exchanged by removing the file in "
            "a commit of its own, so that everybody sees it."
        )
    with atomic(path) as stream:
        stream.write(commitment_text(loaded, seed).encode())
    click.echo(f"wrote {path}: sha256 {seed.commitment}; commit it before the first run")
