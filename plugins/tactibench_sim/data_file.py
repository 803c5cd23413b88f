"""Data files of the simulator: arrays with their parameters and a checksum over both."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from tactibench import UserError

Arrays = dict[str, npt.NDArray[Any]]
Content = TypeVar("Content")


def digest_of(arrays: Mapping[str, npt.NDArray[Any]], parameters: str) -> str:
    """Return the sha256 over the parameters and every array's name, type, shape and bytes."""
    total = hashlib.sha256(parameters.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def write(path: Path, arrays: Mapping[str, npt.NDArray[Any]], parameters: dict[str, Any]) -> str:
    """Write a file under a temporary name, rename it, and return its digest."""
    text = json.dumps(parameters, sort_keys=True)
    digest = digest_of(arrays, text)
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as out:
        content: dict[str, Any] = {**arrays, "parameters": np.array(text), "sha256": digest}
        np.savez_compressed(out, **content)
    temporary.replace(path)
    return digest


def read(
    path: Path, title: str, remedy: str, build: Callable[[Arrays, dict[str, Any], str], Content]
) -> Content:
    """Read a file, check it against its checksum and build what it holds.

    Args:
        path: The file.
        title: What the file is, for messages.
        remedy: What to do about a bad file, for messages.
        build: Makes the result from the file's arrays, parameters and digest.

    Raises:
        UserError: The file is unreadable, lacks something that ``build`` asks for, or does not fit
            its own hash.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        text, stated = str(arrays.pop("parameters")), str(arrays.pop("sha256"))
        if digest_of(arrays, text) != stated:
            raise UserError(f"{title} {path} does not fit its own hash; {remedy}")
        return build(arrays, json.loads(text), stated)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error) as error:
        raise UserError(
            f"{title} {path} cannot be read ({type(error).__name__}); {remedy}"
        ) from None


def read_shipped(package: str, name: str, reader: Callable[[Path], Content]) -> Content:
    """Read a data file that ships beside the modules of ``package``."""
    with as_file(files(package).joinpath(name)) as path:
        return reader(path)
