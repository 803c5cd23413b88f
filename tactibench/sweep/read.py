"""Reading a sweep's file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from tactibench.errors import UserError
from tactibench.protocols.mistakes import first_mistake
from tactibench.sweep.keys import SweepKeys


@dataclass(frozen=True)
class SweepFile:
    """Valid keys and where they are from; paths in them begin at the file's folder."""

    path: Path
    keys: SweepKeys

    def inside(self, text: str) -> Path:
        """A path of the file, absolute: the workers' folders are others."""
        return (self.path.parent / Path(text).expanduser()).resolve()

    def mistake(self, text: str) -> UserError:
        """What is wrong with the file, as the rest of a sentence."""
        return UserError(f"sweep file {self.path}: {text}")


def read_sweep(path: Path) -> SweepFile:
    """Read and validate. Raises UserError with the key, what was found and what is allowed."""
    try:
        tables = tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise UserError(f"sweep file {path} does not exist; check the path.") from None
    except IsADirectoryError:
        raise UserError(f"sweep file {path} is a folder; name the .toml file.") from None
    except OSError as error:
        raise UserError(f"sweep file {path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, RecursionError) as error:  # TOML's and Unicode's errors are ValueErrors
        raise UserError(f"sweep file {path} is not valid TOML: {error}.") from None
    try:
        return SweepFile(path, SweepKeys.model_validate(tables))
    except ValidationError as error:
        raise UserError(f"sweep file {path}: {first_mistake(error, SweepKeys)}") from None
