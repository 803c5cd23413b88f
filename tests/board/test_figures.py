"""Pictures: they show what they are given, are written whole, and touch no global state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.image import imread

from tactibench.board.figures import (
    distance_errors,
    overlay,
    single_errors,
    style,
    surfaces,
    triple_comparison,
)
from tactibench.board.figures.distance import by_distance, published_means
from tactibench.board.figures.marks import extent, tip_outline
from tactibench.board.figures.single import histogram_edge
from tactibench.board.published import load_published
from tactibench.contacts import Contacts, Grid
from tactibench.records.record import Metric

TABLES = load_published(["tactiverse"], Path(__file__).parents[2] / "leaderboards" / "published")
GRID = Grid.centred(64, 0.4)
TRUTH = Contacts.truth([[0, 4.6], [-4, -2.3], [4, -2.3]], [4.0, 2.5, 1.0])
FOUND = Contacts(np.array([[0.2, 4.4], [-3.9, -2.1]]), np.array([3.8, 2.4]), np.array([0.9, 0.7]))
IMAGE = np.zeros((128, 128), np.uint8)


def rows(error: float | None) -> list[Metric]:
    counts: dict[str, Any] = {"n": 9, "clusters": 9, "unit": "mm", "better": "lower"}
    low, high = (None, None) if error is None else (error * 0.8, error * 1.3)
    shown = []
    for group in ("12.0", "6.5", "9.0", "all"):
        for metric, *values in (
            ("distance_mae_mm", error, low, high),
            ("resolved", 0.4, 0.3, None),
        ):
            value, start, end = values
            shown.append(
                Metric(metric=metric, group=group, value=value, low=start, high=end, **counts)
            )
    return shown


def heatmap(contacts: Contacts) -> Any:
    x, y = np.meshgrid(*GRID.axes())
    peaks = [
        d / 6 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 12)
        for (a, b), d in zip(contacts.xy, contacts.depth, strict=True)
    ]
    return np.max(peaks, axis=0)


DRAWN: dict[str, Callable[[Path], None]] = {
    "distance": lambda p: distance_errors(
        p, [("unet", rows(0.6)), ("cnn", rows(None))], published=TABLES, measured_on="simulated"
    ),
    "distance_nothing": lambda p: distance_errors(p, []),
    "overlay": lambda p: overlay(p, IMAGE, GRID, heatmap(FOUND), TRUTH, FOUND, 6.0),
    "overlay_all": lambda p: overlay(
        p,
        np.zeros((96, 128, 3), np.uint8),
        GRID,
        heatmap(FOUND),
        TRUTH,
        FOUND,
        6.0,
        true_heatmap=heatmap(TRUTH),
        camera=lambda xy: 64 + 4.5 * xy,
        title="t",
        measured_on="m",
    ),
    "overlay_empty": lambda p: overlay(
        p, IMAGE, GRID, None, Contacts.none(), Contacts.none(), 6.0, camera=lambda xy: 64 + xy
    ),
    "surfaces": lambda p: surfaces(p, GRID, heatmap(FOUND) * 6, heatmap(TRUTH) * 6),
    "surfaces_flat": lambda p: surfaces(p, GRID, np.zeros((64, 64)), np.zeros((64, 64))),
    "triple": lambda p: triple_comparison(
        p, GRID, TRUTH, {"cnn": FOUND.top(1), "unet": FOUND}, {"unet": heatmap(FOUND)}
    ),
    "triple_nothing": lambda p: triple_comparison(p, GRID, TRUTH, {"cnn": Contacts.none()}, {}),
    "single": lambda p: single_errors(p, np.ones((5, 3)), np.ones((5, 3)) + 0.1 * np.eye(5, 3)),
    "single_nothing": lambda p: single_errors(p, np.empty((0, 3)), np.empty((0, 3))),
}


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_a_picture_is_a_png_at_least_1000_px_wide_and_nothing_else(
    tmp_path: Path, name: str
) -> None:
    DRAWN[name](tmp_path / "new" / "picture.png")
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["picture.png"]
    height, width = imread(tmp_path / "new" / "picture.png").shape[:2]
    assert 1000 <= width <= 1600
    assert height < width


@pytest.fixture
def caught(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures instead of files."""
    kept: list[Figure] = []
    for module in ("distance", "frames", "relief", "single", "triple"):
        monkeypatch.setattr(f"tactibench.board.figures.{module}.save", lambda f, _: kept.append(f))
    return kept


def test_a_failed_write_leaves_the_old_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")

    def full(_figure: Figure, stream: Any, **_: Any) -> None:
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(OSError, match="No space"):
        DRAWN["single"](path)
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [b"old"]


