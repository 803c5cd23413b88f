"""Data files of the simulator: arrays with their parameters and a checksum over both."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Generic, TypeVar
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
    """Write a file whole or not at all, and return its digest."""
    from tactibench.lab import atomic  # scripts alone write

    text = json.dumps(parameters, sort_keys=True)
    digest = digest_of(arrays, text)
    content: dict[str, Any] = {**arrays, "parameters": np.array(text), "sha256": digest}
    with atomic(path) as out:
        np.savez_compressed(out, **content)
    return digest


@dataclass(frozen=True, eq=False)
class DataFile(Generic[Content]):
    """A kind of data file, and the one of that kind that ships.

    Attributes:
        package: Package beside whose modules the file ships.
        name: Name of the file that ships.
        title: What the file is, for messages.
        build: Makes the result from a file's arrays, parameters and digest.
        script: Script that makes such a file, for messages; "": none that users have.
    """

    package: str
    name: str
    title: str
    build: Callable[[Arrays, dict[str, Any], str], Content]
    script: str = ""

    def read(self, path: Path) -> Content:
        """Read a file, check it against its checksum and build what it holds.

        Raises:
            UserError: The file is unreadable, lacks something that ``build`` asks for, or does not
                fit its own hash.
        """
        again = f" or make it again with {self.script}" if self.script else ""
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            text, stated = str(arrays.pop("parameters")), str(arrays.pop("sha256"))
            if digest_of(arrays, text) != stated:
                raise UserError(
                    f"{self.title} {path} does not fit its own hash; reinstall tactibench{again}."
                )
            return self.build(arrays, json.loads(text), stated)
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error) as error:
            raise UserError(
                f"{self.title} {path} cannot be read ({type(error).__name__}); "
                f"reinstall tactibench{again}."
            ) from None

    def shipped(self) -> Content:
        """Return the content of the file that ships, the same object at every call."""
        return self._shipped

    @cached_property
    def _shipped(self) -> Content:
        with as_file(files(self.package).joinpath(self.name)) as path:
            return self.read(path)
