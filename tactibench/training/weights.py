"""Trained weights on disk: tensors and a JSON header in one safetensors file, without pickle."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import safetensors
import torch
from safetensors.torch import save

from tactibench.errors import UserError
from tactibench.records import atomic

Image = npt.NDArray[np.uint8]

FILE = "weights.safetensors"
_SCHEMA = 2
_ENTRY = "tactibench"
_UNREADABLE = (
    safetensors.SafetensorError,
    KeyError,
    TypeError,
    ValueError,
    OSError,
    RecursionError,  # JSON that is nested without an end
)


class DamagedFileError(Exception):
    """A container that cannot be read or whose digest does not fit; the message tells why."""


def save_weights(
    directory: Path,
    tensors: Mapping[str, torch.Tensor | npt.NDArray[Any]],
    *,
    model: str,
    architecture: Mapping[str, Any],
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write the weights of a model.

    Args:
        directory: An existing folder.
        tensors: Tensors or arrays by name.
        model: Name by which the model is declared.
        architecture: JSON values that determine the meaning of the tensors.
        extra: Further JSON values that ``load_weights`` returns.
    """
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
    """Return the tensors and extra values of weights of exactly this model and architecture.

    Args:
        directory: Folder of the weights.
        model: Name by which the model is declared.
        architecture: JSON values that determine the meaning of the tensors.

    Raises:
        UserError: The file is missing or damaged, or has another schema, model or architecture.
    """
    path = directory / FILE
    again = "train the model again (--fresh)."
    try:
        tensors, header = read_container(path)
    except FileNotFoundError:
        raise UserError(f"{path} is missing; {again}") from None
    except DamagedFileError as error:
        raise UserError(f"{path} holds no usable weights: {error}; {again}") from error
    stored = {key: header.get(key) for key in ("model", "schema")}
    if stored != {"model": model, "schema": _SCHEMA}:
        raise UserError(
            f"{path} holds weights of model {stored['model']!r}, schema {stored['schema']}, and "
            f"not of {model!r}, schema {_SCHEMA}; {again}"
        )
    trained = header["architecture"]
    for name in sorted({*architecture, *trained}):
        wanted, value = architecture.get(name), trained.get(name)
        if value != wanted:
            raise UserError(
                f"{path} was trained with {name}={value!r}, but {name}={wanted!r} is asked for; "
                f"ask for what it was trained with, or {again}"
            )
    return tensors, header["extra"]


def write_container(
    path: Path, tensors: Mapping[str, torch.Tensor | npt.NDArray[Any]], header: Any
) -> None:
    """Write tensors or arrays and a JSON header atomically, protected by a digest."""
    text = json.dumps(header, sort_keys=True)
    plain = {name: _plain(tensor) for name, tensor in tensors.items()}
    # One entry: safetensors writes several in an order that changes from call to call.
    metadata = {_ENTRY: json.dumps({"digest": _digest(plain, text), "header": text})}
    with atomic(path) as file:
        file.write(save(plain, metadata=metadata))


def read_container(path: Path) -> tuple[dict[str, torch.Tensor], Any]:
    """Return tensors and header.

    Raises:
        FileNotFoundError: The file does not exist.
        DamagedFileError: The file cannot be read or was changed.
    """
    if not path.is_file():
        raise FileNotFoundError(path)
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        entry = json.loads(metadata[_ENTRY])
        text, digest = entry["header"], entry["digest"]
        header = json.loads(text)
    except _UNREADABLE as error:
        raise DamagedFileError(f"it cannot be read ({error})") from error
    if _digest(tensors, text) != digest:
        raise DamagedFileError("its digest does not fit its content")
    return tensors, header


def _plain(tensor: torch.Tensor | npt.NDArray[Any]) -> torch.Tensor:
    if isinstance(tensor, np.ndarray):
        tensor = torch.from_numpy(np.array(tensor))
    return tensor.detach().cpu().contiguous()


def tensor_bytes(tensor: torch.Tensor) -> bytes:
    """Return the bits of a tensor in row-major order."""
    flat = _plain(tensor).reshape(-1)
    return flat.view(torch.uint8).numpy().tobytes()


def _digest(tensors: Mapping[str, torch.Tensor], text: str) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor_bytes(tensor))
    return digest.hexdigest()


def pack_image(image: Image) -> str:
    """Return an (H, W) uint8 image as "H W levels", the levels compressed and in base 85."""
    height, width = image.shape
    levels = base64.b85encode(zlib.compress(image.tobytes(), 9)).decode("ascii")
    return f"{height} {width} {levels}"


def unpack_image(text: str) -> Image:
    """Return the (H, W) uint8 image of a text that ``pack_image`` wrote."""
    height, width, levels = text.split(" ")
    flat = np.frombuffer(zlib.decompress(base64.b85decode(levels)), dtype=np.uint8)
    return flat.reshape(int(height), int(width)).copy()
