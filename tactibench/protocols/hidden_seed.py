"""A secret seed of test presses: its hash is published before the first run, the seed afterwards.

Whoever holds the seed draws test presses that nobody could train on or tune to. When it is
revealed, everybody can score the committed answers again, and can check that the seed was not
chosen after they were seen. A run takes the seed from the environment and writes it nowhere:
records and identities hold its hash, and the frames that are drawn from it are keyed by a hash.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tactibench.errors import UserError
from tactibench.shipped import shipped_folder

if TYPE_CHECKING:
    from tactibench.protocols.loader import LoadedProtocol

VARIABLE = "TACTIBENCH_HIDDEN_SEED"
SHORTEST = 32
"""Least characters of a seed: 128 bits as hexadecimal digits, which nobody finds by trying."""


@dataclass(frozen=True)
class HiddenSeed:
    """The seed of one version of one protocol.

    Attributes:
        question: Label and hash of the protocol.
        secret: Text of the seed.
    """

    question: str
    secret: str = field(repr=False)

    @property
    def commitment(self) -> str:
        """sha256 that is published before the first run; it tells nothing about the presses."""
        return self._derived("commitment").hex()

    @property
    def data_seed(self) -> int:
        """Seed that test presses are drawn from, in place of the protocol's ``data_seed``."""
        return int.from_bytes(self._derived("presses"))

    def _derived(self, purpose: str) -> bytes:
        text = f"tactibench hidden seed|{self.question}|{purpose}|".encode()
        return hashlib.sha256(text + self.secret.encode()).digest()


def given_seed(protocol: LoadedProtocol) -> HiddenSeed:
    """Return the hidden seed in the environment.

    Raises:
        UserError: The environment holds no seed, or one that is too short.
    """
    secret = os.environ.get(VARIABLE, "").strip()
    if not secret:
        raise UserError(
            f"a hidden seed is read from {VARIABLE}, which is not set; set it, or leave the option "
            "out to take the presses that everybody can draw."
        )
    if len(secret) < SHORTEST:
        raise UserError(
            f"the seed in {VARIABLE} has {len(secret)} characters and could be found by trying; "
            f"take {SHORTEST} or more, such as those of `openssl rand -hex 32`."
        )
    return _seed_of(protocol, secret)


def committed_seed(protocol: LoadedProtocol, folder: Path | None = None) -> HiddenSeed:
    """Return the hidden seed in the environment, with which a model may be tested.

    Args:
        protocol: The protocol that the seed belongs to.
        folder: Folder of the published hashes; None: those that ship with tactibench.

    Raises:
        UserError: The environment holds no seed or one that is too short, its hash was not
            published or the file of it is damaged, or the seed was revealed.
    """
    seed = given_seed(protocol)
    path = commitment_file(protocol, seed.commitment, folder)
    published = _read_commitment(path)
    if published.get("sha256") != seed.commitment:
        raise UserError(
            f"no hash of the hidden seed in {VARIABLE} was published for {protocol.label} in "
            f"{path}; `tactibench board hidden {protocol.spec.id}` writes it, before the first run."
        )
    if "seed" in published:
        raise UserError(
            f"the hidden seed in {VARIABLE} was revealed in {path.name}, so that a model may have "
            "been trained on its presses; take a new one."
        )
    return seed


def recorded_seed(
    protocol: LoadedProtocol, commitment: str, folder: Path | None = None
) -> HiddenSeed:
    """Return the hidden seed that a record names by its hash: the revealed one, or the given one.

    Args:
        protocol: The protocol that the record answers.
        commitment: Hash of the seed that the record states.
        folder: Folder of the published hashes; None: those that ship with tactibench.

    Raises:
        UserError: The hash was not published or its file is damaged, or the seed is neither
            revealed nor in the environment.
    """
    path = commitment_file(protocol, commitment, folder)
    published = _read_commitment(path)
    if published.get("sha256") != commitment:
        raise UserError(
            f"no hash {commitment[:8]!r} of a hidden seed was published for {protocol.label}; only "
            "runs on published ones are verified."
        )
    secret = published.get("seed")
    if secret is None and not os.environ.get(VARIABLE):
        raise UserError(
            f"the hidden seed with the hash {commitment[:8]} of {protocol.label} is not revealed; "
            f"only who has it can verify its runs, and gives it in {VARIABLE}."
        )
    seed = given_seed(protocol) if secret is None else _seed_of(protocol, secret)
    if seed.commitment != commitment:
        place = VARIABLE if secret is None else path.name
        raise UserError(
            f"the hidden seed in {place} is not the one with the hash {commitment[:8]} of "
            f"{protocol.label}; give that one."
        )
    return seed


def commitment_file(protocol: LoadedProtocol, commitment: str, folder: Path | None = None) -> Path:
    """Return the file that publishes the hash of a hidden seed, and later the seed."""
    name = f"{protocol.spec.id}-{commitment[:8]}.toml"
    return (folder or shipped_folder("hidden")) / name


def commitment_text(protocol: LoadedProtocol, seed: HiddenSeed, *, reveal: bool = False) -> str:
    """Return the text of the file that publishes a seed: its hash, or also itself."""
    told = "everybody can draw its presses" if reveal else "the seed itself is told to scorers only"
    # JSON writes text as TOML reads it.
    secret = f"seed = {json.dumps(seed.secret, ensure_ascii=False)}\n" if reveal else ""
    return (
        f"# Hash of a hidden seed of {protocol.label}; {told}.\n"
        f'protocol = "{protocol.spec.id}"\n'
        f"version = {protocol.spec.version}\n"
        f'protocol_hash = "{protocol.hash}"\n'
        f'sha256 = "{seed.commitment}"\n{secret}'
    )


def _read_commitment(path: Path) -> dict[str, str]:
    """Return the texts of a file of ``commitment_text``; nothing where there is no such file."""
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise UserError(f"{path} is no TOML file of a hidden seed ({error}).") from None
    return {key: value for key, value in values.items() if isinstance(value, str)}


def _seed_of(protocol: LoadedProtocol, secret: str) -> HiddenSeed:
    return HiddenSeed(f"{protocol.label} {protocol.hash}", secret)
