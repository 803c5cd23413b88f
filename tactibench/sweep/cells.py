"""The cells of a sweep: every combination of its lists that is not excluded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.plugins.specs import ModelSpec
from tactibench.run.request import RunRequest, read_parameters, read_tested
from tactibench.sweep.keys import ANY, AXES, Exclusion
from tactibench.sweep.names import check_exclusions, check_names, named, protocol_of
from tactibench.sweep.read import SweepFile

Axes = Mapping[str, str]
"""Axis -> value as the file has it, "" where it names none."""


@dataclass(frozen=True, eq=False)
class Cell:
    """One run that is asked for, and its place in the sweep. No two are equal."""

    axes: Axes
    request: RunRequest

    @property
    def label(self) -> str:
        """ "exp2 unet, width=32 multiple seed 1"."""
        words = [self.axes[axis] for axis in AXES if axis != "seed" and self.axes[axis]]
        return " ".join([*words, f"seed {self.axes['seed']}"])

    @property
    def needs_gpu(self) -> bool:
        return self.request.device == "cuda"


def cells_of(file: SweepFile, host: PluginHost) -> tuple[Cell, ...]:
    """All cells, in the order of the lists. Raises UserError for a name that does not exist.

    Whether a model can be trained so is asked when the cell is planned.
    """
    keys = file.keys
    try:
        check_names(file, host)
        found = [axes for axes in _combinations(file, host) if not _excluded(axes, keys.exclude)]
        check_exclusions(file)
        cells = tuple(Cell(axes, _request(file, axes, host)) for axes in found)
    except UserError as error:
        raise file.mistake(str(error)) from None
    if (keys.protocol or keys.model) and not cells:
        raise file.mistake("the exclusions leave no cell; exclude less.")
    return cells


def _combinations(file: SweepFile, host: PluginHost) -> Iterator[Axes]:
    keys = file.keys
    for protocol, model in product(dict.fromkeys(keys.protocol), dict.fromkeys(keys.model)):
        encoders = _encoders(keys.encoder, host.models[named(model).name], host)
        lists = (keys.regime or ("",), encoders, keys.sensor or ("",), keys.seed)
        for values in product([protocol], [model], *(dict.fromkeys(one) for one in lists)):
            yield {axis: str(value) for axis, value in zip(AXES, values, strict=True)}


def _encoders(asked: Iterable[str], model: ModelSpec, host: PluginHost) -> tuple[str, ...]:
    """The encoders of the list whose maps the model learns; its own where none is."""
    if not model.uses_encoder:
        return ("",)
    fits = [text for text in asked if host.encoders[named(text).name].kind in model.encoders]
    return tuple(fits) or ("",)


def _excluded(axes: Axes, exclusions: Iterable[Exclusion]) -> bool:
    return any(
        all(axes[axis] in map(str, getattr(one, axis)) for axis in one.model_fields_set)
        for one in exclusions
    )


def _request(file: SweepFile, axes: Axes, host: PluginHost) -> RunRequest:
    keys = file.keys
    model, encoder, sensor = (named(axes[kind]) for kind in ("model", "encoder", "sensor"))
    common = read_parameters(keys.params)
    own = {"model": model.settings, "encoder": encoder.settings, "sensor": sensor.settings}
    if not host.models[model.name].uses_encoder:
        common.pop("encoder", None)
    given = {kind: {**common.get(kind, {}), **values} for kind, values in own.items()}
    data = keys.data.get(axes["protocol"], keys.data.get(ANY))
    tested = read_tested(keys.test)
    if tested.data is not None:
        tested = replace(tested, data=file.inside(str(tested.data)))
    return RunRequest(
        protocol_of(file, axes["protocol"]),
        model.name,
        regime=axes["regime"] or None,
        sensor=sensor.name or None,
        encoder=encoder.name or None,
        data=None if data is None else file.inside(data),
        seed=int(axes["seed"]),
        device=keys.device.get(axes["model"], keys.device.get(model.name, keys.device.get(ANY)))
        or "cpu",
        parameters={kind: values for kind, values in given.items() if values},
        quick=keys.quick,
        limit=keys.limit,
        presses=keys.presses,
        tested=tested,
    )