def test_the_same_data_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        DRAWN["distance"](tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def filled(axes: Any) -> list[Any]:
    return [line for line in axes.lines if len(line.get_ydata())]


def test_distance_curve_shows_series_intervals_and_named_published_means(
    caught: list[Figure],
) -> None:
    distance_errors(Path("x"), [("unet", rows(0.6)), ("cnn", rows(None))], published=TABLES)
    errors, shares = caught[0].axes
    lines = {str(line.get_label()): line for line in errors.lines}
    assert list(lines["unet"].get_ydata()) == [0.6] * 3
    assert "cnn: no pair resolved" in lines
    assert {1.214, 0.383} <= {float(line.get_ydata()[0]) for line in filled(errors)}
    notes = [text.get_text() for text in errors.texts]
    assert notes == [
        "U-Net (single) 1.214 mm\nhardware, published",
        "U-Net (multiple) 0.383 mm\nhardware, published",
    ]
    assert all(
        list(line.get_ydata()) == [40.0] * 3 for line in shares.lines if line.get_marker() == "o"
    )
    assert errors.get_ylim()[0] == 0
    assert errors.get_ylim()[1] > 1.214
    suptitle = caught[0].get_suptitle()
    assert "hollow: less than half resolved" in suptitle


def test_rows_by_distance_are_sorted_and_missing_ends_draw_no_bar() -> None:
    table = by_distance(rows(0.6), "resolved")
    assert table[:, 0].tolist() == [6.5, 9.0, 12.0]
    assert (table[:, 3] == table[:, 1]).all()
    assert by_distance(rows(None), "distance_mae_mm").shape == (0, 4)


def test_published_means_come_from_the_tables() -> None:
    assert published_means(TABLES) == [("U-Net (single)", 1.214), ("U-Net (multiple)", 0.383)]
    assert published_means([]) == []


def test_both_surfaces_share_their_axis_and_colours(caught: list[Figure]) -> None:
    surfaces(Path("x"), GRID, heatmap(FOUND) * 3, heatmap(TRUTH) * 6)
    left, right = (axes for axes in caught[0].axes if axes.name == "3d")
    assert left.get_zlim() == right.get_zlim()  # type: ignore[attr-defined]
    scales = [axes.collections[0].norm for axes in (left, right)]
    assert scales[0] is scales[1]
    assert scales[0].vmax == pytest.approx((heatmap(TRUTH) * 6).max())


def test_one_style_per_model_and_every_model_beside_the_truth(caught: list[Figure]) -> None:
    triple_comparison(Path("x"), GRID, TRUTH, {"cnn": FOUND.top(1), "unet": FOUND}, {})
    cnn, unet, both = caught[0].axes[:3]
    looks = [(axes.lines[0].get_marker(), axes.lines[0].get_color()) for axes in (cnn, unet)]
    assert looks == [(line.get_marker(), line.get_color()) for line in both.lines]
    assert looks[0][0] != looks[1][0]
    assert cnn.get_title() == "cnn\n1 predicted, 3 true"
    assert all(len(axes.patches) == 3 for axes in (cnn, unet, both))


def test_contacts_are_drawn_in_millimetres_and_on_the_frame_only_through_a_camera(
    caught: list[Figure],
) -> None:
    overlay(Path("x"), IMAGE, GRID, heatmap(FOUND), TRUTH, FOUND, 6.0)
    overlay(Path("x"), IMAGE, GRID, None, TRUTH, FOUND, 6.0, camera=lambda xy: 64 + 4.5 * xy)
    frame, answer = caught[0].axes[:2]
    assert not frame.lines
    np.testing.assert_allclose(np.column_stack(answer.lines[0].get_data()), FOUND.xy)
    assert {text.get_text() for text in answer.texts} == {"4.0", "2.5", "1.0"}
    mapped = np.column_stack(caught[1].axes[0].lines[-1].get_data())
    np.testing.assert_allclose(mapped, 64 + 4.5 * FOUND.xy)


def test_a_tip_outline_keeps_the_radius_of_the_tip() -> None:
    around = tip_outline(np.array([1.0, -2.0]))
    np.testing.assert_allclose(np.linalg.norm(around - [1.0, -2.0], axis=1), 3.0)


def test_the_extent_reaches_the_outer_borders_of_the_cells() -> None:
    assert extent(GRID) == pytest.approx((-12.8, 12.8, 12.8, -12.8))


@pytest.mark.parametrize(("scale", "edge"), [(0.0123, 0.02), (0.3, 0.3), (7.1, 8.0), (0.0, 0.1)])
def test_histogram_edge_is_a_round_number(scale: float, edge: float) -> None:
    assert histogram_edge(np.full((100, 3), scale)) == pytest.approx(edge)


@given(st.lists(st.floats(0, 10), max_size=8), st.floats(0.01, 2))
def test_spread_labels_keep_their_order_and_do_not_touch(places: list[float], least: float) -> None:
    moved = style.spread(places, least)
    order = np.argsort(places, kind="stable")
    assert (np.diff(np.array(moved)[order]) >= least - 1e-9).all()
    assert np.sum(moved) == pytest.approx(np.sum(places), abs=1e-6)


def test_labels_that_stand_apart_stay() -> None:
    assert style.spread([1.214, 0.383], 0.1) == [1.214, 0.383]


def test_pyplot_is_never_loaded() -> None:
    import subprocess
    import sys

    code = "import sys, tactibench.board.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
