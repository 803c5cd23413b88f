"""Pictures of boards: they show every point, and only what belongs to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from tactibench.board.curve import curves
from tactibench.board.figures import feature_maps
from tactibench.board.figures.curve import learning_curves
from tactibench.board.figures.frontier import frontier_picture
from tactibench.board.frontier import frontiers
from tactibench.board.ranking import RANKING
from tactibench.board.rows import rows_of
from tactibench.contacts import Contacts, Grid

ERROR = RANKING["exp1"]
GRID = Grid.centred(16, 1.6)
TRUTH = Contacts.truth([[0.0, 4.0], [3.0, -2.0]], [2.0, 1.0])


@pytest.fixture
def found(fabricate):
    widths = ((8, 0.05, 2.0), (16, 0.10, 3.0), (32, 0.03, 9.0))
    return frontiers(
        rows_of(
            fabricate(settings={"width": w}, error=e, p90_ms=p, regime=regime)
            for w, e, p in widths
            for regime in ("single", "multiple")
        ),
        ERROR,
    )


@pytest.fixture
def caught(monkeypatch):
    kept: list[Figure] = []
    for module in ("frontier", "curve", "features"):
        monkeypatch.setattr(f"tactibench.board.figures.{module}.save", lambda f, _: kept.append(f))
    return kept


def layers(count):
    rng = np.random.default_rng(0)
    return [(f"layer {k}", 8, rng.random((min(6, 2 + k), 4, 4))) for k in range(count)]


def test_every_point_is_named_and_dominated_ones_are_hollow(found, caught):
    frontier_picture(Path("x"), found, error="MAE, mm", title="t", measured_on="m")
    panels = caught[0].axes
    assert [axes.get_title("left") for axes in panels] == [
        "trained in regime single",
        "trained in regime multiple",
    ]
    for axes, one in zip(panels, found, strict=True):
        assert [text.get_text() for text in axes.texts] == [p.label for p in one.points]
        points = [line for line in axes.lines if line.get_marker() == "o"]
        faces = [line.get_markerfacecolor() for line in points]
        assert faces.count("white") == len(one.dominated) == 1
        places = [text.xyann[1] for text in axes.texts]
        assert sorted(places) == [
            place
            for _, place in sorted(zip([p.error.value for p in one.points], places, strict=True))
        ]
    assert panels[0].get_xscale() == panels[0].get_yscale() == "log"


def test_pictures_are_files_and_the_same_data_gives_the_same_bytes(tmp_path, found):
    for name in ("a.png", "b.png"):
        frontier_picture(tmp_path / name, found, error="MAE, mm")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert imread(tmp_path / "a.png").shape[1] >= 1000


def test_nothing_to_draw_is_an_empty_picture(tmp_path):
    frontier_picture(tmp_path / "frontier.png", [], error="MAE, mm")
    learning_curves(tmp_path / "curve.png", [], error="MAE, mm")
    feature_maps(
        tmp_path / "f.png",
        np.zeros((16, 16), np.uint8),
        [],
        GRID,
        None,
        Contacts.none(),
        Contacts.none(),
        6.0,
    )
    assert len(list(tmp_path.iterdir())) == 3


def test_a_learning_curve_has_its_values_and_bars(fabricate, caught):
    few = fabricate(error=0.2, limits={"presses": 250}, data={"train": 250})
    learning_curves(Path("x"), curves(rows_of([fabricate(), few]), ERROR), error="MAE, mm")
    axes = caught[0].axes[0]
    assert list(axes.lines[0].get_ydata()) == [0.2, 0.05]
    assert list(axes.lines[0].get_xdata()) == [250, 3600]
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["250", "3,600"]


@pytest.mark.parametrize("count", [1, 4, 10])
def test_layers_go_down_the_left_and_up_the_right(caught, count):
    feature_maps(
        Path("x"),
        np.zeros((16, 16), np.uint8),
        layers(count),
        GRID,
        np.zeros((16, 16)),
        TRUTH,
        TRUTH,
        6.0,
    )
    shown = [axes.get_title("left") for axes in caught[0].axes if axes.get_title("left")]
    rows = -(-count // 2)
    left = [f"layer {k}" for k in range(rows)]
    right = [f"layer {k}" for k in reversed(range(rows, count))]
    assert sorted(title.partition(":")[0] for title in shown) == sorted(left + right)
    assert all(title.endswith(": 8 of 4 x 4") for title in shown)
    order = [title.partition(":")[0] for title in shown]
    assert [name for name in order if name in left] == left
    assert [name for name in order if name in right] == right
