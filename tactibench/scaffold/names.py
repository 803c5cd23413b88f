"""What a new plugin may be called."""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass
from importlib.util import find_spec

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_LONGEST = 40


@dataclass(frozen=True)
class Names:
    """All that follows from a kind and a name."""

    kind: str
    name: str

    @property
    def package(self) -> str:
        """What is imported."""
        return f"tactibench_{self.name}"

    @property
    def distribution(self) -> str:
        """What is installed; also the name of its folder."""
        return f"tactibench-{self.name.replace('_', '-')}"

    @property
    def class_name(self) -> str:
        return "".join(part.capitalize() for part in self.name.split("_"))

    def fields(self) -> dict[str, str]:
        """What a template may name."""
        return {
            "kind": self.kind,
            "name": self.name,
            "package": self.package,
            "distribution": self.distribution,
            "class_name": self.class_name,
        }


def checked_names(kind: str, name: str, host: PluginHost) -> Names:
    """The names of a new plugin. Raises UserError for one that cannot be taken, or is."""
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


def _mistake(name: str) -> str:
    """Why no plugin could have that name, or ""."""
    if any(mark in name for mark in "/\\:"):
        return "it is a path; say where to write it with --out"
    if keyword.iskeyword(name):
        return "it is a keyword of Python"
    if not name.isidentifier() or not name.isascii():
        return "it is no identifier of letters, digits and '_' that begins with a letter"
    if name != name.lower():
        return f"it has capital letters; write {name.lower()!r}"
    if not _NAME.fullmatch(name):
        return "it begins with '_'"
    if name.endswith("_"):
        return "it ends with '_'"
    if len(name) > _LONGEST:
        return f"it is longer than {_LONGEST} characters"
    return ""


def _owner(names: Names, host: PluginHost) -> str:
    """Who has the name already, or ""."""
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
