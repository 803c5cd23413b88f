"""The file of a sweep: its keys, the names in it, and the cells that it asks for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    StrictStr,
)

from tactibench.errors import UserError, read_file
from tactibench.plugins import PluginHost
from tactibench.protocols import load_protocol, parse_toml
from tactibench.run import RunRequest, read_parameters, read_test_options

AXES = ("protocol", "model", "regime", "encoder", "sensor", "seed")


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


Text = Annotated[StrictStr, Field(min_length=1)]
Seed = Annotated[StrictInt, Field(ge=0)]
Count = Annotated[StrictInt, Field(ge=1)]
Texts = Annotated[tuple[Text, ...], BeforeValidator(_as_list)]
Seeds = Annotated[tuple[Seed, ...], BeforeValidator(_as_list)]


class _Axes(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    protocol: Texts = ()
    model: Texts = ()
    regime: Texts = ()
    encoder: Texts = ()
    sensor: Texts = ()
    seed: Seeds = ()


class Exclusion(_Axes):
    """Cells that are left out: those with one of the values on every axis that is named."""

    def excludes(self, axes: Mapping[str, str]) -> bool:
        """Return whether a cell is left out."""
        return all(axes[axis] in map(str, getattr(self, axis)) for axis in self.model_fields_set)


class SweepSpec(_Axes):
    """The keys of a sweep: one list per axis, and the settings of all cells."""

    protocol: Annotated[Texts, Field(min_length=1)]
    model: Annotated[Texts, Field(min_length=1)]
    seed: Annotated[Seeds, Field(min_length=1)] = (0,)
    device: Literal["cpu", "cuda"] = "cpu"
    data: Text | None = None
    params: Texts = ()
    test: Texts = ()
    quick: StrictBool = False
    limit: Count | None = None
    presses: Count | None = None
    exclude: Annotated[tuple[Exclusion, ...], BeforeValidator(_as_list)] = ()


class _File(BaseModel):
    """A file of several sweeps, each with keys of its own."""

    model_config = ConfigDict(extra="forbid")

    sweep: tuple[SweepSpec, ...]


@dataclass(frozen=True)
class SweepFile:
    """A sweep's file and its valid keys; paths in it begin at the file's folder.

    Attributes:
        path: Path of the file.
        parts: The sweeps in it: one, or those of its tables ``[[sweep]]``.
    """

    path: Path
    parts: tuple[SweepSpec, ...]

    def resolve(self, text: str) -> Path:
        """Return a path in the file as an absolute one: workers have other working folders."""
        return (self.path.parent / Path(text).expanduser()).resolve()


@dataclass(frozen=True)
class PluginChoice:
    """A plugin and its parameters, written as "unet, width=32"."""

    name: str
    parameters: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Cell:
    """One run of a sweep. No two cells are equal.

    Attributes:
        axes: Axis -> value as written in the file, "" where the file names none.
        request: The run.
    """

    axes: Mapping[str, str]
    request: RunRequest

    @property
    def label(self) -> str:
        """Short name, such as "exp2 unet, width=32 multiple seed 1"."""
        values = [self.axes[axis] for axis in AXES if axis != "seed" and self.axes[axis]]
        return " ".join([*values, f"seed {self.axes['seed']}"])


def read_sweep(path: Path) -> SweepFile:
    """Read and validate a sweep's file.

    Raises:
        UserError: The file cannot be read, or a key is wrong.
    """
    content, where = read_file(path, "sweep file"), f"sweep file {path}"
    if b"[[sweep]]" in content:
        return SweepFile(path, parse_toml(content, _File, where).sweep)
    return SweepFile(path, (parse_toml(content, SweepSpec, where),))


def read_choice(text: str) -> PluginChoice:
    """Return the plugin of "NAME" or "NAME, KEY=VALUE, ...".

    Raises:
        UserError: The text has another form, or sets a parameter twice.
    """
    name, *settings = (part.strip() for part in text.split(","))
    parameters = {}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if not equals or not key:
            raise UserError(f"{text!r} is not understood; write NAME, KEY=VALUE, ...")
        if key in parameters:
            raise UserError(f"{text!r} sets {key} twice; set it once.")
        parameters[key] = value
    return PluginChoice(name, parameters)


def list_cells(file: SweepFile, host: PluginHost) -> tuple[Cell, ...]:
    """Return every combination of the lists that is not excluded, in the order of the lists.

    A run that several sweeps of the file ask for is one cell. Whether a model can be trained in
    this way is found out when the cell is planned.

    Raises:
        UserError: A name does not exist, an exclusion leaves out no cell, or no cell of a sweep is
            left.
    """
    cells: list[Cell] = []
    for number, spec in enumerate(file.parts, start=1):
        try:
            wanted = [Cell(axes, _request(file, spec, axes)) for axes in _axes(file, spec, host)]
        except UserError as error:
            where = f"sweep {number}: " if len(file.parts) > 1 else ""
            raise UserError(f"sweep file {file.path}: {where}{error}") from None
        requests = [cell.request for cell in cells]
        cells += [cell for cell in wanted if cell.request not in requests]
    return tuple(cells)


def _axes(file: SweepFile, spec: SweepSpec, host: PluginHost) -> list[Mapping[str, str]]:
    """Return axis -> value of the cells of a sweep that are not excluded."""
    for text in spec.protocol:
        load_protocol(_protocol(file, text))
    for kind in ("model", "encoder", "sensor"):
        for choice in map(read_choice, getattr(spec, kind)):
            host.catalogue(kind)[choice.name].settings(choice.parameters)
    combinations = list(_combinations(spec, host))
    for number, exclusion in enumerate(spec.exclude, start=1):
        if not exclusion.model_fields_set or not any(map(exclusion.excludes, combinations)):
            raise UserError(
                f"key 'exclude.{number}' leaves out no cell, because none has its values together; "
                "change a value, or delete it."
            )
    left = [
        axes
        for axes in combinations
        if not any(exclusion.excludes(axes) for exclusion in spec.exclude)
    ]
    if not left:
        raise UserError("the exclusions leave no cell; exclude less.")
    return left


def _combinations(spec: SweepSpec, host: PluginHost) -> Iterator[Mapping[str, str]]:
    """Yield axis -> value of every cell; an encoder is for models that learn its kind of maps."""
    for protocol, text in product(dict.fromkeys(spec.protocol), dict.fromkeys(spec.model)):
        model = host.models[read_choice(text).name]
        kinds = model.encoders if model.uses_encoder else ()
        encoders = [e for e in spec.encoder if host.encoders[read_choice(e).name].kind in kinds]
        lists = (spec.regime or ("",), encoders or ("",), spec.sensor or ("",), spec.seed)
        for values in product([protocol], [text], *(dict.fromkeys(names) for names in lists)):
            yield {axis: str(value) for axis, value in zip(AXES, values, strict=True)}


def _protocol(file: SweepFile, text: str) -> str:
    """Return the name of a protocol, or the absolute path of its file."""
    return str(file.resolve(text)) if text.endswith(".toml") else text


def _request(file: SweepFile, spec: SweepSpec, axes: Mapping[str, str]) -> RunRequest:
    choices = {kind: read_choice(axes[kind]) for kind in ("model", "encoder", "sensor")}
    common = read_parameters(spec.params)
    if not choices["encoder"].name:
        common.pop("encoder", None)
    parameters = {
        kind: {**common.get(kind, {}), **choice.parameters} for kind, choice in choices.items()
    }
    test = read_test_options(spec.test)
    if test.data is not None:
        test = replace(test, data=file.resolve(str(test.data)))
    return RunRequest(
        _protocol(file, axes["protocol"]),
        choices["model"].name,
        regime=axes["regime"] or None,
        sensor=choices["sensor"].name or None,
        encoder=choices["encoder"].name or None,
        data=None if spec.data is None else file.resolve(spec.data),
        seed=int(axes["seed"]),
        device=spec.device,
        parameters={kind: values for kind, values in parameters.items() if values},
        quick=spec.quick,
        limit=spec.limit,
        presses=spec.presses,
        test=test,
    )
