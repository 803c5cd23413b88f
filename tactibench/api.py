"""tactibench in Python: run, score, compare, load runs and boards as frames, and draw figures.

The command line calls the same functions. They return typed results and print nothing; a mistake
raises ``UserError`` with one sentence. Frames are pandas data frames in long form: a row a number.

    from tactibench import api

    run = api.run("exp1", "nearest", quick=True)
    run.value("mae_mm", "mean")
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from tactibench.errors import UserError, did_you_mean
from tactibench.records import STORE, StoredRun, held_name, open_run, stored_runs, unscored_run
from tactibench.shipped import default_board

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from tactibench.board import Comparison, Placement
    from tactibench.contacts import Answer, Frame, Signal
    from tactibench.plugins import Model
    from tactibench.report import PlotData
    from tactibench.run import Reporter, RunPlan

__all__ = [
    "Comparisons",
    "Plot",
    "Score",
    "StoredRun",
    "TrainedModel",
    "compare",
    "load_board",
    "load_model",
    "load_run",
    "load_runs",
    "place",
    "plan",
    "plot",
    "plot_limit",
    "render",
    "run",
    "score",
]

PLOTS = ("frontier", "curve", "stability")
"""Kinds of figures of ``plot``."""


def plan(
    protocol: str | Path,
    model: str,
    *,
    regime: str | None = None,
    sensor: str | None = None,
    encoder: str | None = None,
    data: str | Path | None = None,
    seed: int = 0,
    device: str = "auto",
    params: Mapping[str, Any] | Sequence[str] = (),
    quick: bool = False,
    limit: int | None = None,
    presses: int | None = None,
    test: Sequence[str] = (),
    hidden_seed: bool = False,
    published: str | Path | None = None,
    runner: str | None = None,
    store: str | Path = STORE,
) -> RunPlan:
    """Return the plan of a run; nothing is generated or trained.

    Args:
        protocol: Name of a protocol, such as "exp2", or its .toml file.
        model: Name of a model; "mean" and "nearest" are baselines.
        regime: Name of the training regime, which determines the training frames; None for the
            protocol's first.
        sensor: Name of the sensor that makes the frames; None for the protocol's.
        encoder: Name of the heatmap encoder, for models that use one.
        data: Folder of recorded frames.
        seed: Seed of the training.
        device: "auto", "cpu" or "cuda".
        params: Parameters, as {"model.width": 32} or as texts "model.width=32".
        quick: Whether to run with 200 presses, 2 epochs and 40 tests, to prove only that it works.
        limit: Most test presses that are scored.
        presses: Number of presses to learn from, for a learning curve; None for all.
        test: Sensor and presses of the test, where they are not those of the training: "reference",
            "sensor.instance=1", "shots=50", "data=FOLDER".
        hidden_seed: Whether to test on presses drawn from the secret seed in
            TACTIBENCH_HIDDEN_SEED.
        published: File of published answers to the test frames.
        runner: Command that starts the process in which the model answers, "" for this Python;
            None: it answers in this process, except to hidden presses.
        store: Folder of the run store.

    Raises:
        UserError: Something does not exist or does not fit.
    """
    from tactibench.records import cache_folder
    from tactibench.run import (
        RunRequest,
        make_plan,
        plugin_host,
        read_parameters,
        read_test_options,
    )

    request = RunRequest(
        str(protocol),
        model,
        regime=regime,
        sensor=sensor,
        encoder=encoder,
        data=None if data is None else Path(data),
        seed=seed,
        device=device,
        parameters=read_parameters(_texts(params)),
        quick=quick,
        limit=limit,
        presses=presses,
        test=read_test_options(tuple(test), hidden=hidden_seed),
        published=None if published is None else Path(published),
        runner=runner,
    )
    return make_plan(request, plugin_host(request), cache_folder(), store=Path(store))


def run(
    protocol: str | Path,
    model: str,
    *,
    fresh: bool = False,
    progress: Reporter | bool = True,
    **options: Any,
) -> StoredRun:
    """Run a protocol with a model and return its stored run.

    Frames and weights are cached; a run that is in the store is returned as it is.

    Args:
        protocol: Name of a protocol, such as "exp2", or its .toml file.
        model: Name of a model.
        fresh: Whether to make everything anew: frames, weights, answers and times.
        progress: Whether to show progress on stderr, or a reporter that shows it.
        **options: Options of ``plan``: regime, sensor, seed, params, quick, store and so on.

    Raises:
        UserError: Something does not exist or does not fit, or the model answers something else
            than it declared.
    """
    from tactibench.run import execute

    return execute(plan(protocol, model, **options), _reporter(progress), fresh=fresh)


@dataclass(frozen=True, repr=False)
class TrainedModel:
    """A model with its weights.

    Attributes:
        model: The model.
        label: Its name with the parameters that differ from the defaults.
    """

    model: Model
    label: str

    def __repr__(self) -> str:
        return f"TrainedModel({self.label})"

    def predict(self, signal: Frame | Signal, rest: Signal | None = None) -> Answer | None:
        """Return the answer to one frame, such as contacts with ``xy`` and ``depth`` in mm.

        None where the model gives none.

        Args:
            signal: A frame, as of ``render``; or an image (H, W) uint8, or channels.
            rest: Signal of the sensor that nothing touches; models of pins need it. A frame has
                its own.
        """
        from tactibench.contacts import Frame, Pose

        frame = signal if isinstance(signal, Frame) else Frame(signal, 0.0, Pose(), rest)
        return self.model.predict([frame])[0]


def load_model(
    name: str | Path,
    protocol: str | Path = "exp1",
    *,
    params: Mapping[str, Any] | Sequence[str] = (),
    sensor: str | None = None,
    data: str | Path | None = None,
    quick: bool = False,
) -> TrainedModel:
    """Return a trained model, to predict with.

    Args:
        name: Name of a model, whose weights are in the cache after its first run; or a file of
            ``tactibench weights export``.
        protocol: Protocol that it was trained on.
        params: Parameters, as of ``plan``.
        sensor: Sensor that it was trained on; None for the protocol's.
        data: Folder of recorded frames that it was trained on.
        quick: Whether to take the weights of a quick run.

    Raises:
        UserError: There are no weights (the sentence tells how to train them), or something does
            not exist.
    """
    from tactibench.lab import trained_model

    folder = None if data is None else Path(data)
    texts = _texts(params)
    found = trained_model(
        str(name), str(protocol), params=texts, data=folder, sensor=sensor, quick=quick
    )
    return TrainedModel(*found)


def render(
    contacts: Sequence[Sequence[float]],
    sensor: str = "tactip-127",
    *,
    radius_mm: float = 3.0,
    params: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> Frame:
    """Return the frame of a simulated sensor that round tips press.

    Args:
        contacts: (K, 3) x, y and depth of every tip, mm, at least one.
        sensor: Name of the sensor.
        radius_mm: Radius of the tips, mm.
        params: Parameters of the sensor, such as {"friction": 0}.
        seed: Seed of the camera's noise.

    Returns:
        The frame: ``image``, and ``rest_image`` of the sensor that nothing touches.

    Raises:
        UserError: The sensor or a parameter does not exist, or it does not press such scenes.
    """
    import numpy as np

    from tactibench.geometry import DOME_RADIUS_MM, scene_of_contacts
    from tactibench.plugins import PluginHost, SensorContext

    places = np.asarray(contacts, dtype=float)
    if places.ndim != 2 or places.shape[1] != 3 or not len(places):
        raise UserError(
            "contacts are rows of x, y and depth in mm, such as [[0, 0, 2], [7, 0, 3]]."
        )
    spec = PluginHost().sensors[sensor]
    values = spec.settings({name: str(value) for name, value in (params or {}).items()})
    with spec.build(SensorContext(np.random.SeedSequence(seed)), **values) as pressed:
        own = pressed.workspace
        dome = DOME_RADIUS_MM if own is None else own.dome_radius_mm
        try:
            scene = scene_of_contacts(places[:, :2], places[:, 2], radius_mm, dome)
        except ValueError as error:
            raise UserError(f"{error}.") from error
        return next(iter(pressed.press_many([scene])))


def _texts(params: Mapping[str, Any] | Sequence[str]) -> tuple[str, ...]:
    """Return parameters as texts, such as "model.width=32"."""
    named = params.items() if isinstance(params, Mapping) else ()
    return tuple(f"{name}={value}" for name, value in named) or tuple(params)


def load_run(name: str | Path, store: str | Path = STORE) -> StoredRun:
    """Return a stored run.

    Args:
        name: Name of the run, its folder, or its record file.
        store: Folder of the run store.

    Raises:
        UserError: There is no such run, or its record cannot be read.
    """
    return open_run(Path(store), str(name))


def load_runs(store: str | Path = STORE, *, protocol: str | None = None) -> pd.DataFrame:
    """Return every metric of every run of a store, a row for each number.

    Args:
        store: Folder of the run store.
        protocol: Id of the protocol whose runs are returned, such as "exp1"; None for all runs.

    Returns:
        A frame with the columns run, protocol, version, model, encoder, regime, sensor, seed,
        presses, partial and created, then metric, group, value, low, high, n, clusters, unit,
        better and censored. Runs that cannot be read are left out.
    """
    rows: list[dict[str, Any]] = []
    for stored in stored_runs(Path(store)):
        record = stored.record
        if protocol is not None and record.protocol.id != protocol:
            continue
        subject = {
            "run": record.name,
            "protocol": record.protocol.id,
            "version": record.protocol.version,
            "model": record.model.text(),
            "encoder": None if record.encoder is None else record.encoder.text(),
            "regime": record.regime,
            "sensor": record.sensor.text(),
            "seed": record.seed,
            "presses": record.limits.presses,
            "partial": record.partial,
            "created": record.created,
        }
        rows += [{**subject, "censored": None, **row.json_values()} for row in record.metrics]
    return _frame(rows)


def load_board(protocol: str, board: str | Path | None = None) -> pd.DataFrame:
    """Return the numbers of a board, a row for each number, with seeds pooled.

    Args:
        protocol: Name of the protocol.
        board: Folder of the leaderboards; None: ``leaderboards`` here, or those that ship.

    Returns:
        A frame with the columns protocol, sensor, model, encoder, regime, prior, seeds,
        metric, group, value, unit, low, high, sd, clusters, censored, limits,
        best_rank and worst_rank, between which chance decides.

    Raises:
        UserError: There is no board or no such protocol, or a record cannot be read.
    """
    from tactibench.board import check_folder
    from tactibench.protocols import load_protocol
    from tactibench.report import board_rows

    folder = default_board() if board is None else Path(board)
    check_folder(folder)
    return _frame(board_rows(folder, [load_protocol(protocol)]))


@dataclass(frozen=True)
class Score:
    """A stored run that was scored again.

    Attributes:
        run: The run with its new metrics.
        differences: A sentence for each row that is not exactly equal to the stored row.
        completed: Whether the answers had no score before; the run is now in the store.
    """

    run: StoredRun
    differences: tuple[str, ...]
    completed: bool = False


def score(name: str | Path | StoredRun, store: str | Path = STORE) -> Score:
    """Score the stored answers of a run again, without model or sensor.

    If the answers could not be scored when they were made, they are scored and their run is stored.

    Args:
        name: The run, its name, or its folder.
        store: Folder of the run store.

    Raises:
        UserError: There is no such run, its protocol is not installed in the same version, or its
            answers cannot be scored.
    """
    from tactibench.run import metric_differences, protocol_of, rescore, score_answers

    if isinstance(name, str) and unscored_run(Path(store), name) is not None:
        with held_name(Path(store), name):
            answers = unscored_run(Path(store), name)  # unless another process scored it
            if answers is not None:
                return Score(score_answers(answers, protocol_of(answers)), (), completed=True)
    stored = name if isinstance(name, StoredRun) else load_run(name, store)
    record = rescore(stored)
    changed = metric_differences(stored.record.metrics, record.metrics)
    return Score(StoredRun(stored.folder, record), tuple(changed))


@dataclass(frozen=True)
class Comparisons:
    """Runs compared press by press.

    Attributes:
        runs: The runs that were compared.
        pairs: The comparison of every two runs.
    """

    runs: tuple[StoredRun, ...]
    pairs: tuple[Comparison, ...]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A mapping for each number, as ``tactibench compare --json`` writes them."""
        from tactibench.board import comparison_rows

        return comparison_rows(self.runs, self.pairs)

    @property
    def frame(self) -> pd.DataFrame:
        """The rows as a data frame: ``value`` is the first run minus the second."""
        return _frame(self.rows)


