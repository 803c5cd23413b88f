"""Search, reading and hashing of protocol files; secret seeds of their test presses.

The hash of a secret seed is published before the first run, the seed afterwards. Whoever holds the
seed draws test presses that nobody could train on or tune to. When it is revealed, everybody can
score the committed answers again, and can check that the seed was not chosen after they were seen.
A run takes the seed from the environment and writes it nowhere: records and identities hold its
hash, and the frames that are drawn from it are keyed by a hash.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError, did_you_mean, read_file
from tactibench.shipped import default_board, shipped_folder

if TYPE_CHECKING:
    from tactibench.protocols.schema import Protocol


VARIABLE = "TACTIBENCH_PROTOCOLS"
"""Environment variable: a folder of the user's own protocols, each in a file named by its id."""
READER = "e6a49ac9"
"""Commit whose code reads the records and protocols of other forms than the present one."""


@dataclass(frozen=True)
class LoadedProtocol:
    """A validated protocol with its file and content hash.

    Attributes:
        spec: The validated protocol.
        path: Its file.
        test_frames: Names in the file of test frames beside the protocol; () where it has none.
        hash: sha256 of the file, with line feeds at the end of every line, and of ``test_frames``.
    """

    spec: Protocol
    path: Path
    test_frames: tuple[str, ...]
    hash: str

    @property
    def label(self) -> str:
        """Name with version, as "exp1@1"."""
        return self.spec.label


def shipped_files() -> dict[str, Path]:
    """Return name -> file of every protocol that ships with tactibench."""
    return _files_in(shipped_folder("protocols"))


def protocol_files() -> dict[str, Path]:
    """Return name -> file of every protocol that ships, and of those in TACTIBENCH_PROTOCOLS.

    A file of the user's own cannot take the place of a protocol that ships.
    """
    folder = os.environ.get(VARIABLE, "")
    return (_files_in(Path(folder)) if folder else {}) | shipped_files()


def _files_in(folder: Path) -> dict[str, Path]:
    files = sorted(folder.glob("*.toml"))
    return {path.stem: path for path in files if "." not in path.stem}  # no exp1.board.toml


def version_of(name: str, content_hash: str) -> LoadedProtocol | None:
    """Return the protocol with this id and hash; None where there is none.

    Raises:
        UserError: Its file cannot be read or validated, see ``read_protocol``.
    """
    path = protocol_files().get(name)
    present = None if path is None else read_protocol(path)
    return present if present is not None and present.hash == content_hash else None


def recorded_version(label: str, content_hash: str, where: str) -> LoadedProtocol:
    """Return the protocol that a record answers.

    Args:
        label: Id and version that the record states, such as "exp1@2".
        content_hash: Hash that it states.
        where: Name of the record in messages.

    Raises:
        UserError: The protocol is not installed, or only in another version.
    """
    name, files = label.partition("@")[0], protocol_files()
    if name not in files:
        raise UserError(
            f"{where} answers protocol {name!r}, which is not installed; "
            f"{did_you_mean(name, files)} {VARIABLE} names a folder of others."
        )
    present = read_protocol(files[name])
    if (present.label, present.hash) != (label, content_hash):
        raise UserError(
            f"{where} answers {label} ({content_hash[:8]}), but the present one is "
            f"{present.label} ({present.hash[:8]}); run the protocol again (commit {READER} reads "
            "records of other versions)."
        )
    return present


def protocol_titles() -> dict[str, tuple[int, str]]:
    """Return name -> version and title of every protocol, not validated (for listings)."""
    titles = {}
    for name, path in protocol_files().items():
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        titles[name] = (int(tables["version"]), str(tables["title"]))
    return titles


def load_protocol(name: str) -> LoadedProtocol:
    """Load a shipped protocol by name, or any protocol by the path of its ``.toml`` file.

    A name is an id ("exp1", the present version) or a label ("exp1@1").

    Raises:
        UserError: The name is unknown, the file cannot be read, a key is wrong or missing, or a
            file of the user's own takes the id of a shipped protocol or has another name than its
            id.
    """
    files = protocol_files()
    own, _, version = name.partition("@")
    if own in files:
        present = _read_own(files[own])
        if version and present.label != name:
            raise UserError(
                f"there is no {name!r}; the present version is {present.label} (commit {READER} "
                "reads records of other versions)."
            )
        return present
    path = Path(name)
    if path.suffix != ".toml":
        hint = did_you_mean(name, files)
        more = "" if hint.endswith("?") else f" {VARIABLE} names a folder with your own protocols."
        raise UserError(f"unknown protocol {name!r}; {hint}{more}")
    return _read_own(path)


def _read_own(path: Path) -> LoadedProtocol:
    """Read a protocol file that need not be one that ships.

    Raises:
        UserError: The file cannot be read or validated, see ``read_protocol``. Or it has the id of
            a shipped protocol, but another content, so that its results would be taken for those of
            the shipped one. Or it lies in the folder of the user's protocols and has
            another name than its id.
    """
    loaded = read_protocol(path)
    name = loaded.spec.id
    shipped = shipped_files().get(name, path)
    if shipped != path and read_protocol(shipped).hash != loaded.hash:
        raise UserError(
            f"protocol file {path} has id = {name!r}, but is not the {name!r} that ships; give it "
            f"an id of its own, such as 'my-{name}', and a file of that name."
        )
    if path == protocol_files().get(path.stem) and path.stem != name:
        raise UserError(
            f"protocol file {path} has id = {name!r}; call it {name}.toml, so that it is found."
        )
    return loaded


