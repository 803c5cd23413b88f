"""Pictures: they show what they are given, are written whole, and touch no global state."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from report_material import exp2_metrics

from tactibench.board import (
    Curve,
    PooledMetric,
    Row,
    Step,
    frontiers,
    ranking_error,
    rows_of,
    sections_of,
)
from tactibench.contacts import Contacts, Grid
from tactibench.protocols import load_published
from tactibench.records import Metric
from tactibench.report import (
    MODELS,
    FrameExample,
    contacts_figure,
    curve_figure,
    distance_figure,
    frontier_figure,
    frontier_table,
    image_bytes,
    model_look,
    row_looks,
    save_png,
    single_figure,
    unseen_frontiers,
)

TABLES = load_published(["tactiverse"], Path(__file__).parents[2] / "leaderboards" / "published")
GRID = Grid.centred(64, 0.4)
TRUTH = Contacts.truth([[0, 4.6], [-4, -2.3], [4, -2.3]], [4.0, 2.5, 1.0])
FOUND = Contacts(np.array([[0.2, 4.4], [-3.9, -2.1]]), np.array([3.8, 2.4]), np.array([0.9, 0.7]))
IMAGE = np.zeros((128, 128), np.uint8)


def heatmap(contacts: Contacts) -> Any:
    x, y = np.meshgrid(*GRID.axes())
    peaks = [
        d / 6 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 12)
        for (a, b), d in zip(contacts.xy, contacts.depth, strict=True)
    ]
    return np.max(peaks, axis=0)


ERROR = ranking_error("exp1")


def example(heat: Any = None, truth: Contacts = TRUTH, predicted: Contacts = FOUND) -> FrameExample:
    return FrameExample(IMAGE, GRID, heat, truth, predicted, 6.0)


DRAWN: dict[str, Callable[[], Figure]] = {
    "curve": lambda: curve_figure([], ERROR),
    "distance": lambda: distance_figure([]),
    "contacts": lambda: contacts_figure([("unet", example(heatmap(FOUND)))]),
    "no contacts": lambda: contacts_figure(
        [("cnn", example(None, Contacts.none(), Contacts.none()))]
    ),
    "frontier": lambda: frontier_figure([], ERROR),
    "single": lambda: single_figure(np.empty((0, 3)), np.empty((0, 3))),
}
"""Pictures of little or nothing."""


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_a_picture_is_a_png_of_the_width_of_a_page_and_nothing_else(
    tmp_path: Path, name: str
) -> None:
    save_png(DRAWN[name](), tmp_path / "new" / "picture.png")
    (file,) = (tmp_path / "new").iterdir()
    assert 1000 <= imread(file).shape[1] <= 2100


def test_the_same_data_gives_the_same_bytes() -> None:
    assert len({image_bytes(DRAWN["contacts"](), "svg") for _ in range(2)}) == 1


def test_a_model_keeps_its_look_and_rows_of_one_model_differ() -> None:
    looks = [model_look(name) for name in MODELS]
    assert len({look.color for look in looks}) == len({look.marker for look in looks}) == 7
    assert model_look("mine") == model_look("mine")
    rows = row_looks(["cnn", "unet", "unet", "mean", "unet"])
    assert [rows[k].color for k in (1, 2, 4)] == [model_look("unet").color] * 3
    assert len({(look.marker, str(look.line)) for look in rows}) == 5
    assert rows[1] == model_look("unet")


@pytest.mark.parametrize("name", ["mine", "resnet", "gp", "a lab's own"])
def test_a_model_of_others_has_a_look_that_no_shipped_one_has(name: str) -> None:
    shipped = [model_look(model) for model in (*MODELS, "mean", "nearest")]
    guest = model_look(name)
    assert guest.color not in {look.color for look in shipped}
    assert guest.marker not in {look.marker for look in shipped}
    assert len({look.marker for look in row_looks([name] * 3)}) == 3


def distance_row(fabricate: Any, error: float | None, model: str = "unet") -> Row:
    """A row of which 40 % are resolved at three distances."""
    counts: dict[str, Any] = {"n": 9, "clusters": 9, "unit": "mm", "better": "lower"}
    ends = (None, None) if error is None else (error * 0.8, error * 1.3)
    record = fabricate("exp2", model)
    for group in ("12.0", "6.5", "9.0", "all"):
        for name, value, low, high in (
            ("distance_mae_mm", error, *ends),
            ("resolved", 0.4, 0.3, None),
        ):
            facts = {"metric": name, "group": group, "value": value, "low": low, "high": high}
            record.metrics.append(Metric(**facts, **counts))
    return Row((record,))


def test_the_distance_curve_shows_rows_intervals_and_named_published_means(fabricate: Any) -> None:
    rows = [distance_row(fabricate, 0.6), distance_row(fabricate, None, "cnn")]
    figure = distance_figure(rows, published=TABLES)
    errors, shares = figure.axes
    drawn, none = errors.containers
    assert drawn.get_label() == rows[0].label
    assert list(drawn[0].get_ydata()) == [0.6] * 3
    assert none.get_label() == f"{rows[1].label}: no pair resolved"
    labels = errors.get_legend_handles_labels()[1]
    assert "U-Net (single), 1.214 mm: hardware, published" in labels
    values = [
        list(line.get_ydata())
        for line in shares.lines
        if line.get_marker() == "o" and len(line.get_ydata()) == 3
    ]
    assert values == [[40.0] * 3] * len(values)
    assert errors.get_yscale() == "log"
    assert errors.get_ylim()[1] > 1.214
    assert "hollow: less than half resolved" in figure.get_suptitle()


def test_a_bound_instead_of_a_threshold_has_no_mark(fabricate: Any) -> None:
    record = fabricate("exp2", metrics=exp2_metrics(0.2))
    known = distance_figure([Row((record,))])
    next(m for m in record.metrics if m.metric == "threshold_mm").censored = "<"
    bound = distance_figure([Row((record,))])
    shares = [figure.axes[1] for figure in (known, bound)]
    marks = [sum(line.get_markersize() == 11 for line in axes.lines) for axes in shares]
    assert marks == [1, 0]


def test_contacts_are_drawn_in_millimetres_and_names_are_no_formula() -> None:
    figure = contacts_figure([("unet", example(heatmap(FOUND)))], title=r"$\frac{")
    field = figure.axes[1]
    np.testing.assert_allclose(np.column_stack(field.lines[0].get_data()), FOUND.xy)
    assert [patch.center for patch in field.patches] == [tuple(xy) for xy in TRUTH.xy]  # type: ignore[attr-defined]
    assert {text.get_text() for text in field.texts} == {"4.0", "2.5", "1.0", "3.8", "2.4"}
    assert field.images[0].get_extent() == pytest.approx([-12.8, 12.8, 12.8, -12.8])
    assert rb"$\frac{" in image_bytes(figure, "svg")


def test_points_of_a_frontier_are_in_its_key_and_dominated_ones_are_hollow(
    fabricate: Any,
) -> None:
    widths = ((8, 0.05, 2.0), (16, 0.10, 3.0), (32, 0.03, 9.0))
    records = [
        fabricate(settings={"width": w}, error=e, p90_ms=p, regime=regime)
        for w, e, p in widths
        for regime in ("single", "multiple")
    ]
    found = frontiers(rows_of(records), ERROR)
    figure = frontier_figure(found, ERROR)
    panels = figure.axes
    key = [text.get_text() for text in figure.legends[0].get_texts()]
    labels = dict(line.split("  ", 1) for line in key[:3])
    assert sorted(labels) == ["1", "2", "3"]
    titles = [axes.get_title("left") for axes in panels]
    assert titles == ["trained in regime single", "trained in regime multiple"]
    for axes, one in zip(panels, found, strict=True):
        assert [labels[text.get_text()] for text in axes.texts] == [p.label for p in one.points]
        faces = [line.get_markerfacecolor() for line in axes.lines if line.get_marker() == "o"]
        assert faces.count("white") == len(one.dominated) == 1
        (steps,) = (line for line in axes.lines if line.get_drawstyle() == "steps-post")
        assert max(steps.get_xdata()) == max(p.latency.high for p in one.points)
        assert max(steps.get_xdata()) < axes.get_xlim()[1]
    assert panels[0].get_xscale() == panels[0].get_yscale() == "log"


@pytest.mark.parametrize("named", [True, False])
def test_labels_of_a_frontier_do_not_overlap(fabricate: Any, named: bool) -> None:
    """Six points within a few per cent of each other, named or numbered."""
    rng = np.random.default_rng(3)
    records = [
        fabricate(
            model=f"model{k}" if named else "unet",
            settings={} if named else {"width": k},
            error=0.1 * (1 + rng.uniform(0, 0.5)),
            p90_ms=2.0 * (1 + rng.uniform(0, 0.3)),
        )
        for k in range(6)
    ]
    figure = frontier_figure(frontiers(rows_of(records), ERROR), ERROR)
    figure.draw_without_rendering()
    texts = figure.axes[0].texts
    assert {text.get_text().rstrip("0123456789") for text in texts} == {"model" if named else ""}
    boxes = [text.get_window_extent() for text in texts]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


@pytest.mark.parametrize("times", [(0.89, 1.37), (4.5, 4.9), (1.2, 3.0), (0.3, 90.0)])
def test_every_axis_of_a_frontier_has_two_labels_or_more(
    fabricate: Any, times: tuple[float, float]
) -> None:
    records = [
        fabricate(settings={"width": k}, error=t / 40, p90_ms=t) for k, t in enumerate(times)
    ]
    (axes,) = frontier_figure(frontiers(rows_of(records), ERROR), ERROR).axes
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        assert sum(low <= tick <= high for tick in axis.get_majorticklocs()) >= 2


def test_a_frontier_marks_times_that_are_not_settled(fabricate: Any) -> None:
    quiet, busy = (fabricate(settings={"width": w}, error=w / 99, p90_ms=w) for w in (8, 16))
    for speed in busy.speed:
        speed.settled = False
    for records, numbers in (([quiet], ["unet, width=8"]), ([quiet, busy], ["2", "1*"])):
        (one,) = frontiers(rows_of(records), ERROR)
        figure = frontier_figure([one], ERROR)
        assert [text.get_text() for text in figure.axes[0].texts] == numbers
        key = [text.get_text() for text in figure.legends[0].get_texts()]
        assert any("not settled" in text for text in key) == (busy in records)
        marks = [row[2].mark for row in frontier_table(one, ERROR).rows]
        assert marks == ["*" if number.endswith("*") else "" for number in numbers]


def test_sensors_that_no_training_saw_stand_beside_a_frontier(fabricate: Any) -> None:
    records = [
        fabricate(
            settings={"width": w},
            error=w / 99,
            p90_ms=w,
            metrics=(("gospa_depth_mm", "unseen", unseen),),
        )
        for w, unseen in ((8, 0.3), (16, 0.2))
    ]
    nominal, other = sections_of(
        [*records, *(fabricate(settings={"width": w}, sensor={"instance": 1}) for w in (8, 16))]
    )
    found = frontiers(nominal.rows, ERROR)
    unseen = unseen_frontiers("exp1", nominal, found)
    assert unseen is not None
    points = [(p.latency.value, p.error.value) for p in unseen.frontiers[0].points]
    assert points == [(8, 0.3), (16, 0.2)]
    assert unseen_frontiers("exp1", other, found) is None  # not the nominal sensor
    left, right = frontier_figure(found, ERROR, unseen=unseen).axes
    assert "sensors that no training saw" in right.get_title("left")
    assert "unseen" in right.get_ylabel()
    assert left.get_xlim() == right.get_xlim()
    assert left.get_ylim() != right.get_ylim()  # another error has an axis of its own


def test_a_learning_curve_has_its_values_and_a_place_for_no_presses() -> None:
    pooled = PooledMetric(0.2, 0.1, 0.3, None, (1000, 1000), "mm")
    steps = tuple(Step(n, replace(pooled, value=0.2 - n / 1e4), 8) for n in (0, 10, 1000))
    figure = curve_figure([Curve("kernel", "kernel", steps)], ERROR, new_sensor=True)
    axes = figure.axes[0]
    assert list(axes.lines[0].get_xdata()) == [0, 10, 1000]
    assert list(axes.lines[0].get_ydata()) == [step.error.value for step in steps if step.error]
    places = [float(x) for x, _ in axes.transData.transform([(n, 0.1) for n in (0, 10, 1000)])]
    assert np.all(np.isfinite(places))
    assert places[0] + 20 < places[1] < places[2] - 20
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0", "10", "1,000"]
    assert axes.get_xlabel() == "labelled presses of the new sensor"


HOSTILE_STYLE = """
text.usetex: True
font.family: nowhere
savefig.format: pdf
axes.facecolor: red
figure.dpi: 10
"""


@pytest.mark.long
def test_the_settings_of_a_user_change_no_picture(tmp_path: Path) -> None:
    """A notebook's backend, and a style file made for a paper."""
    (tmp_path / "matplotlibrc").write_text(HOSTILE_STYLE, encoding="utf-8")
    code = """
import sys, numpy as np
from pathlib import Path
from tactibench.cli.main import run
picture = Path(sys.argv.pop())
try:
    run()
except SystemExit:
    from tactibench.report import save_png, single_figure
    save_png(single_figure(np.ones((5, 3)), np.ones((5, 3)) + 0.1), picture)
sys.exit("matplotlib.pyplot" in sys.modules)
"""
    own = {"MPLBACKEND": "of_a_notebook", "MATPLOTLIBRC": str(tmp_path)}
    for name, environment in (("plain.png", {}), ("hostile.png", own)):
        command = [sys.executable, "-c", code, str(tmp_path / name)]
        subprocess.run(
            command, check=True, env={**os.environ, **environment}, stdout=subprocess.DEVNULL
        )
    assert (tmp_path / "plain.png").read_bytes() == (tmp_path / "hostile.png").read_bytes()
