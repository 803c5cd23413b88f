"""Reading a configuration file; every mistake is one sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path

from pydantic import ValidationError

from tactibench import UserError
from tactibench.lab import first_mistake
from tactibench_tactip.settings import Settings


def read_settings(path: Path) -> Settings:
    """The settings of a file. Raises UserError with the file and the key that is wrong."""
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(
            f"the configuration {path} is not there; `tactibench hw emulate` writes one to start "
            "from."
        ) from None
    except OSError as error:
        raise UserError(
            f"the configuration {path} cannot be read: {error.strerror or error}."
        ) from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"the configuration {path} is not valid TOML: {error}.") from None
    try:
        return Settings.model_validate(tables)
    except ValidationError as error:
        raise UserError(f"the configuration {path}: {first_mistake(error, Settings)}") from None
