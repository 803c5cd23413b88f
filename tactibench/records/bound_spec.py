"""A spec with the values of its parameters: a model, sensor or encoder as a run uses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from tactibench.plugins.discovery import Origin
from tactibench.plugins.host import Catalogue
from tactibench.plugins.specs import EncoderSpec, ModelSpec, SensorSpec, Value
from tactibench.records.identity import code_hash, code_mentions
from tactibench.records.record import Component

REFERENCE_FRAMES = "reference_frames"
"""Folder of a plugin's package that makes reference frames. Models are tested on them and never
trained, so it is no part of the code behind whatever else is in the package."""

SpecT = TypeVar("SpecT", ModelSpec, SensorSpec, EncoderSpec)


@dataclass(frozen=True)
class BoundSpec(Generic[SpecT]):
    """A model, sensor or encoder with the values of its parameters and the plugin it is from."""

    spec: SpecT
    values: Mapping[str, Value]
    origin: Origin

    @classmethod
    def named(cls, catalogue: Catalogue[SpecT], name: str, given: Mapping[str, str]) -> Any:
        """Return the spec of a catalogue with some parameters given as texts.

        Raises:
            UserError: for an unknown name or parameter, or a value that is not allowed.
        """
        spec = catalogue[name]
        return cls(spec, spec.settings(given), catalogue.origins[name])

    @classmethod
    def of_record(cls, catalogue: Catalogue[SpecT], component: Component) -> Any:
        """Return the spec that a record names, as it was set. Raises UserError."""
        spec = catalogue[component.name]
        values = spec.settings_of_record(component.parameters)
        return cls(spec, values, catalogue.origins[spec.name])

    @property
    def name(self) -> str:
        """Return the name of the spec."""
        return self.spec.name

    @property
    def component(self) -> Component:
        """Return the name and values as a record holds them."""
        defaults = self.spec.defaults(self.values)
        settings = [name for name, value in self.values.items() if value != defaults[name]]
        return Component(name=self.name, parameters=dict(self.values), settings=settings)

    @property
    def label(self) -> str:
        """Return the name with the values that differ from their defaults: ``unet(width=8)``."""
        return self.component.label

    @property
    def package(self) -> str:
        """Return the import package that holds the class behind the spec."""
        return self.spec.target.partition(":")[0].partition(".")[0]

    def build(self, *context: Any) -> Any:
        """Import the class behind the spec and make an instance. Raises UserError."""
        return self.spec.load()(*context, **self.values)

    def code(self) -> str:
        """Return a hash of the source of the package. Raises UserError where there is none."""
        inside = self.spec.target.partition(":")[0].split(".")[1:2]
        without = frozenset() if inside == [REFERENCE_FRAMES] else frozenset({REFERENCE_FRAMES})
        try:
            return code_hash(self.package, without)
        except ModuleNotFoundError:
            self.spec.load()  # says in one sentence what does not load
            raise

    def mentions(self, *modules: str) -> bool:
        """Return whether the source of the package names one of the modules."""
        return code_mentions(self.package, modules)
