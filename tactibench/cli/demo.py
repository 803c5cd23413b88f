"""``tactibench demo``: press a simulated sensor with the mouse, and see what models answer."""

from __future__ import annotations

import math
import os
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import MODEL, request_of, request_options
from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.cli.output import Terminal
    from tactibench.live import PressSession, Subject
    from tactibench.plugins import Sensor
    from tactibench.run import RunPlan

MOST_MODELS = 2
"""Two stand side by side on a laptop's screen; more are what boards are for."""
DEFAULT = "superpose"
"""It trains in about a minute. The others take up to hours and are not begun without --train."""


@click.command()
@click.argument("models", nargs=-1, type=MODEL, metavar="[MODEL [MODEL]]")
@click.option("--protocol", default="exp2", show_default=True, help="Whose weights and ranges.")
@request_options(
    regime="Frames the weights were trained on; default: the protocol's first.", seed="Of training."
)
@click.option("--train", is_flag=True, help="Train weights that are not in the cache.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="Of the page; 0: any that is free.",
)
@click.option("--no-browser", is_flag=True, help="Print the address and open nothing.")
def demo(
    models: tuple[str, ...],
    protocol: str,
    train: bool,
    port: int,
    no_browser: bool,
    **options: Any,
) -> None:
    """Press a simulated sensor by mouse or fingers and see what one or two models answer.

    A page of this machine shows frame, dimple, maps, true and read contacts, errors and times. A
    MODEL is a name or a file of `weights export`. Without one it is superpose, which trains in
    about a minute the first time.
    """
    if len(models) > MOST_MODELS:
        raise UserError(f"{len(models)} models are named; the page shows {MOST_MODELS} at most.")
    from tactibench.cli.output import Terminal
    from tactibench.live import PressPage
    from tactibench.report import model_look

    terminal = Terminal()
    given = models or (DEFAULT,)
    names = tuple(_model_name(text) for text in given)
    plans = [_plan(protocol, name, options) for name in names]
    subjects = [
        _subject(plan, text, terminal, train=train or text == DEFAULT)
        for plan, text in zip(plans, given, strict=True)
    ]
    plan = plans[0]
    spec = plan.frames.source.on_range()
    session = _session(plan, subjects)
    sensor = plan.components.sensor
    page = PressPage(
        session,
        [
            (subject.label, model_look(name).color)
            for subject, name in zip(subjects, names, strict=True)
        ],
        sensor=sensor.label,
        half_mm=spec.grid.cells * spec.grid.pitch_mm / 2,
        learned_mm=spec.workspace.half_width_mm,
        dome_mm=0.0 if math.isinf(dome := spec.workspace.dome_radius_mm) else dome,
        instances="instance" in sensor.values,
        port=port,
    )
    with page:
        terminal.say(f"press here: {page.url}   (Ctrl-C ends it)")
        sys.stdout.flush()
        if not no_browser and _has_screen():
            import webbrowser

            webbrowser.open(page.url)
        with suppress(KeyboardInterrupt):
            threading.Event().wait()


def _plan(protocol: str, model: str, options: dict[str, Any]) -> RunPlan:
    """Return the plan behind a model's weights. Raises UserError for a sensor without a press."""
    from tactibench.plugins import PluginHost
    from tactibench.protocols import load_protocol
    from tactibench.records import cache_folder
    from tactibench.run import make_plan, resolve_components

    host = PluginHost()
    request = request_of(protocol, model, options)
    spec = load_protocol(request.protocol).spec
    sensor = resolve_components(request, spec, host).sensor.spec
    if sensor.needs_data or sensor.origin != "simulated" or sensor.reference_of:
        raise UserError(
            f"sensor {sensor.name!r} cannot be pressed by mouse; take a simulated one of "
            "`tactibench list sensors`, or watch a real one with `tactibench hw live`."
        )
    return make_plan(request, host, cache_folder())


def _model_name(text: str) -> str:
    """Return the name of a model, given by name or by a weights file."""
    from tactibench.run import SUFFIX, read_description

    return read_description(Path(text)).model.name if text.endswith(SUFFIX) else text


def _subject(plan: RunPlan, text: str, terminal: Terminal, *, train: bool) -> Subject:
    """Return a model with its weights. Raises UserError where they would have to be trained."""
    from tactibench.live import Subject
    from tactibench.plugins import PluginHost
    from tactibench.run import SUFFIX, no_weights, open_weights, train_model

    label = plan.components.model.label
    if text.endswith(SUFFIX):
        model, label = open_weights(Path(text), device=plan.request.device)
    else:
        if not (plan.weights.cached or train):
            raise no_weights(plan)
        if not plan.weights.cached:
            count = plan.frames.count("fit")
            terminal.say(f"{label} is trained on {count:,} simulated presses, once.")
        model, _ = train_model(plan, terminal)
    encoder = None
    if plan.components.encoder is None:  # a map is drawn from its contacts, and labelled so
        encoder = PluginHost().encoders[plan.spec.defaults.encoder].build()
    return Subject(label, model, encoder)


def _session(plan: RunPlan, subjects: list[Subject]) -> PressSession:
    import numpy as np

    from tactibench.live import PressSession
    from tactibench.plugins import SensorContext

    sensor = plan.components.sensor
    spec = plan.frames.source.on_range()

    def make(instance: int) -> Sensor:
        values = dict(sensor.values)
        if "instances" in values:  # presses are spread over them in training; here one is pressed
            values["instances"] = 0
        if instance:
            values["instance"] = instance
        return sensor.spec.build(SensorContext(np.random.SeedSequence(0)), **values)

    return PressSession(
        make,
        subjects,
        spec.grid.grid(),
        dome_radius_mm=spec.workspace.dome_radius_mm,
        gate_mm=spec.test.gate_mm,
    )


def _has_screen() -> bool:
    """Return whether a browser would open in a window: one in a terminal would take it over."""
    return sys.platform in {"win32", "darwin"} or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
