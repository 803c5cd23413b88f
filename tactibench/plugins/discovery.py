"""Which plugins are installed, read from the metadata of the distributions on the path."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import Distribution, EntryPoint, distributions

from tactibench.plugins.hookspecs import GROUP

UNKNOWN = "unknown"


@dataclass(frozen=True)
class Origin:
    """Which distribution a plugin came from."""

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        return f"{self.plugin!r} ({self.distribution} {self.version})"


def installed() -> list[tuple[EntryPoint, Origin]]:
    """Entry points of the group ``tactibench`` with where they are from, as the path has them.

    Of distributions with the same name the first on the path counts, as it does for imports.
    ``importlib.metadata.entry_points`` parses the entry points and the metadata of every installed
    distribution, so one damaged stranger breaks it and all of them cost time; here a file that
    does not mention the group is only searched.
    """
    found: list[tuple[EntryPoint, Origin]] = []
    seen: set[str] = set()
    for distribution in distributions():
        points = _points(distribution)
        if not points:
            continue
        name, version = _name_and_version(distribution)
        key = name.lower().replace("_", "-")
        if key in seen:
            continue
        if name != UNKNOWN:
            seen.add(key)
        found.extend((point, Origin(point.name, name, version)) for point in points)
    return found


def _points(distribution: Distribution) -> list[EntryPoint]:
    try:
        text = distribution.read_text("entry_points.txt") or ""
    except (OSError, UnicodeDecodeError):
        return []
    points, section = [], ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[] ")
        elif section == GROUP and line and line[0] not in "#;":
            name, _, target = line.partition("=")
            points.append(EntryPoint(name.strip(), target.strip(), GROUP))
    return points


def _name_and_version(distribution: Distribution) -> tuple[str, str]:
    """From the head of METADATA (or PKG-INFO); its mail parser alone would take 10 ms."""
    try:
        text = distribution.read_text("METADATA") or distribution.read_text("PKG-INFO") or ""
    except (OSError, UnicodeDecodeError):
        text = ""
    fields: dict[str, str] = {}
    for line in text.splitlines():
        if not line:  # the description follows
            break
        key, _, value = line.partition(":")
        fields.setdefault(key, value.strip())
    return fields.get("Name") or UNKNOWN, fields.get("Version") or "?"
