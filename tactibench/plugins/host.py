"""The guarded plugin host: one thin object, and one broken plugin never stops the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint
from typing import Any, Generic, TypeVar

import pluggy

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import hookspecs
from tactibench.plugins.discovery import Origin, installed
from tactibench.plugins.specs import CommandSpec, EncoderSpec, ModelSpec, SensorSpec, in_one_line

S = TypeVar("S", ModelSpec, SensorSpec, EncoderSpec, CommandSpec)

HOOKS = tuple(name for name in vars(hookspecs) if name.startswith(f"{hookspecs.GROUP}_"))


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
            owners = " and ".join(str(origin) for origin in self.clashes[name])
            raise UserError(
                f"{self.kind} {name!r} is offered by {owners}; uninstall one of them to use it."
            )
        if name not in self.specs:
            raise UserError(f"unknown {self.kind} {name!r}; {did_you_mean(name, self.specs)}")
        return self.specs[name]


class PluginHost:
    """Loads the entry points of group ``tactibench`` one by one under a guard.

    Whatever a plugin raises becomes a Problem, SystemExit and other bare BaseExceptions included
    (bindings to other languages raise such); only KeyboardInterrupt, which is the user's, passes.
    """

    def __init__(self, points: Iterable[tuple[EntryPoint, Origin]] | None = None) -> None:
        self._manager = pluggy.PluginManager(hookspecs.GROUP)
        self._manager.add_hookspecs(hookspecs)
        self._origins: dict[str, Origin] = {}
        self._problems: list[Problem] = []
        found = installed() if points is None else points
        for point, origin in sorted(found, key=lambda pair: (pair[1].plugin, pair[1].distribution)):
            self._load(point, origin)

    def _load(self, point: EntryPoint, origin: Origin) -> None:
        if origin.plugin in self._origins:
            owner = self._origins[origin.plugin]
            self._note(origin, "duplicate", f"plugin {owner} has this name already; rename one")
            return
        try:
            plugin = point.load()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - reported, see the class
            self._note(origin, "load", in_one_line(error))
            return
        try:
            mistake = self._register(plugin, origin.plugin)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - likewise
            mistake = in_one_line(error)
        if mistake is None:
            self._origins[origin.plugin] = origin
            return
        if self._manager.has_plugin(origin.plugin):
            self._manager.unregister(name=origin.plugin)
        self._note(origin, "validate", mistake)

    def _register(self, plugin: object, name: str) -> str | None:
        """Register a plugin and return what is wrong with its hooks, if anything."""
        self._manager.register(plugin, name=name)
        callers = self._manager.get_hookcallers(plugin) or []
        hooks = [caller.name for caller in callers]
        for hook in hooks:
            if hook not in HOOKS:
                return f"there is no hook {hook!r}; {did_you_mean(hook, HOOKS)}"
        self._manager.check_pending()
        unmarked = [hook for hook in HOOKS if hasattr(plugin, hook) and hook not in hooks]
        if unmarked:
            return f"{unmarked[0]} is not marked with @hookimpl"
        return None if hooks else f"it has none of the hooks {', '.join(HOOKS)}"

    def _note(self, origin: Origin, step: str, message: str) -> None:
        self._problems.append(Problem(origin, step, message))

    def _declared(self, kind: str, hook: str, expected: type[S]) -> Catalogue[S]:
        caller: pluggy.HookCaller = getattr(self._manager.hook, hook)
        owners: dict[str, list[tuple[Origin, S]]] = {}
        for implementation in caller.get_hookimpls():
            origin = self._origins[implementation.plugin_name]
            for spec in self._asked(origin, implementation, hook, expected):
                owners.setdefault(spec.name, []).append((origin, spec))
        specs, origins, clashes = {}, {}, {}
        for name, claims in sorted(owners.items()):
            if len(claims) == 1:
                origins[name], specs[name] = claims[0]
                continue
            clashes[name] = tuple(origin for origin, _ in claims)
            for origin in dict.fromkeys(clashes[name]):
                others = [str(o) for o in dict.fromkeys(clashes[name]) if o != origin]
                by = f"also by {' and '.join(others)}" if others else "twice"
                self._note(origin, "duplicate", f"{kind} {name!r} is offered {by}")
        return Catalogue(kind, specs, origins, clashes)

    def _asked(
        self, origin: Origin, implementation: pluggy.HookImpl, hook: str, expected: type[S]
    ) -> list[S]:
        """What one plugin declares. A hook that fails half way declares nothing."""
        wanted = expected.__name__
        try:
            answer = implementation.function()
            if isinstance(answer, str) or not isinstance(answer, Iterable):
                found = type(answer).__name__
                self._note(origin, "declare", f"{hook} gave {found}, not a list of {wanted}")
                return []
            declared = list(answer)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - reported, see the class
            self._note(origin, "declare", f"{hook} raised {in_one_line(error)}")
            return []
        wrong = {type(spec).__name__: None for spec in declared if not isinstance(spec, expected)}
        if wrong:
            message = f"{hook} gave {' and '.join(wrong)} where {wanted} is expected"
            self._note(origin, "declare", message)
        return [spec for spec in declared if isinstance(spec, expected)]

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
    def parts(self) -> tuple[Catalogue[Any], ...]:
        """What a run is made of: models, sensors, encoders."""
        return self.models, self.sensors, self.encoders

    @property
    def plugins(self) -> tuple[Origin, ...]:
        """Plugins that loaded, sorted by name."""
        return tuple(self._origins.values())

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Everything that went wrong, after asking every plugin for all it declares."""
        _ = self.models, self.sensors, self.encoders, self.commands
        return tuple(self._problems)
