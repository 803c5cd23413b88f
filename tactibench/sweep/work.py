"""What a worker does with a cell: train what several share, or run the whole."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from tactibench.errors import UserError
from tactibench.metrics.registry import check_metrics
from tactibench.plugins.host import PluginHost
from tactibench.run.plan import RunPlan, make_plan
from tactibench.run.reporter import Silent
from tactibench.run.request import RunRequest
from tactibench.sweep.planned import Place, stored_name


@dataclass(frozen=True)
class Outcome:
    """name: of the run. why: it failed, in a sentence; "" when it did not. seconds: it took."""

    name: str = ""
    why: str = ""
    seconds: float = 0.0


def train_weights(request: RunRequest, place: Place) -> Outcome:
    """Make sure that the weights of a cell are in the cache."""

    def train(plan: RunPlan) -> str:
        from tactibench.run.train import trained_model

        trained_model(plan, Silent())
        return ""

    return _tried(train, request, place)


def run_cell(request: RunRequest, place: Place) -> Outcome:
    """Run a cell and store it. A worker may have died after it stored the run, before it said so,
    and another sweep may be at work on the same store: what is stored is not run again."""

    def run(plan: RunPlan) -> str:
        from tactibench.run.execute import execute

        if stored_name(plan, place, {}) is None:
            check_metrics(plan.protocol)
            execute(plan, place.store, Silent())
        return plan.name

    return _tried(run, request, place)


def _tried(work: Callable[[RunPlan], str], request: RunRequest, place: Place) -> Outcome:
    began = time.perf_counter()
    name, why = "", ""
    try:
        name = work(make_plan(request, PluginHost(), place.cache))
    except (UserError, OSError) as error:
        why = " ".join(str(error).split())
    except Exception as error:  # noqa: BLE001 - a model's mistake; the other cells go on
        why = " ".join(f"it raised {type(error).__name__}: {error}".split()).rstrip(".:") + "."
    return Outcome(name, why, time.perf_counter() - began)
