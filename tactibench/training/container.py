"""Tensors with a JSON header in one safetensors file: no pickle, atomic, protected by a digest."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors.torch import save

from tactibench.training.network import tensor_bytes

_ENTRY = "tactibench"
_UNREADABLE = (
    safetensors.SafetensorError,
    KeyError,
    TypeError,
    ValueError,
    OSError,
    RecursionError,  # of JSON in JSON without an end
)


class DamagedFile(Exception):  # noqa: N818
    """A container that cannot be read or whose digest does not fit; the text says why."""


def write_container(path: Path, tensors: Mapping[str, torch.Tensor], header: Any) -> None:
    """Write atomically: a temporary name, fsync, rename. Raises OSError as the disk does."""
    text = json.dumps(header, sort_keys=True)
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    # One entry: safetensors writes several in an order that changes from call to call.
    metadata = {_ENTRY: json.dumps({"digest": _digest(plain, text), "header": text})}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(save(plain, metadata=metadata))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_container(path: Path) -> tuple[dict[str, torch.Tensor], Any]:
    """Return tensors and header. Raises FileNotFoundError, or DamagedFile for anything else."""
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        entry = json.loads(metadata[_ENTRY])
        text, stated = entry["header"], entry["digest"]
        header = json.loads(text)
    except _UNREADABLE as error:
        raise DamagedFile(f"it cannot be read ({error})") from error
    if _digest(tensors, text) != stated:
        raise DamagedFile("its digest does not fit its content")
    return tensors, header


def _digest(tensors: Mapping[str, torch.Tensor], text: str) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor_bytes(tensor))
    return digest.hexdigest()
