"""The guarded plugin host: one thin object, and one broken plugin never stops the others."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint
from types import FrameType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import pluggy

from tactibench.errors import PluginError, UserError, call_plugin, did_you_mean
from tactibench.plugins import hookspecs
from tactibench.plugins.alarm import alarm
from tactibench.plugins.discovery import Origin, installed
from tactibench.plugins.specs import CommandSpec, EncoderSpec, ModelSpec, SensorSpec

if TYPE_CHECKING:
    from tactibench.plugins.base import Sensor, SensorContext

SpecT = TypeVar("SpecT", ModelSpec, SensorSpec, EncoderSpec, CommandSpec)

T = TypeVar("T")

VARIABLE = "TACTIBENCH_HOOK_SECONDS"
LIMIT_S = 30.0
"""Seconds that a plugin may take to be imported, and each of its hooks to answer. Hooks are light
and take milliseconds; one that imports torch from a cold network drive takes ten seconds."""
AGAIN_S = 5.0
"""Seconds after which the process ends where a plugin caught the exception of its time limit."""
MISTAKE = 2

HOOKS = tuple(name for name in vars(hookspecs) if name.startswith(f"{hookspecs.GROUP}_"))


@dataclass(frozen=True)
class Problem:
    """A mistake of a plugin, in the step "load", "validate", "declare" or "duplicate"."""

    origin: Origin
    step: str
    message: str


@dataclass(frozen=True)
class Catalogue(Generic[SpecT]):
    """Declared specs of one kind, sorted by name, each with the plugin it came from.

    Attributes:
        kind: "model", "sensor", "encoder" or "command".
        specs: Name -> spec; names that two plugins offer are left out.
        origins: Name -> plugin, for the names in ``specs``.
        clashes: Name -> the plugins that all offer it.
    """

    kind: str
    specs: Mapping[str, SpecT]
    origins: Mapping[str, Origin]
    clashes: Mapping[str, tuple[Origin, ...]]

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
            raise UserError(f"unknown {self.kind} {name!r}; {did_you_mean(name, self.specs)}")
        return self.specs[name]


class PluginHost:
    """Loads the entry points of group ``tactibench`` one by one under a guard.

    Every exception of a plugin becomes a `Problem`, see ``call_plugin``, and so does code that does
    not end, see ``time_limit``.
    """

    def __init__(
        self,
        points: Iterable[tuple[EntryPoint, Origin]] | None = None,
        *,
        limit_s: float | None = None,
    ) -> None:
        """Load plugins.

        Args:
            points: Entry points and their distributions; None: all installed.
            limit_s: Seconds that each step may take; None: ``TACTIBENCH_HOOK_SECONDS``, or 30.

        Raises:
            UserError: ``TACTIBENCH_HOOK_SECONDS`` is not a number of seconds above 0.
        """
        self._limit_s = _limit() if limit_s is None else limit_s
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
            plugin = self._call(origin, "its import", point.load)
        except PluginError as error:
            self._report(origin, "load", str(error))
            return
        try:
            mistake = self._call(origin, "its check", lambda: self._register(plugin, name))
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

    def _call(self, origin: Origin, step: str, function: Callable[[], T]) -> T:
        """Return the result of a plugin's function.

        Raises:
            PluginError: The function raises, or does not end within the time limit.
        """

        def call() -> T:
            with time_limit(self._limit_s, f"plugin {origin}: {step}"):
                return function()

        return call_plugin(call)

    def _report(self, origin: Origin, step: str, message: str) -> None:
        self._problems.append(Problem(origin, step, message))

    def _collect(self, kind: str, hook: str, spec_type: type[SpecT]) -> Catalogue[SpecT]:
        """Return the specs that all plugins declare; names that are offered twice are left out."""
        caller: pluggy.HookCaller = getattr(self._manager.hook, hook)
        offers: dict[str, list[tuple[Origin, SpecT]]] = {}
        for implementation in caller.get_hookimpls():
            origin = self._origins[implementation.plugin_name]
            for spec in self._call_hook(origin, implementation, hook, spec_type):
                offers.setdefault(spec.name, []).append((origin, spec))
        specs: dict[str, SpecT] = {}
        origins: dict[str, Origin] = {}
        clashes: dict[str, tuple[Origin, ...]] = {}
        for name, owners in sorted(offers.items()):
            if len(owners) == 1:
                origins[name], specs[name] = owners[0]
                continue
            clashes[name] = tuple(origin for origin, _ in owners)
            for origin in dict.fromkeys(clashes[name]):
                others = [str(o) for o in dict.fromkeys(clashes[name]) if o != origin]
                by = f"also by {' and '.join(others)}" if others else "twice"
                self._report(origin, "duplicate", f"{kind} {name!r} is offered {by}")
        return Catalogue(kind, specs, origins, clashes)

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
            returned = self._call(origin, hook, implementation.function)
            if isinstance(returned, str) or not isinstance(returned, Iterable):
                kind = type(returned).__name__
                self._report(origin, "declare", f"{hook} gave {kind}, not a list of {expected}")
                return []
            # a generator runs the plugin's code here
            declared: list[object] = self._call(origin, hook, lambda: list(returned))
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


class HookTimeoutError(BaseException):
    """Code of a plugin did not end in time.

    It does not inherit from Exception, which the plugin might catch.
    """


@contextmanager
def time_limit(seconds: float, what: str) -> Iterator[None]:
    """Raise HookTimeoutError inside the block when it takes longer.

    A block that catches the exception and goes on ends the process with a sentence. See ``alarm``
    for where there is no limit.

    Args:
        seconds: How long the block may take, s.
        what: Words for the block in that sentence.
    """
    caught = False

    def stop(frame: FrameType | None) -> None:
        nonlocal caught
        late = f"did not end within {seconds:g} s, stopped in {_place(frame)}"
        longer = f"set {VARIABLE} to wait longer"
        if caught:
            text = f"tactibench: {what} {late}, and went on; uninstall it, or {longer}.\n"
            os.write(2, text.encode("utf-8", "replace"))
            os._exit(MISTAKE)
        caught = True
        raise HookTimeoutError(f"it {late}; {longer}")

    with alarm("wall", seconds, stop, again_s=AGAIN_S):
        yield


def _limit() -> float:
    """Return the time limit of a step, s.

    Raises:
        UserError: ``TACTIBENCH_HOOK_SECONDS`` is not a number of seconds above 0.
    """
    text = os.environ.get(VARIABLE, "")
    try:
        seconds = float(text or LIMIT_S)
    except ValueError:
        seconds = 0.0
    if not 0 < seconds < threading.TIMEOUT_MAX:  # False for NaN, too
        raise UserError(f"{VARIABLE} is {text!r}; give a number of seconds above 0.")
    return seconds


def _place(frame: FrameType | None) -> str:
    """Return file and line of the innermost frame that is not of the standard library."""
    inner = frame
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] not in sys.stdlib_module_names:
            inner = frame
            break
        frame = frame.f_back
    if inner is None:
        return "an unknown place"
    return f"{inner.f_code.co_filename}, line {inner.f_lineno}"


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
    values = spec.settings({**texts, **given})  # before anything heavy is imported
    return spec.load()(context, **values)
