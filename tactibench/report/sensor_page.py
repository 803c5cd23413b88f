"""The page of a sensor: how good it is, before any model."""

from __future__ import annotations

import base64

import numpy as np
from matplotlib.figure import Figure

from tactibench import __version__
from tactibench.datasets import SensorReport
from tactibench.report.pages import asset, render
from tactibench.report.style import GREY, image_bytes, in_own_style, new_figure, plain
from tactibench.report.tables import Cell, Column, Number, Table, significant, table


def sensor_table(report: SensorReport) -> Table:
    """Return the lines of a report."""
    rows: list[list[Cell]] = [
        [
            line.name,
            None
            if line.value is None
            else Number(
                line.value, significant if isinstance(line.value, float) else "{:,}".format
            ),
            line.unit,
            line.remark,
        ]
        for line in report.measures
    ]
    return table(["", Column("value"), "unit", "taken from"], rows, title="How good the sensor is")


def sensor_page(report: SensorReport, title: str, facts: str) -> str:
    """Return the HTML of a report, all in one file.

    Args:
        report: How good the sensor is.
        title: Name of the recording.
        facts: Number and kind of its frames.
    """
    known = any(points is not None for points in (report.course, report.presses))
    picture = image_bytes(in_own_style(_figure)(report), "png", 100) if known else b""
    return render(
        "sensor.html.j2",
        title=title,
        facts=facts,
        limit=report.limit,
        table=sensor_table(report),
        picture=base64.b64encode(picture).decode(),
        style=asset("page.css"),
        version=__version__,
    )


def _figure(report: SensorReport) -> Figure:
    """Return the drift over time and the signal over depth, as far as they are known."""
    unit = f", {report.unit}" if report.unit else ""
    panels = [
        (points, across, up)
        for points, across, up in (
            (report.course, "time, from the mean time of the same labels", "drift"),
            (report.presses, "depth, mm", "signal over rest"),
        )
        if points is not None
    ]
    figure = new_figure(4.5 * len(panels), 3.4)
    for axes, (points, across, up) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        plain(axes)
        axes.set(xlabel=across, ylabel=f"{up} (root mean square){unit}")
        if points is report.course:
            axes.plot(*points, color="#0072B2", marker="o")
        else:
            thin = np.linspace(0, len(points[0]) - 1, min(len(points[0]), 2000)).astype(int)
            axes.scatter(points[0][thin], points[1][thin], s=5, color=GREY, linewidths=0)
    return figure
