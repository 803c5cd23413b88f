"""The package of a new plugin: its names, and its files written from templates."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path
from string import Template

from tactibench.errors import UserError
from tactibench.plugins import PluginHost

LONGEST_NAME = 40
SUFFIX = ".template"
"""Ending of templates. They are no Python files: nothing imports, checks or formats them."""
COMMON, PACKAGE = "common", "package"
"""Folder of the templates of every kind, and placeholder for the package's folder."""


_NAME = re.compile(r"[a-z]([a-z0-9_]*[a-z0-9])?")


@dataclass(frozen=True)
class Names:
    """All names that follow from the kind and the name of a plugin.

    Attributes:
        kind: Kind of the plugin, such as "sensor".
        name: Name of the plugin.
    """

    kind: str
    name: str

    @property
    def package(self) -> str:
        """Name of the package, for imports."""
        return f"tactibench_{self.name}"

    @property
    def distribution(self) -> str:
        """Name of the distribution, for pip; also of its folder."""
        return f"tactibench-{self.name.replace('_', '-')}"

    @property
    def class_name(self) -> str:
        """Name of the class behind the spec."""
        return "".join(part.capitalize() for part in self.name.split("_"))

    def fields(self) -> dict[str, str]:
        """Return the fields that a template may name."""
        return {
            "kind": self.kind,
            "name": self.name,
            "package": self.package,
            "distribution": self.distribution,
            "class_name": self.class_name,
        }


def check_name(kind: str, name: str, host: PluginHost) -> Names:
    """Return the names of a new plugin.

    Raises:
        UserError: The name is not allowed, or it is taken.
    """
    mistake = _mistake(name)
    if mistake:
        raise UserError(
            f"a {kind} cannot be called {name!r}: {mistake}; take a name such as 'my_{kind}'."
        )
    names = Names(kind, name)
    owner = _owner(names, host)
    if owner:
        raise UserError(f"the name {name!r} is taken by {owner}; take another one.")
    return names


def write_package(names: Names, parent: Path, template: str = "") -> Path:
    """Write all files of the package into a new folder of ``parent`` and return it.

    Args:
        names: Names of the plugin.
        parent: Folder that shall hold the new one.
        template: Folder of templates that replace those of the kind; "": those of the kind.

    Raises:
        UserError: The new folder is there already, or ``parent`` is no folder.
    """
    folder = parent / names.distribution
    if folder.exists() or folder.is_symlink():
        raise UserError(
            f"{folder} is there already and is left as it is; take another name, or another place "
            "with --out."
        )
    if parent.exists() and not parent.is_dir():
        raise UserError(f"--out {parent} is not a folder; name one, or a place for a new one.")
    contents = render_templates(names, template)
    for name, text in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def render_templates(names: Names, template: str = "") -> dict[str, str]:
    """Return the text of every file of a new plugin, by its path inside the folder."""
    contents: dict[str, str] = {}
    templates = files("tactibench.scaffold") / "templates"
    for folder in dict.fromkeys((COMMON, names.kind, template or names.kind)):  # the last one wins
        for path, text in _read_templates(templates / folder):
            if path.startswith(f"{PACKAGE}/"):
                path = names.package + path.removeprefix(PACKAGE)
            contents[path] = Template(text).substitute(names.fields())
    return dict(sorted(contents.items()))


def _read_templates(folder: Traversable, parent: str = "") -> Iterator[tuple[str, str]]:
    """Yield the path (without the suffix) and the text of every template under a folder."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _read_templates(entry, f"{parent}{entry.name}/")
        elif entry.name.endswith(SUFFIX):
            yield parent + entry.name.removesuffix(SUFFIX), entry.read_text(encoding="utf-8")


def _mistake(name: str) -> str:
    """Return the reason why no plugin can have this name, or ""."""
    if any(mark in name for mark in "/\\:"):
        return "it is a path; say where to write it with --out"
    if keyword.iskeyword(name):
        return "it is a keyword of Python"
    if not _NAME.fullmatch(name):
        return "it is no identifier of small letters, digits and '_' between them"
    if len(name) > LONGEST_NAME:
        return f"it is longer than {LONGEST_NAME} characters"
    return ""


def _owner(names: Names, host: PluginHost) -> str:
    """Return a description of what has the name already, or ""."""
    catalogue = host.catalogue(names.kind)
    for spec in catalogue:
        if spec.name.lower() == names.name:
            return f"the {names.kind} of plugin {catalogue.origins[spec.name]}"
    if names.name in catalogue.clashes:
        return f"several plugins that offer a {names.kind} of that name"
    for origin in (*host.plugins, *(problem.origin for problem in host.problems)):
        if origin.plugin.lower() == names.name:
            return f"plugin {origin}"
    if find_spec(names.package) is not None:
        return f"the installed package {names.package!r}"
    return ""
