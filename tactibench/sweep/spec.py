"""The file of a sweep: its keys, the names in it, and the cells that it asks for."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
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
    ValidationError,
    model_validator,
)

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import ModelSpec, PluginHost
from tactibench.protocols import first_mistake, load_protocol
from tactibench.run import RunRequest, read_parameters, read_test_options

AXES = ("protocol", "model", "regime", "encoder", "sensor", "seed")
ANY = "*"
"""Key that stands for every other name in a table by name."""


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


def _as_table(value: Any) -> Any:
    return {ANY: value} if isinstance(value, str) else value


Text = Annotated[StrictStr, Field(min_length=1)]
Seed = Annotated[StrictInt, Field(ge=0)]
Count = Annotated[StrictInt, Field(ge=1)]
Texts = Annotated[tuple[Text, ...], BeforeValidator(_as_list)]
Seeds = Annotated[tuple[Seed, ...], BeforeValidator(_as_list)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Exclusion(_Strict):
    """Cells that are left out: those with one of the values on every axis that is named."""

    protocol: Texts = ()
    model: Texts = ()
    regime: Texts = ()
    encoder: Texts = ()
    sensor: Texts = ()
    seed: Seeds = ()

    @model_validator(mode="after")
    def _check_axes(self) -> Exclusion:
        if not self.model_fields_set:
            raise ValueError(f"name what is left out, by one or more of {', '.join(AXES)}")
        return self


class DatasetSpec(_Strict):
    """A data set to be pressed; the keys are the options of ``tactibench data generate``."""

    out: Text
    protocol: Text | None = None
    plan: Text | None = None
    sensor: Text | None = None
    params: Texts = ()
    count: Count | None = None
    seed: Seed | None = None


class SweepSpec(_Strict):
    """The keys of a sweep's file: one list per axis, and the settings of all cells.

    Attributes:
        device: One device for all cells, or a table by model ("*": any other model).
        data: One folder for all cells, or a table by protocol ("*": any other protocol).
    """

    protocol: Texts = ()
    model: Texts = ()
    regime: Texts = ()
    encoder: Texts = ()
    sensor: Texts = ()
    seed: Seeds = (0,)
    device: Annotated[dict[str, Literal["cpu", "cuda"]], BeforeValidator(_as_table)] = {ANY: "cpu"}
    data: Annotated[dict[str, Text], BeforeValidator(_as_table)] = {}
    params: Texts = ()
    test: Texts = ()
    quick: StrictBool = False
    limit: Count | None = None
    presses: Count | None = None
    exclude: Annotated[tuple[Exclusion, ...], BeforeValidator(_as_list)] = ()
    generate: Annotated[tuple[DatasetSpec, ...], BeforeValidator(_as_list)] = ()

    @model_validator(mode="after")
    def _check_content(self) -> SweepSpec:
        runs = bool(self.protocol or self.model)
        if not runs and not self.generate:
            raise ValueError(
                "nothing is asked for; name runs with 'protocol' and 'model', or data sets with "
                "[[generate]]"
            )
        for axis in ("protocol", "model") if runs else ():
            if not getattr(self, axis):
                raise ValueError(f"the key {axis!r} is missing; runs need 'protocol' and 'model'")
        if not self.seed:
            raise ValueError("the key 'seed' holds no seed; leave it out, or list one")
        return self


class _Parts(_Strict):
    """A file of several sweeps, each with keys of its own."""

    sweep: Annotated[tuple[SweepSpec, ...], Field(min_length=1, strict=False)]


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

    def error(self, text: str) -> UserError:
        """Return the error with this sentence about the file."""
        return UserError(f"sweep file {self.path}: {text}")


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

    @property
    def needs_gpu(self) -> bool:
        """True where the run asks for a graphics card."""
        return self.request.device == "cuda"


def read_sweep(path: Path) -> SweepFile:
    """Read and validate a sweep's file.

    Raises:
        UserError: The file cannot be read, or a key is wrong.
    """
    try:
        tables = tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise UserError(f"sweep file {path} does not exist; check the path.") from None
    except IsADirectoryError:
        raise UserError(f"sweep file {path} is a folder; name the .toml file.") from None
    except OSError as error:
        raise UserError(f"sweep file {path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, RecursionError) as error:  # TOML's and Unicode's errors are ValueErrors
        raise UserError(f"sweep file {path} is not valid TOML: {error}.") from None
    schema = _Parts if "sweep" in tables else SweepSpec
    try:
        if "sweep" in tables:
            return SweepFile(path, _Parts.model_validate(tables).sweep)
        return SweepFile(path, (SweepSpec.model_validate(tables),))
    except ValidationError as error:
        raise UserError(f"sweep file {path}: {first_mistake(error, schema)}") from None


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
        UserError: A name does not exist, an exclusion names a value that is not in the lists or
            leaves out no cell, or no cell of a sweep is left.
    """
    cells: list[Cell] = []
    for number, spec in enumerate(file.parts, start=1):
        where = f"sweep {number}: " if len(file.parts) > 1 else ""
        try:
            _check_names(file, spec, host)
            combinations = list(_combinations(spec, host))
            _check_exclusions(spec, combinations)
            part_cells = [
                Cell(axes, _request(file, spec, axes, host))
                for axes in combinations
                if not any(_is_excluded(axes, exclusion) for exclusion in spec.exclude)
            ]
        except UserError as error:
            raise file.error(f"{where}{error}") from None
        if (spec.protocol or spec.model) and not part_cells:
            raise file.error(f"{where}the exclusions leave no cell; exclude less.")
        requests = [cell.request for cell in cells]
        cells += [cell for cell in part_cells if cell.request not in requests]
    return tuple(cells)


