"""Finding, reading and hashing protocol files."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError, did_you_mean
from tactibench.shipped import shipped_folder

if TYPE_CHECKING:
    from tactibench.protocols.schema import Protocol


@dataclass(frozen=True)
class LoadedProtocol:
    """A validated protocol with its file and content hash."""

    keys: Protocol
    path: Path
    hash: str

    @property
    def label(self) -> str:
        return f"{self.keys.id}@{self.keys.version}"

    def test_frame_names(self) -> tuple[str, ...]:
        """Names in the file of test frames that ships beside the protocol."""
        recorded = self.keys.recorded
        if recorded is None or recorded.test_frames is None:
            return ()
        lines = (self.path.parent / recorded.test_frames).read_text(encoding="utf-8").splitlines()
        return tuple(line.strip() for line in lines if line.strip() and line[0] != "#")


def protocol_files() -> dict[str, Path]:
    """Name -> file of every protocol that ships with tactibench."""
    return {path.stem: path for path in sorted(shipped_folder("protocols").glob("*.toml"))}


def protocol_titles() -> dict[str, tuple[int, str]]:
    """Name -> version and title, read without validating (for listings)."""
    titles = {}
    for name, path in protocol_files().items():
        keys = tomllib.loads(path.read_text(encoding="utf-8"))
        titles[name] = (int(keys["version"]), str(keys["title"]))
    return titles


def load_protocol(name: str) -> LoadedProtocol:
    """Load a shipped protocol by name, or any protocol by the path of its ``.toml`` file.

    Raises UserError for an unknown name, an unreadable file, or a wrong or missing key.
    """
    files = protocol_files()
    path = files.get(name)
    if path is None:
        path = Path(name)
        if path.suffix != ".toml":
            raise UserError(f"unknown protocol {name!r}; {did_you_mean(name, files)}")
    return read_protocol(path)


def read_protocol(path: Path) -> LoadedProtocol:
    """Read and validate one file. Raises UserError."""
    from pydantic import ValidationError

    from tactibench.protocols.schema import Protocol

    try:
        raw = path.read_bytes()
        tables = tomllib.loads(raw.decode("utf-8"))
    except FileNotFoundError:
        raise UserError(f"protocol file {path} does not exist; check the path.") from None
    except IsADirectoryError:
        raise UserError(f"protocol file {path} is a folder; name the .toml file.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"protocol file {path} is not valid TOML: {error}.") from None
    try:
        keys = Protocol.model_validate(tables)
    except ValidationError as error:
        raise UserError(f"protocol file {path}: {_first_mistake(error.errors())}") from None
    digest = hashlib.sha256(raw)
    loaded = LoadedProtocol(keys, path, "")
    for line in loaded.test_frame_names():
        digest.update(line.encode() + b"\n")
    return LoadedProtocol(keys, path, digest.hexdigest())


def _first_mistake(mistakes: Sequence[Any]) -> str:
    from tactibench.protocols.schema import Protocol

    mistake = mistakes[0]
    where = ".".join(str(part) for part in mistake["loc"])
    more = f" ({len(mistakes) - 1} more mistakes follow.)" if len(mistakes) > 1 else ""
    if mistake["type"] == "extra_forbidden":
        known = _sibling_keys(Protocol, mistake["loc"][:-1])
        hint = did_you_mean(str(mistake["loc"][-1]), known)
        return f"unknown key {where!r}; {hint}{more}"
    if mistake["type"] == "missing":
        return f"the key {where!r} is missing; add it.{more}"
    text = mistake["msg"].removeprefix("Value error, ")
    at = f"key {where!r}: " if where else ""
    return f"{at}{text}.{more}"


def _sibling_keys(model: Any, where: Sequence[Any]) -> list[str]:
    """Field names allowed at a place of the schema."""
    import typing

    from pydantic import BaseModel

    for part in where:
        if isinstance(part, int):
            continue
        names = {f.alias or n: f.annotation for n, f in model.model_fields.items()}
        inside = names.get(str(part))
        candidates = [inside, *typing.get_args(inside)]
        model = next(
            (c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None
        )
        if model is None:
            return []
    return [field.alias or name for name, field in model.model_fields.items()]
