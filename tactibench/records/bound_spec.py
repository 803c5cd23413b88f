"""A spec with the values of its parameters: a model, sensor or encoder as a run uses it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from tactibench.plugins import Catalogue, EncoderSpec, ModelSpec, Origin, SensorSpec, Value
from tactibench.records.identity import code_hash, code_mentions, combined, outside_packages
from tactibench.records.record import Component

SpecT = TypeVar("SpecT", ModelSpec, SensorSpec, EncoderSpec)


@dataclass(frozen=True)
class BoundSpec(Generic[SpecT]):
    """A model, sensor or encoder with the values of its parameters and the plugin it is from.

    Attributes:
        spec: Spec of the model, sensor or encoder.
        values: Value of every parameter.
        origin: Plugin that the spec is from.
    """

    spec: SpecT
    values: Mapping[str, Value]
    origin: Origin

    @classmethod
    def named(cls, catalogue: Catalogue[SpecT], name: str, given: Mapping[str, str]) -> Any:
        """Return the spec of a catalogue with some parameters given as texts.

        Raises:
            UserError: The name or a parameter is unknown, or a value is not allowed.
        """
        spec = catalogue[name]
        return cls(spec, spec.settings(given), catalogue.origins[name])

    @classmethod
    def of_record(cls, catalogue: Catalogue[SpecT], component: Component) -> Any:
        """Return the spec that a record names, with the settings of that record.

        Raises:
            UserError: The catalogue does not hold the name, or a parameter or value of the record
                is not allowed.
        """
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
        """Import the class behind the spec and make an instance.

        Raises:
            UserError: The class cannot be used.
        """
        return self.spec.build(*context, **self.values)

    def code(self) -> str:
        """Return a hash of the source of the package, and of what it imports from outside.

        Raises:
            UserError: The package of the spec cannot be imported.
        """
        try:
            own = code_hash(self.package)
            outside: tuple[str, ...] = outside_packages(self.package)
            return combined([own, *(code_hash(name) for name in outside)]) if outside else own
        except ModuleNotFoundError:
            self.spec.load()  # says in one sentence what does not load
            raise

    def mentions(self, *modules: str) -> bool:
        """Return whether the source of the package names one of the modules."""
        return code_mentions(self.package, modules)
