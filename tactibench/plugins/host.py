"""The guarded plugin host: one thin object, and one broken plugin never stops the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import Distribution, EntryPoint, distributions
from typing import Any, Generic, TypeVar

import pluggy

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import hookspecs
from tactibench.plugins.specs import CommandSpec, EncoderSpec, ModelSpec, SensorSpec

S = TypeVar("S", ModelSpec, SensorSpec, EncoderSpec, CommandSpec)


@dataclass(frozen=True)
class Origin:
    """Which distribution a plugin came from."""

    plugin: str
    distribution: str
    version: str


@dataclass(frozen=True)
class Problem:
    """Something a plugin did wrong, and in which step: load, validate, declare or duplicate."""

    origin: Origin
    step: str
    message: str


@dataclass(frozen=True)
class Catalogue(Generic[S]):
    """Declared specs of one kind, sorted by name, each with the plugin it came from."""

    kind: str
    specs: Mapping[str, S]
    origins: Mapping[str, Origin]
    clashes: Mapping[str, tuple[Origin, ...]]

    def __iter__(self) -> Iterator[S]:
        return iter(self.specs.values())

    def __getitem__(self, name: str) -> S:
        """Return the spec. Raises UserError with the close match for an unknown name."""
        if name in self.clashes:
            owners = " and ".join(
                f"{o.plugin!r} ({o.distribution} {o.version})" for o in self.clashes[name]
            )
            raise UserError(
                f"{self.kind} {name!r} is offered by {owners}; uninstall one of them to use it."
            )
        if name not in self.specs:
            raise UserError(f"unknown {self.kind} {name!r}; {did_you_mean(name, self.specs)}")
        return self.specs[name]


class PluginHost:
    """Loads the entry points of group ``tactibench`` one by one under a guard."""

    def __init__(self, entry_points: Iterable[tuple[EntryPoint, Distribution | None]] | None = None):
        self._manager = pluggy.PluginManager(hookspecs.GROUP)
        self._manager.add_hookspecs(hookspecs)
        self._origins: dict[str, Origin] = {}
        self._problems: list[Problem] = []
        found = installed_entry_points() if entry_points is None else entry_points
        for point, distribution in sorted(found, key=lambda pair: pair[0].name):
            self._load(point, distribution)

    def _load(self, point: EntryPoint, distribution: Distribution | None) -> None:
        name, version = "unknown", "?"
        if distribution is not None:
            name, version = distribution.name or "unknown", distribution.version or "?"
        origin = Origin(point.name, name, version)
        try:
            module = point.load()
        except Exception as error:  # noqa: BLE001 - whatever a stranger's import raises is reported
            self._note(origin, "load", error)
            return
        if point.name in self._origins:
            message = f"the name is already taken by {self._origins[point.name].distribution}"
            self._problems.append(Problem(origin, "duplicate", message))
            return
        try:
            self._manager.register(module, name=point.name)
            self._manager.check_pending()
        except Exception as error:  # noqa: BLE001 - likewise
            if self._manager.has_plugin(point.name):
                self._manager.unregister(name=point.name)
            self._note(origin, "validate", error)
            return
        self._origins[point.name] = origin

    def _note(self, origin: Origin, step: str, error: BaseException) -> None:
        first = str(error).strip().splitlines()
        text = f"{type(error).__name__}: {first[0] if first else 'no message'}"
        self._problems.append(Problem(origin, step, text))

    def _declared(self, kind: str, hook: str, expected: type[S]) -> Catalogue[S]:
        caller: pluggy.HookCaller = getattr(self._manager.hook, hook)
        owners: dict[str, list[tuple[Origin, S]]] = {}
        for implementation in caller.get_hookimpls():
            origin = self._origins[implementation.plugin_name]
            for spec in self._declarations(origin, implementation.function, expected):
                owners.setdefault(spec.name, []).append((origin, spec))
        specs, origins, clashes = {}, {}, {}
        for name, claims in sorted(owners.items()):
            if len(claims) > 1:
                clashes[name] = tuple(origin for origin, _ in claims)
                for origin, _ in claims:
                    message = f"{kind} {name!r} is offered by more than one plugin"
                    self._problems.append(Problem(origin, "duplicate", message))
            else:
                origins[name], specs[name] = claims[0]
        return Catalogue(kind, specs, origins, clashes)

    def _declarations(
        self, origin: Origin, declare: Callable[[], Any], expected: type[S]
    ) -> list[S]:
        try:
            declared = list(declare())
        except Exception as error:  # noqa: BLE001 - a plugin may raise anything
            self._note(origin, "declare", error)
            return []
        good = []
        for spec in declared:
            if isinstance(spec, expected) and isinstance(spec.name, str) and spec.name:
                good.append(spec)
            else:
                message = f"declared {type(spec).__name__} where {expected.__name__} is expected"
                self._problems.append(Problem(origin, "declare", message))
        return good

    @cached_property
    def models(self) -> Catalogue[ModelSpec]:
        return self._declared("model", "tactibench_models", ModelSpec)

    @cached_property
    def sensors(self) -> Catalogue[SensorSpec]:
        return self._declared("sensor", "tactibench_sensors", SensorSpec)

    @cached_property
    def encoders(self) -> Catalogue[EncoderSpec]:
        return self._declared("encoder", "tactibench_encoders", EncoderSpec)

    @cached_property
    def commands(self) -> Catalogue[CommandSpec]:
        return self._declared("command", "tactibench_commands", CommandSpec)

    @property
    def plugins(self) -> tuple[Origin, ...]:
        """Plugins that loaded, sorted by name."""
        return tuple(sorted(self._origins.values(), key=lambda origin: origin.plugin))

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Everything that went wrong, after asking every plugin for all it declares."""
        _ = self.models, self.sensors, self.encoders, self.commands
        return tuple(self._problems)


def installed_entry_points() -> list[tuple[EntryPoint, Distribution | None]]:
    """Entry points of the group, with their distributions; the first of equal names on the path.

    ``importlib.metadata.entry_points`` drops the distribution of a point on old Pythons and reads
    every distribution's metadata to remove duplicates; reading entry_points.txt alone is faster.
    """
    found: list[tuple[EntryPoint, Distribution | None]] = []
    seen: set[str] = set()
    for distribution in distributions():
        points = [p for p in distribution.entry_points if p.group == hookspecs.GROUP]
        if not points:
            continue
        name = distribution.name or "unknown"
        if name in seen:
            continue
        seen.add(name)
        found.extend((point, distribution) for point in points)
    return found