def read_protocol(path: Path) -> LoadedProtocol:
    """Read and validate one protocol file.

    Raises:
        UserError: The file or its list of test frames cannot be read, the file is not TOML, or a
            key is wrong or missing.
    """
    from tactibench.protocols.schema import Protocol, parse_toml

    raw = read_file(path, "protocol file")
    spec = parse_toml(raw, Protocol, f"protocol file {path}")
    names = _test_frames(path, spec)
    digest = hashlib.sha256(raw.replace(b"\r\n", b"\n"))
    for name in names:
        digest.update(name.encode() + b"\n")
    return LoadedProtocol(spec, path, names, digest.hexdigest())


def _test_frames(path: Path, spec: Protocol) -> tuple[str, ...]:
    recorded: Any = spec.recorded
    if recorded is None or recorded.test_frames is None:
        return ()
    listed = path.parent / recorded.test_frames
    try:
        lines = [line.strip() for line in listed.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError) as error:
        raise UserError(
            f"protocol file {path}: key 'recorded.test_frames' names {listed}, which cannot be "
            f"read ({type(error).__name__}); put the list of names beside the protocol."
        ) from None
    return tuple(line for line in lines if line and not line.startswith("#"))


SEED_VARIABLE = "TACTIBENCH_HIDDEN_SEED"
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

    def redraw(self, spec: Protocol) -> Protocol:
        """Return a protocol whose presses, and unseen sensors of the make, this seed draws."""
        tests = tuple(
            test.model_copy(update={"instances": tuple(map(self._instance, test.instances))})
            for test in spec.test.apart
        )
        test = spec.test.model_copy(update={"apart": tests})
        return spec.model_copy(update={"data_seed": self.data_seed, "test": test})

    def _instance(self, public: int) -> int:
        """Return the number of the sensor that presses in place of a public instance.

        It is one of 10^9 - 10^6, the largest that a sensor may have, so that nobody can try all.
        """
        return 10**6 + int.from_bytes(self._derived(f"sensor {public}")) % (10**9 - 10**6)

    def _derived(self, purpose: str) -> bytes:
        text = f"tactibench hidden seed|{self.question}|{purpose}|".encode()
        return hashlib.sha256(text + self.secret.encode()).digest()


def given_seed(protocol: LoadedProtocol) -> HiddenSeed:
    """Return the hidden seed in the environment.

    Raises:
        UserError: The environment holds no seed, or one that is too short.
    """
    secret = os.environ.get(SEED_VARIABLE, "").strip()
    if not secret:
        raise UserError(
            f"a hidden seed is read from {SEED_VARIABLE}, which is not set; set it, or take the "
            "presses that everybody can draw."
        )
    if len(secret) < SHORTEST:
        raise UserError(
            f"the seed in {SEED_VARIABLE} has {len(secret)} characters and could be found by "
            f"trying; take {SHORTEST} or more, such as those of `openssl rand -hex 32`."
        )
    return _seed_of(protocol, secret)


def committed_seed(protocol: LoadedProtocol, folder: Path | None = None) -> HiddenSeed:
    """Return the hidden seed in the environment, with which a model may be tested.

    Args:
        protocol: The protocol that the seed belongs to.
        folder: Folder of the published hashes; None: that of the boards here, or those that ship.

    Raises:
        UserError: The environment holds no seed or one that is too short, its hash was not
            published or the file of it is damaged, or the seed was revealed.
    """
    seed = given_seed(protocol)
    path = commitment_file(protocol, seed.commitment, folder)
    published = _read_commitment(path)
    if published.get("sha256") != seed.commitment:
        raise UserError(
            f"no hash of the hidden seed in {SEED_VARIABLE} was published for {protocol.label} "
            f"in {path}; `tactibench board hidden {protocol.spec.id}` writes it, before the first "
            "run."
        )
    if "seed" in published:
        raise UserError(
            f"the hidden seed in {SEED_VARIABLE} was revealed in {path.name}, so that a model may "
            "have been trained on its presses; take a new one."
        )
    return seed


def recorded_seed(
    protocol: LoadedProtocol, commitment: str, folder: Path | None = None, own: Path | None = None
) -> HiddenSeed:
    """Return the hidden seed that a record names by its hash: the revealed one, or the given one.

    Args:
        protocol: The protocol that the record answers.
        commitment: Hash of the seed that the record states.
        folder: Folder of the published hashes; None: that of the boards here, or those that ship.
        own: Folder in which the seed may be revealed as well, such as that of a pull request. It
            has the hash that was published, so that it may be anybody's.

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
    revealed = {} if own is None else _read_commitment(own / path.name)
    secret = (revealed | published).get("seed")
    seed = given_seed(protocol) if secret is None else _seed_of(protocol, secret)
    if seed.commitment != commitment:
        place = SEED_VARIABLE if secret is None else path.name
        raise UserError(
            f"the hidden seed in {place} is not the one with the hash {commitment[:8]} of "
            f"{protocol.label}; give that one."
        )
    return seed


def commitment_file(protocol: LoadedProtocol, commitment: str, folder: Path | None = None) -> Path:
    """Return the file that publishes the hash of a hidden seed, and later the seed."""
    name = f"{protocol.spec.id}-{commitment[:8]}.toml"
    return (folder or default_board() / "hidden") / name


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