def compare(
    *runs: str | Path | StoredRun, store: str | Path = STORE, progress: Reporter | bool = True
) -> Comparisons:
    """Compare stored runs that answered the same test frames, press by press.

    Args:
        *runs: Two or more runs, their names, or their folders.
        store: Folder of the run store.
        progress: Whether to show progress on stderr, or a reporter that shows it.

    Raises:
        UserError: There are fewer than two runs, a run does not exist, or they did not answer the
            same frames.
    """
    from tactibench.board import compare_runs

    if len(runs) < 2:
        raise UserError("one run alone cannot be compared; name two or more.")
    opened = tuple(item if isinstance(item, StoredRun) else load_run(item, store) for item in runs)
    with _reporter(progress).task("compare", len(runs) * (len(runs) + 1) // 2) as advance:
        return Comparisons(opened, tuple(compare_runs(opened, advance)))


def place(run: StoredRun, board: str | Path | None = None) -> Placement | None:
    """Return the place that a run has, or would have, among the rows of a board.

    Args:
        run: A whole run; a partial one has no place.
        board: Folder of the leaderboards; None: ``leaderboards`` here, or those that ship.

    Returns:
        The placement: rank, number of rows and the next better row. None where there is nothing to
        compare with.
    """
    from tactibench.board import place_run

    return place_run(run, default_board() if board is None else Path(board))


@dataclass(frozen=True)
class Plot:
    """A figure over many runs, with the numbers behind it.

    Attributes:
        data: Titles, tables and remarks, as the command line prints them.
    """

    data: PlotData

    @property
    def frame(self) -> pd.DataFrame:
        """The numbers, a row for each point."""
        return _frame(self.data.rows)

    @cached_property
    def figure(self) -> Figure:
        """The matplotlib figure, drawn at its first use."""
        return self.data.draw()

    def save(self, path: str | Path) -> Path:
        """Write the figure as a PNG file and return its path.

        Raises:
            UserError: The name of the file does not end in .png.
        """
        from tactibench.report import save_png

        if Path(path).suffix.lower() != ".png":
            raise UserError(f"{path} is no PNG file; call it {Path(path).with_suffix('.png')}.")
        save_png(self.figure, Path(path))
        return Path(path)


def plot(
    kind: str,
    protocol: str,
    *,
    board: str | Path | None = None,
    store: str | Path | None = None,
    sensor: str | None = None,
    machine: str | None = None,
    new_sensor: bool = False,
    rows: Sequence[str] = (),
) -> Plot:
    """Return a figure of committed and stored runs of a protocol.

    Args:
        kind: "frontier" (speed against error), "curve" (error against training presses) or
            "stability" (where errors double on hard cases).
        protocol: Name of the protocol.
        board: Folder of the leaderboards; None: ``leaderboards`` here, or those that ship.
        store: Folder of a run store whose complete runs are added; None for none.
        sensor: Sensor, such as "tactip-127, instance=1"; None for the nominal one.
        machine: For "frontier": fingerprint of the machine; None for that of most runs.
        new_sensor: For "curve": whether the error is drawn against the labelled presses of an
            instance that no training saw.
        rows: For "stability": the only rows that are drawn, in this order; () for all.

    Raises:
        UserError: There is nothing to draw, or no such kind, protocol or sensor.
    """
    from tactibench.report import curve_data, frontier_data, stability_data

    runs = None if store is None else Path(store)
    folder = default_board() if board is None else Path(board)
    if kind == "frontier":
        return Plot(frontier_data(protocol, folder, runs, sensor, machine))
    if kind == "curve":
        return Plot(curve_data(protocol, folder, runs, sensor, new_sensor=new_sensor))
    if kind == "stability":
        return Plot(stability_data(protocol, folder, runs, sensor, tuple(rows)))
    raise UserError(f"there is no figure {kind!r}; {did_you_mean(kind, PLOTS)}")


def plot_limit(
    sensor: str = "tactip-127",
    *,
    params: Mapping[str, Any] = MappingProxyType({}),
    scene: str = "single",
    depths: Sequence[float] = (1.0, 3.0, 6.0),
    spacing: float | None = None,
    yaw: float | None = None,
    radius: float = 3.0,
    reach: float = 6.4,
    step: float = 0.8,
    nuisances: Sequence[str] = (),
    progress: Reporter | bool = True,
) -> Plot:
    """Return the Cramer-Rao bound on contacts over the workspace of a simulated sensor.

    Args:
        sensor: Name of a sensor that knows the Cramer-Rao bound.
        params: Parameters of the sensor, as {"read_noise": 6}.
        scene: "single" or "dual": one tip, or two.
        depths: Depths of the presses, mm.
        spacing: Spacing of two tips, mm; None for 7.
        yaw: Yaw of two tips, degrees; None for 0.
        radius: Radius of the tips, mm.
        reach: Half the side of the workspace, mm.
        step: Distance of neighbouring presses, mm.
        nuisances: Properties of the camera that are unknown, too, such as "shift"; ("all",) for
            all.
        progress: Whether to show progress on stderr, or a reporter that shows it.

    Raises:
        UserError: Something does not exist or does not fit, or the sensor knows no bound.
    """
    from tactibench.report import limit_data

    return Plot(
        limit_data(
            sensor,
            {name: str(value) for name, value in params.items()},
            scene=scene,
            depths=depths,
            spacing=spacing,
            yaw=yaw,
            radius=radius,
            reach=reach,
            step=step,
            nuisances=nuisances,
            reporter=_reporter(progress),
        )
    )


def _frame(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(list(rows))


def _reporter(progress: Reporter | bool) -> Reporter:
    """Return the given reporter, or for True and False one that shows progress or nothing."""
    if not isinstance(progress, bool):
        return progress
    from rich.console import Console

    from tactibench.report import progress_on

    return progress_on(Console(stderr=True, highlight=False), quiet=not progress)
