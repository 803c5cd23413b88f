"""Where an export goes: made beside its place under another name, so that it is whole or absent."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from tactibench.errors import UserError
from tactibench.records.files import atomic


@contextmanager
def new_folder(target: Path, source: Path) -> Iterator[Path]:
    """A temporary neighbour of ``target`` to write into; it takes the name when all went well.

    source: folder of the data set, which an export may not be written into. Raises UserError where
    ``target`` is a file, a folder that holds something, lies in ``source``, or has no folder to
    lie in.
    """
    target = target.absolute()
    _refuse_folder(target, source)
    made = target.with_name(f".{target.name}.{uuid4().hex[:8]}")
    made.mkdir()
    try:
        yield made
        if target.is_dir():  # empty; a folder takes the place of an empty one on POSIX only
            target.rmdir()
        made.rename(target)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise


def write_new(path: Path, text: str) -> None:
    """Write a text file under a name that nothing has yet. Raises UserError where one has."""
    _refuse_orphan(path)
    if path.exists() or path.is_symlink():
        raise UserError(f"{path} is there already; move it away first, nothing is overwritten.")
    with atomic(path) as stream:
        stream.write(text.encode())


def _refuse_folder(target: Path, source: Path) -> None:
    _refuse_orphan(target)
    if target.resolve().is_relative_to(source.resolve()):
        raise UserError(f"{target} lies in the data set {source}; give a folder outside of it.")
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise UserError(f"{target} is a file or a link; give the name of a new folder.")
    if target.is_dir() and any(target.iterdir()):
        raise UserError(
            f"{target} holds files already; give the name of a new folder, nothing is overwritten."
        )


def _refuse_orphan(target: Path) -> None:
    if not target.parent.is_dir():
        raise UserError(f"the folder {target.parent} is not there; make it first.")