def resolve_protocol(file: SweepFile, text: str) -> str:
    """Return the name of a protocol, or the absolute path of its file."""
    return str(file.resolve(text)) if text.endswith(".toml") else text


def _combinations(spec: SweepSpec, host: PluginHost) -> Iterator[Mapping[str, str]]:
    for protocol, model in product(dict.fromkeys(spec.protocol), dict.fromkeys(spec.model)):
        encoders = _encoders(spec.encoder, host.models[read_choice(model).name], host)
        lists = (spec.regime or ("",), encoders, spec.sensor or ("",), spec.seed)
        for values in product([protocol], [model], *(dict.fromkeys(names) for names in lists)):
            yield {axis: str(value) for axis, value in zip(AXES, values, strict=True)}


def _encoders(names: Iterable[str], model: ModelSpec, host: PluginHost) -> tuple[str, ...]:
    """Return the encoders whose maps the model can learn; "", its default, where there is none."""
    if not model.uses_encoder:
        return ("",)
    usable = [
        text for text in names if host.encoders[read_choice(text).name].kind in model.encoders
    ]
    return tuple(usable) or ("",)


def _is_excluded(axes: Mapping[str, str], exclusion: Exclusion) -> bool:
    return all(
        axes[axis] in map(str, getattr(exclusion, axis)) for axis in exclusion.model_fields_set
    )


def _request(
    file: SweepFile, spec: SweepSpec, axes: Mapping[str, str], host: PluginHost
) -> RunRequest:
    model, encoder, sensor = (read_choice(axes[kind]) for kind in ("model", "encoder", "sensor"))
    common = read_parameters(spec.params)
    choices = {"model": model, "encoder": encoder, "sensor": sensor}
    if not host.models[model.name].uses_encoder:
        common.pop("encoder", None)
    parameters = {
        kind: {**common.get(kind, {}), **choice.parameters} for kind, choice in choices.items()
    }
    data = spec.data.get(axes["protocol"], spec.data.get(ANY))
    test = read_test_options(spec.test)
    if test.data is not None:
        test = replace(test, data=file.resolve(str(test.data)))
    device = spec.device.get(axes["model"], spec.device.get(model.name, spec.device.get(ANY)))
    return RunRequest(
        resolve_protocol(file, axes["protocol"]),
        model.name,
        regime=axes["regime"] or None,
        sensor=sensor.name or None,
        encoder=encoder.name or None,
        data=None if data is None else file.resolve(data),
        seed=int(axes["seed"]),
        device=device or "cpu",
        parameters={kind: values for kind, values in parameters.items() if values},
        quick=spec.quick,
        limit=spec.limit,
        presses=spec.presses,
        test=test,
    )


def _check_names(file: SweepFile, spec: SweepSpec, host: PluginHost) -> None:
    """Raise UserError where a name or a parameter does not exist."""
    regimes: dict[str, None] = {}
    for text in spec.protocol:
        loaded = load_protocol(resolve_protocol(file, text))
        regimes |= dict.fromkeys(loaded.spec.regimes)
    for catalogue, texts in (
        (host.models, spec.model),
        (host.encoders, spec.encoder),
        (host.sensors, spec.sensor),
    ):
        for choice in map(read_choice, texts):
            plugin: Any = catalogue[choice.name]
            plugin.settings(choice.parameters)
    for regime in spec.regime:
        if regime not in regimes:
            raise UserError(f"no protocol has a regime {regime!r}; {did_you_mean(regime, regimes)}")
    models = {*spec.model, *(read_choice(text).name for text in spec.model), ANY}
    for key, table, allowed in (
        ("device", spec.device, models),
        ("data", spec.data, {*spec.protocol, ANY}),
    ):
        for name in table:
            if name not in allowed:
                raise UserError(f"key '{key}.{name}': {did_you_mean(name, allowed)}")


def _check_exclusions(spec: SweepSpec, combinations: Iterable[Mapping[str, str]]) -> None:
    """Raise UserError where an exclusion names a value that is not listed, or leaves out no cell.

    Either is a misprint: its author expects fewer cells than would be run.

    Args:
        spec: The keys of the sweep.
        combinations: Axis -> value, of every cell before any is left out.
    """
    for number, exclusion in enumerate(spec.exclude, start=1):
        for axis in AXES:
            listed = [str(value) for value in getattr(spec, axis)]
            for value in map(str, getattr(exclusion, axis)):
                if value not in listed:
                    near = did_you_mean(value, listed) if listed else f"there is no list {axis!r}."
                    raise UserError(f"key 'exclude.{number}.{axis}' names {value!r}; {near}")
        if not any(_is_excluded(axes, exclusion) for axes in combinations):
            raise UserError(
                f"key 'exclude.{number}' leaves out no cell, because none has its values together; "
                "change a value, or delete it."
            )
