"""``tactibench hw live``."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench_tactip.commands.common import (
    config_options,
    devices,
    json_option,
    print_rows,
    write_figures,
)

if TYPE_CHECKING:
    from tactibench_tactip.live.loop import Latency, Seen
    from tactibench_tactip.live.presses import Presses


@click.command("live")
@click.argument("model")
@config_options
@click.option("--protocol", default="exp1", show_default=True, help="Whose weights.")
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="KIND.NAME=VALUE",
    help="As the weights were trained with.",
)
@click.option(
    "--data",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="DIR",
    help="Weights that were trained on this data set.",
)
@click.option("--regime", help="Frames the weights were trained on; default: the protocol's first.")
@click.option("--untrained", is_flag=True, help="Random weights, to see the latency alone.")
@click.option(
    "--frames", type=click.IntRange(min=1), default=300, show_default=True, help="Frames to answer."
)
@click.option("--press", is_flag=True, help="Let the robot press meanwhile, as exp1 does.")
@click.option("--serve", is_flag=True, help="Show the picture on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0: any free.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.png",
    help="Write the last picture with a contact.",
)
@json_option
def command(
    model: str,
    config: Path,
    emulate: bool,
    time_scale: float,
    protocol: str,
    params: tuple[str, ...],
    data: Path | None,
    regime: str | None,
    untrained: bool,
    frames: int,
    press: bool,
    serve: bool,
    port: int,
    out: Path | None,
    json_file: Path | None,
) -> None:
    """Answer frames as they come and show camera, pins, heatmap, contacts and the loop's latency.

    Latency is from a frame's arrival to the list of contacts (scenario `loop`). Without --serve
    and --out a line in the terminal shows the contacts. The sensor must be untouched at the start.
    """
    import time

    from tactibench.lab import trained_model
    from tactibench_tactip.camera.driver import Camera
    from tactibench_tactip.camera.gate import Reference
    from tactibench_tactip.live.loop import watch

    sensor = None if data is None else "recorded"
    reader, label = trained_model(
        model,
        protocol,
        params=params,
        data=data,
        regime=regime,
        sensor=sensor,
        untrained=untrained,
    )
    with devices(config, emulate, time_scale if press else 1.0) as (settings, _), ExitStack() as at:
        presses: Presses | None = None
        if press:
            from tactibench_tactip.live.presses import Presses

            presses = at.enter_context(Presses(settings))
            camera = presses.station.camera
            rest = presses.rest.image
            presses.begin()
        else:
            camera = at.enter_context(Camera(settings.camera))
            rest = Reference.of(camera.fresh(time.monotonic_ns(), 20)).image
        show = _Shown(at, rest, label, serve, port, out)
        found = watch(
            camera,
            reader,
            rest,
            frames,
            lambda seen: show(seen) and not (presses is not None and presses.failed),
        )
    show.end()
    _told(found, label, untrained, json_file)


class _Shown:
    """Where turns of the loop are shown: a page, a file, a line of the terminal."""

    def __init__(
        self, stack: ExitStack, rest: object, label: str, serve: bool, port: int, out: Path | None
    ) -> None:
        from tactibench_tactip.live.page import Page
        from tactibench_tactip.live.picture import Painter

        self._painter = Painter(rest)  # type: ignore[arg-type]
        self._label, self._out = label, out
        self._page = stack.enter_context(Page(port)) if serve else None
        self._last: Seen | None = None
        if self._page is not None:
            click.echo(f"live view: {self._page.url}", err=True)

    def __call__(self, seen: Seen) -> bool:
        from tactibench_tactip.live.picture import describe

        answer = seen.answer
        if self._last is None or (
            answer is not None
            and getattr(answer, "depth", ()) is not None
            and describe(answer) != "no contact"
        ):
            self._last = seen
        if self._page is not None:
            self._page.show(self._painter.draw(seen, self._label))
        elif sys.stderr.isatty():
            line = f"{seen.latency_ms:6.1f} ms  {describe(answer)}"
            click.echo(f"\r{line[:100]:<100}", nl=False, err=True)
        return True

    def end(self) -> None:
        if sys.stderr.isatty():
            click.echo(err=True)
        if self._out is not None and self._last is not None:
            import cv2

            cv2.imwrite(str(self._out), self._painter.draw(self._last, self._label))
            click.echo(f"picture: {self._out}")


def _told(found: Latency, label: str, untrained: bool, json_file: Path | None) -> None:
    names = ("p50", "p90", "p99", "mean")
    values = [getattr(found, name) for name in names]
    print_rows(
        ("loop, ms", *names, "frames", "dropped"),
        [
            (
                label,
                *(f"{value:.1f}" for value in values),
                f"{found.count:,}",
                f"{found.dropped:.0%}",
            )
        ],
    )
    if untrained:
        click.echo("RANDOM WEIGHTS: the answers say nothing")
    write_figures(
        json_file, [("loop", name, value, "ms") for name, value in zip(names, values, strict=True)]
    )
