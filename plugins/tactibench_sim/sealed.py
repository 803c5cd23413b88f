"""Data files that are sealed: arrays with their parameters and a sha256 over both."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from tactibench import UserError

Arrays = dict[str, npt.NDArray[Any]]
Built = TypeVar("Built")


def digest_of(arrays: Mapping[str, npt.NDArray[Any]], parameters: str) -> str:
    """sha256 over the parameters and every array's name, type, shape and bytes, in order."""
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
    path: Path, what: str, remedy: str, build: Callable[[Arrays, dict[str, Any], str], Built]
) -> Built:
    """What ``build`` makes of a file's arrays, parameters and digest.

    Raises UserError, with ``what`` the file is and the ``remedy``, where it is unreadable, lacks
    something that ``build`` asks for, or does not fit its own hash.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        text, told = str(arrays.pop("parameters")), str(arrays.pop("sha256"))
        if digest_of(arrays, text) != told:
            raise UserError(f"{what} {path} does not fit its own hash; {remedy}")
        return build(arrays, json.loads(text), told)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error) as error:
        raise UserError(
            f"{what} {path} cannot be read ({type(error).__name__}); {remedy}"
        ) from None
