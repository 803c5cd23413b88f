"""The plugin host: it finds plugins and collects their specs; a broken one never stops the others.

It also names the plugin behind an exception.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.metadata import Distribution, EntryPoint, entry_points
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import pluggy

from tactibench.errors import (
    PluginError,
    UserError,
    call_plugin,
    describe_exception,
    did_you_mean,
    printable,
)
from tactibench.plugins import hookspecs
from tactibench.plugins.specs import CommandSpec, EncoderSpec, ModelSpec, SensorSpec

if TYPE_CHECKING:
    from tactibench.plugins.base import Sensor, SensorContext

SpecT = TypeVar("SpecT", ModelSpec, SensorSpec, EncoderSpec, CommandSpec)

HOOKS = tuple(name for name in vars(hookspecs) if name.startswith(f"{hookspecs.GROUP}_"))


@dataclass(frozen=True)
class Origin:
    """The distribution that a plugin came from."""

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        return f"{self.plugin!r} ({self.distribution} {self.version})"


def installed() -> list[tuple[EntryPoint, Origin]]:
    """Return the entry points of the group ``tactibench``.

    Among distributions with the same name the first on the path counts, as it does for imports.
    """

    @cache  # all plugins of a distribution share its metadata
    def release(distribution: Distribution) -> tuple[str, str]:
        return printable(distribution.name), printable(distribution.version)

    return [
        (point, Origin(printable(point.name), *release(point.dist)))
        for point in entry_points(group=hookspecs.GROUP)
        if point.dist is not None
    ]


@dataclass(frozen=True)
class Problem:
    """A mistake of a plugin, in the step "load", "validate", "declare" or "duplicate"."""

    origin: Origin
    step: str
    message: str

    def __str__(self) -> str:
        return f"plugin {self.origin} in step {self.step}: {self.message}"


@dataclass(frozen=True)
class Catalogue(Generic[SpecT]):
    """Declared specs of one kind, sorted by name, each with the plugin it came from.

    Attributes:
        kind: "model", "sensor", "encoder" or "command".
        specs: Name -> spec; names that two plugins offer are left out.
        origins: Name -> plugin, for the names in ``specs``.
        clashes: Name -> the plugins that all offer it.
        problems: What kept plugins from declaring specs of this kind.
    """

    kind: str
    specs: Mapping[str, SpecT]
    origins: Mapping[str, Origin]
    clashes: Mapping[str, tuple[Origin, ...]]
    problems: tuple[Problem, ...] = ()

    def __iter__(self) -> Iterator[SpecT]:
        return iter(self.specs.values())

    def __contains__(self, name: object) -> bool:
        """Return whether any plugin offers the name, be it more than one."""
        return name in self.specs or name in self.clashes

    def __getitem__(self, name: str) -> SpecT:
        """Return the spec of a name.

        Raises:
            UserError: No plugin offers the name, or it is offered twice.
        """
        if name in self.clashes:
            owners = " and ".join(str(origin) for origin in self.clashes[name])
            raise UserError(
                f"{self.kind} {name!r} is offered by {owners}; uninstall one of them to use it."
            )
        if name not in self.specs:
            # a plugin that failed might have offered it
            broken = "".join(f" Broken {problem}." for problem in self.problems)
            text = f"unknown {self.kind} {name!r}; {did_you_mean(name, self.specs)}{broken}"
            raise UserError(text)
        return self.specs[name]

    def for_answer(self, answer: str) -> Catalogue[ModelSpec]:
        """Return a catalogue of models as they answer "contacts", "plate" or "sites"."""
        models: Any = self
        of_sites = {spec.name: spec.of_sites or spec for spec in models if answer == "sites"}
        return replace(models, specs={**models.specs, **of_sites})


class PluginHost:
    """Loads the entry points of group ``tactibench`` one by one.

    Every exception of a plugin becomes a `Problem`, see ``call_plugin``.
    """

    def __init__(self, points: Iterable[tuple[EntryPoint, Origin]] | None = None) -> None:
        """Load plugins.

        Args:
            points: Entry points and their distributions; None: all installed.
        """
        self._manager = pluggy.PluginManager(hookspecs.GROUP)
        self._manager.add_hookspecs(hookspecs)
        self._origins: dict[str, Origin] = {}
        self._problems: list[Problem] = []
        all_points = installed() if points is None else points
        for point, origin in sorted(
            all_points, key=lambda pair: (pair[1].plugin, pair[1].distribution)
        ):
            self._load(point, origin)

    def _load(self, point: EntryPoint, origin: Origin) -> None:
        name = origin.plugin
        if name in self._origins:
            message = f"plugin {self._origins[name]} has this name already; rename one"
            self._report(origin, "duplicate", message)
            return
        try:
            plugin = call_plugin(point.load)
        except PluginError as error:
            self._report(origin, "load", str(error))
            return
        try:
            mistake = call_plugin(lambda: self._register(plugin, name))
        except PluginError as error:
            mistake = str(error)
        if mistake is None:
            self._origins[name] = origin
            return
        if self._manager.has_plugin(name):
            self._manager.unregister(name=name)
        self._report(origin, "validate", mistake)

    def _register(self, plugin: object, name: str) -> str | None:
        """Register a plugin and return what is wrong with its hooks, if anything."""
        self._manager.register(plugin, name=name)
        hooks = [caller.name for caller in self._manager.get_hookcallers(plugin) or []]
        for hook in hooks:
            if hook not in HOOKS:
                return f"there is no hook {hook!r}; {did_you_mean(hook, HOOKS)}"
        self._manager.check_pending()
        unmarked = [hook for hook in HOOKS if hasattr(plugin, hook) and hook not in hooks]
        if unmarked:
            return f"{unmarked[0]} is not marked with @hookimpl"
        return None if hooks else f"it has none of the hooks {', '.join(HOOKS)}"

    def _report(self, origin: Origin, step: str, message: str) -> None:
        self._problems.append(Problem(origin, step, message))

    def _collect(self, kind: str, hook: str, spec_type: type[SpecT]) -> Catalogue[SpecT]:
        """Return the specs that all plugins declare; names that are offered twice are left out."""
        caller: pluggy.HookCaller = getattr(self._manager.hook, hook)
        problems = [problem for problem in self._problems if problem.step in ("load", "validate")]
        known = len(self._problems)
        offers: dict[str, list[tuple[Origin, SpecT]]] = {}
        for implementation in caller.get_hookimpls():
            origin = self._origins[implementation.plugin_name]
            for spec in self._call_hook(origin, implementation, hook, spec_type):
                offers.setdefault(spec.name, []).append((origin, spec))
        problems += self._problems[known:]
        specs: dict[str, SpecT] = {}
        origins: dict[str, Origin] = {}
        clashes: dict[str, tuple[Origin, ...]] = {}
        for name, owners in sorted(offers.items()):
            if len(owners) == 1:
                origins[name], specs[name] = owners[0]
                continue
            clashes[name] = tuple(origin for origin, _ in owners)
            for origin in clashes[name]:
                others = " and ".join(str(other) for other in clashes[name] if other != origin)
                self._report(origin, "duplicate", f"{kind} {name!r} is offered also by {others}")
        return Catalogue(kind, specs, origins, clashes, tuple(problems))

    def _call_hook(
        self,
        origin: Origin,
        implementation: pluggy.HookImpl,
        hook: str,
        spec_type: type[SpecT],
    ) -> list[SpecT]:
        """Return the specs that one plugin declares; a hook that fails half way declares none."""
        expected = spec_type.__name__
        try:
            returned = call_plugin(implementation.function)
            if isinstance(returned, str) or not isinstance(returned, Iterable):
                kind = type(returned).__name__
                self._report(origin, "declare", f"{hook} gave {kind}, not a list of {expected}")
                return []
            # a generator runs the plugin's code here
            declared: list[object] = call_plugin(lambda: list(returned))
        except PluginError as error:
            self._report(origin, "declare", f"{hook} raised {error}")
            return []
        wrong = {type(spec).__name__: None for spec in declared if not isinstance(spec, spec_type)}
        if wrong:
            message = f"{hook} gave {' and '.join(wrong)} where {expected} is expected"
            self._report(origin, "declare", message)
        return [spec for spec in declared if isinstance(spec, spec_type)]

    @cached_property
    def models(self) -> Catalogue[ModelSpec]:
        """Models of all plugins."""
        return self._collect("model", "tactibench_models", ModelSpec)

    @cached_property
    def sensors(self) -> Catalogue[SensorSpec]:
        """Sensors of all plugins."""
        return self._collect("sensor", "tactibench_sensors", SensorSpec)

    @cached_property
    def encoders(self) -> Catalogue[EncoderSpec]:
        """Encoders of all plugins."""
        return self._collect("encoder", "tactibench_encoders", EncoderSpec)

    @cached_property
    def commands(self) -> Catalogue[CommandSpec]:
        """Command-line verbs of all plugins."""
        return self._collect("command", "tactibench_commands", CommandSpec)

    @property
    def catalogues(self) -> tuple[Catalogue[Any], ...]:
        """Models, sensors and encoders: the kinds that a run is made of."""
        return self.models, self.sensors, self.encoders

    def catalogue(self, kind: str) -> Catalogue[Any]:
        """Return the catalogue of a kind: "model", "sensor" or "encoder"."""
        return next(catalogue for catalogue in self.catalogues if catalogue.kind == kind)

    @property
    def plugins(self) -> tuple[Origin, ...]:
        """Plugins that loaded, sorted by name."""
        return tuple(self._origins.values())

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Everything that went wrong, after calling all hooks of all plugins."""
        _ = *self.catalogues, self.commands
        return tuple(self._problems)


