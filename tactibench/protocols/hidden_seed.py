"""A secret seed of test presses; only its hash is published, before the first run.

Whoever holds the seed draws test presses that nobody could train on or tune to. Everybody else can
check later, when the seed is revealed, that it was not chosen after the answers were seen. The seed
comes from the environment and is never written: records and identities hold its hash, and the
frames that are drawn from it are keyed by a hash.
"""

from __future__ import annotations

import hashlib
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
    """

    question: str
    _secret: bytes = field(repr=False)

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
        return hashlib.sha256(text + self._secret).digest()


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
    return HiddenSeed(f"{protocol.label} {protocol.hash}", secret.encode())


def committed_seed(protocol: LoadedProtocol, folder: Path | None = None) -> HiddenSeed:
    """Return the hidden seed in the environment, if its hash is the published one.

    Args:
        protocol: The protocol that the seed belongs to.
        folder: Folder of the published hashes; None: those that ship with tactibench.

    Raises:
        UserError: The environment holds no seed or one that is too short, no hash was published or
            its file is damaged, or the seed has another hash.
    """
    seed = given_seed(protocol)
    path = commitment_file(protocol.spec.id, folder)
    published = read_commitment(path)
    if published != seed.commitment:
        raise UserError(
            f"the seed in {VARIABLE} is not the one whose hash was published for "
            f"{protocol.label} in {path.name}; give that one."
        )
    return seed


def commitment_file(protocol: str, folder: Path | None = None) -> Path:
    """Return the file that publishes the hash of a protocol's hidden seed."""
    return (folder or shipped_folder("hidden")) / f"{protocol}.toml"


def read_commitment(path: Path) -> str:
    """Return the published hash.

    Raises:
        UserError: The file does not exist, is not TOML, or has no text with the key ``sha256``.
    """
    try:
        committed = tomllib.loads(path.read_text(encoding="utf-8")).get("sha256")
    except FileNotFoundError:
        raise UserError(
            f"no hash of a hidden seed was published for protocol {path.stem!r} ({path} is not "
            "there); `tactibench board hidden` writes it, before the first run."
        ) from None
    except (OSError, ValueError) as error:
        raise UserError(f"{path} is no TOML file with a key sha256 ({error}).") from None
    if not isinstance(committed, str):
        raise UserError(f"{path}: key 'sha256' must be the hash of a hidden seed.")
    return committed


def commitment_text(protocol: LoadedProtocol, seed: HiddenSeed) -> str:
    """Return the text of the file that publishes the hash of a seed."""
    return (
        f"# Hash of the hidden seed of {protocol.label}; the seed itself is told to scorers only.\n"
        f'protocol = "{protocol.spec.id}"\n'
        f"version = {protocol.spec.version}\n"
        f'protocol_hash = "{protocol.hash}"\n'
        f'sha256 = "{seed.commitment}"\n'
    )
