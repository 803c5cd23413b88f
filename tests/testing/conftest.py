"""The good examples are what ``tactibench new`` writes; a test breaks them in one place."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import pytest

from tactibench import EncoderSpec, ModelSpec, SensorSpec
from tactibench.plugins import Catalogue, Origin
from tactibench.scaffold import Names, write_package

ORIGIN = Origin("good", "tactibench-good", "0.1.0")


@dataclass(frozen=True)
class _Local:
    """A spec whose class is at hand."""

    local: Any = field(default=None, kw_only=True)

    def load(self) -> Any:
        return self.local or super().load()  # type: ignore[misc]


@dataclass(frozen=True)
class LocalModel(_Local, ModelSpec): ...


@dataclass(frozen=True)
class LocalSensor(_Local, SensorSpec): ...


@dataclass(frozen=True)
class LocalEncoder(_Local, EncoderSpec): ...


LOCAL = {"model": LocalModel, "sensor": LocalSensor, "encoder": LocalEncoder}


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Kind -> the spec of a new plugin of that kind, importable."""
    folder, specs = tmp_path_factory.mktemp("made"), {}
    for kind in LOCAL:
        package = write_package(Names(kind, f"good_{kind}"), folder)
        sys.path.insert(0, str(package))
        hooks = importlib.import_module(f"tactibench_good_{kind}.hooks")
        (specs[kind],) = getattr(hooks, f"tactibench_{kind}s")()
    yield specs
    sys.path[:] = [path for path in sys.path if not path.startswith(str(folder))]
    for name in [name for name in sys.modules if name.startswith("tactibench_good_")]:
        del sys.modules[name]


def catalogue(kind: str, *specs: Any) -> Catalogue[Any]:
    names = {spec.name: spec for spec in specs}
    return Catalogue(kind, names, dict.fromkeys(names, ORIGIN), {})


@pytest.fixture
def host(made: dict[str, Any]) -> Callable[..., Any]:
    """A host of the good plugins, one of which has another class or declaration.

    The good sensor stands under the name of the protocol's default one, too.
    """

    def with_one(kind: str = "", local: Any = None, **fields: Any) -> Any:
        specs = dict(made)
        if kind:
            known = {name: getattr(made[kind], name) for name in made[kind].__dataclass_fields__}
            specs[kind] = LOCAL[kind](**{**known, **fields}, local=local)
        small = [
            replace(p, default=48) if p.name == "size" else p for p in specs["sensor"].parameters
        ]
        default = replace(specs["sensor"], name="tactip-127", parameters=tuple(small))
        catalogues = {
            "models": catalogue("model", specs["model"]),
            "sensors": catalogue("sensor", specs["sensor"], default),
            "encoders": catalogue("encoder", specs["encoder"]),
        }
        return SimpleNamespace(
            **catalogues,
            catalogues=tuple(catalogues.values()),
            catalogue=lambda kind: catalogues[f"{kind}s"],
            problems=(),
        )

    return with_one


@pytest.fixture
def target(made: dict[str, Any]) -> Callable[[str], Any]:
    """Kind -> the good class of it."""
    return lambda kind: made[kind].load()