def open_sensor(
    name: str,
    context: SensorContext,
    given: Mapping[str, str],
    *,
    preferred: Mapping[str, str] | None = None,
) -> Sensor:
    """Build a sensor by name, such as that of another plugin. It is not entered yet.

    Args:
        name: Name of a sensor of any installed plugin.
        context: Seed and data folder.
        given: Parameters as on the command line.
        preferred: Parameters that are used where the sensor has them and ``given`` leaves them out.

    Raises:
        UserError: The name or a parameter is unknown, or a value is not allowed.
    """
    spec = PluginHost().sensors[name]
    names = {parameter.name for parameter in spec.parameters}
    texts = {key: value for key, value in (preferred or {}).items() if key in names}
    return spec.build(context, **spec.settings({**texts, **given}))


@dataclass(frozen=True)
class Place:
    """The line of a plugin's source that was running.

    Attributes:
        origin: The plugin.
        function: Name of the function.
        file: Path of the source.
        line: Number of the line.
    """

    origin: Origin
    function: str
    file: str
    line: int

    def __str__(self) -> str:
        return printable(f"{self.function} ({self.file}, line {self.line})")


class Owners:
    """The plugins that loaded, by the top-level modules that belong to them."""

    def __init__(self) -> None:
        points = [(point, origin) for point, origin in installed() if point.module in sys.modules]
        host = PluginHost(points)
        self._origins: dict[str, Origin] = {}
        for point, origin in points:
            self._origins.setdefault(_top_level(point.module), origin)
        for catalogue in (*host.catalogues, host.commands):
            for spec in catalogue:
                self._origins.setdefault(_top_level(spec.target), catalogue.origins[spec.name])

    def place_of_error(self, error: BaseException) -> Place | None:
        """Return the innermost line of a plugin that an exception passed; None: it passed none."""
        place = None
        trace: TracebackType | None = error.__traceback__
        while trace is not None:
            code = trace.tb_frame.f_code
            origin = self._origins.get(_top_level(trace.tb_frame.f_globals.get("__name__", "")))
            if origin is not None:
                place = Place(origin, code.co_qualname, code.co_filename, trace.tb_lineno)
            trace = trace.tb_next
        return place


def describe_failure(error: BaseException) -> str | None:
    """Return the sentence about an exception that a plugin raised; None: no plugin raised it.

    The sentence names the plugin, the exception, the file and the line.
    """
    place = Owners().place_of_error(error)
    if place is None:
        return None
    return (
        f"plugin {place.origin} raised {describe_exception(error).rstrip('.')} in {place}; fix or "
        "uninstall it (--debug shows the traceback)."
    )


def describe_method(subject: object, name: str) -> str:
    """Return a method of a plugin's object with its source: ``Net.predict (net.py, line 12)``."""
    kind = type(subject)
    code = getattr(inspect.unwrap(getattr(kind, name)), "__code__", None)
    source = "" if code is None else f" ({code.co_filename}, line {code.co_firstlineno})"
    return printable(f"{kind.__name__}.{name}{source}")


def _top_level(name: str) -> str:
    """Return the package of "package.module" and of "package.module:Class"."""
    return name.partition(":")[0].partition(".")[0]
