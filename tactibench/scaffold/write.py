"""Writing the files of a new plugin, all of them or none."""

from __future__ import annotations

import shutil
import tempfile
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from string import Template

from tactibench.errors import UserError
from tactibench.scaffold.names import Names

SUFFIX = ".template"
"""A template is no Python file: nothing imports, checks or formats it."""
COMMON, PACKAGE = "common", "package"


def write_package(names: Names, parent: Path) -> Path:
    """Write the package into a new folder of ``parent`` and return it.

    Raises UserError where that folder, or something of its name, is there already.
    """
    folder = parent / names.distribution
    if folder.exists() or folder.is_symlink():
        raise UserError(
            f"{folder} is there already and is left as it is; take another name, or another place "
            "with --out."
        )
    if parent.exists() and not parent.is_dir():
        raise UserError(f"--out {parent} is not a folder; name one, or a place for a new one.")
    contents = rendered(names)
    parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(dir=parent, prefix=f".{names.distribution}."))
    try:
        for name, text in contents.items():
            path = made / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        made.chmod(0o755)
        made.rename(folder)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    return folder


def rendered(names: Names) -> dict[str, str]:
    """Path inside the folder -> text, of every file of a new plugin."""
    found: dict[str, str] = {}
    templates = files("tactibench.scaffold") / "templates"
    for part in (COMMON, names.kind):
        for path, text in _templates(templates / part):
            place = (
                names.package + path.removeprefix(PACKAGE)
                if path.startswith(f"{PACKAGE}/")
                else path
            )
            found[place] = Template(text).substitute(names.fields())
    return dict(sorted(found.items()))


def _templates(folder: Traversable, inside: str = "") -> list[tuple[str, str]]:
    """Path without its suffix and text of every template under a folder."""
    found: list[tuple[str, str]] = []
    for entry in folder.iterdir():
        if entry.is_dir():
            found += _templates(entry, f"{inside}{entry.name}/")
        elif entry.name.endswith(SUFFIX):
            name = entry.name.removesuffix(SUFFIX)
            found.append((inside + name, entry.read_text(encoding="utf-8")))
    return found
