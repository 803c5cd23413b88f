"""Search for installed plugins in the metadata of the distributions on the path."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import Distribution, EntryPoint, distributions

from tactibench.errors import printable
from tactibench.plugins.hookspecs import GROUP

UNKNOWN = "unknown"


@dataclass(frozen=True)
class Origin:
    """The distribution that a plugin came from."""

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        return f"{self.plugin!r} ({self.distribution} {self.version})"


def installed() -> list[tuple[EntryPoint, Origin]]:
    """Return the entry points of the group ``tactibench``, in the order of the path.

    Among distributions with the same name the first on the path counts, as it does for imports.
    ``importlib.metadata.entry_points`` parses the entry points and the metadata of every installed
    distribution, so that one damaged distribution breaks it and all of them cost time. Here a file
    that does not mention the group is only searched.
    """
    points: list[tuple[EntryPoint, Origin]] = []
    seen: set[str] = set()
    for distribution in distributions():
        declared = _entry_points(distribution)
        if not declared:
            continue
        name, version = _name_and_version(distribution)
        key = name.lower().replace("_", "-")
        if key in seen:
            continue
        if name != UNKNOWN:
            seen.add(key)
        points.extend((point, Origin(point.name, name, version)) for point in declared)
    return points


def _entry_points(distribution: Distribution) -> list[EntryPoint]:
    points, section = [], ""
    for line in map(str.strip, _read_text(distribution, "entry_points.txt").splitlines()):
        if line.startswith("["):
            section = line.strip("[] ")
        elif section == GROUP and line and line[0] not in "#;":
            name, _, target = line.partition("=")
            points.append(EntryPoint(printable(name.strip()), target.strip(), GROUP))
    return points


def _name_and_version(distribution: Distribution) -> tuple[str, str]:
    """Return name and version from the head of METADATA or PKG-INFO.

    The mail parser of the standard library alone would take 10 ms.
    """
    fields: dict[str, str] = {}
    text = _read_text(distribution, "METADATA") or _read_text(distribution, "PKG-INFO")
    for line in text.splitlines():
        if not line:  # the description follows
            break
        key, _, value = line.partition(":")
        fields.setdefault(key, printable(value.strip()))
    return fields.get("Name") or UNKNOWN, fields.get("Version") or "?"


def _read_text(distribution: Distribution, name: str) -> str:
    """Return a metadata file, "" where it is missing or damaged."""
    try:
        return distribution.read_text(name) or ""
    except (OSError, UnicodeDecodeError):
        return ""
