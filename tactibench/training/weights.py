"""Trained weights on disk: one safetensors file whose header says what they are weights of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from tactibench.errors import UserError
from tactibench.training.container import DamagedFile, read_container, write_container

FILE = "weights.safetensors"
_SCHEMA = 2


def save_weights(
    directory: Path,
    tensors: Mapping[str, torch.Tensor],
    *,
    model: str,
    architecture: Mapping[str, Any],
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write tensors of a model with its name, architecture and extra JSON values."""
    header = {
        "schema": _SCHEMA,
        "model": model,
        "architecture": dict(architecture),
        "extra": dict(extra or {}),
    }
    write_container(directory / FILE, tensors, header)


def load_weights(
    directory: Path, *, model: str, architecture: Mapping[str, Any]
) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return tensors and extra values of weights of exactly this model and architecture.

    Raises UserError for a missing or damaged file and for weights of anything else.
    """
    path = directory / FILE
    again = "train the model again (--fresh)."
    try:
        tensors, header = read_container(path)
    except FileNotFoundError:
        raise UserError(f"{path} is missing; {again}") from None
    except DamagedFile as error:
        raise UserError(f"{path} holds no usable weights: {error}; {again}") from error
    if header.get("schema") != _SCHEMA:
        raise UserError(
            f"{path} has weights schema {header.get('schema')!r}, allowed is {_SCHEMA}; {again}"
        )
    if header.get("model") != model:
        raise UserError(
            f"{path} holds weights of model {header.get('model')!r}, not of {model!r}; {again}"
        )
    trained = header["architecture"]
    for name in sorted({*architecture, *trained}):
        wanted, found = architecture.get(name), trained.get(name)
        if found != wanted:
            raise UserError(
                f"{path} was trained with {name}={found!r}, but {name}={wanted!r} is asked for; "
                f"use --param {model}.{name}={found} or {again}"
            )
    return tensors, header["extra"]
