"""Bounds over a workspace, from a sensor whose bounds have a formula."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stubs import StubSensor

from tactibench.board import (
    TWO_FROM_ONE,
    LimitRequest,
    limit_rows,
    limits_of,
    map_limits,
    separation_limit,
    summary,
)
from tactibench.contacts import Grid, Indenter, Pose, Scene
from tactibench.errors import UserError
from tactibench.frames import D_PRIME
from tactibench.geometry import true_contacts
from tactibench.report import (
    image_bytes,
    limit_figure,
    limit_remarks,
    limit_tables,
    terminal_text,
)

GRID = Grid.centred(5, 2.0)


class Formula(StubSensor):
    """sd of x 1 um + 1 um a mm of |x|, of y 2 um, of depth 3 um; x > 3 mm is refused."""

    nuisances = ("light",)

    def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Any:
        if scene.pose.x > 3:
            raise UserError("too far to the right.")
        xy = true_contacts(scene).xy
        light = 4.0 if "light" in nuisances else 1.0
        columns = [1 + np.abs(xy[:, 0]), np.full(len(xy), 2.0), np.full(len(xy), 3.0)]
        return np.diag(light * (1e-3 * np.stack(columns, axis=1).ravel()) ** 2)

    def bound(self, scene: Scene) -> Any:
        return np.sqrt(np.diag(self.covariance(scene))).reshape(-1, 3)


def asked(indenter: Indenter, depths: tuple[float, ...] = (2.0,), **more: Any) -> LimitRequest:
    return LimitRequest(indenter, GRID, depths, **more)


def test_a_map_holds_every_press_and_leaves_refused_cells_empty() -> None:
    seen: list[int] = []
    maps = map_limits(Formula(), asked(Indenter.single(), (1.0, 2.0)), seen.append)
    assert sum(seen) == maps.request.presses == 50
    assert maps.values.shape == (2, 3, 5, 5)
    assert maps.refusal == "too far to the right."
    assert np.isnan(maps.values[..., 4]).all()
    x = np.array([-4.0, -2.0, 0.0, 2.0])
    assert maps.values[1, 0, :, :4] == pytest.approx(np.tile(1e-3 * (1 + np.abs(x)), (5, 1)))
    line = summary(maps)[0]
    assert (line["n"], line["refused"], line["unbounded"]) == (20, 5, 0)
    assert line["middle"] == pytest.approx(1e-3)
    assert line["median"] == pytest.approx(3e-3)
    assert line["worst"] == pytest.approx(5e-3)
    assert line["worst_at"][0] == -4.0


def test_a_sensor_that_refuses_everything_is_heard() -> None:
    far = LimitRequest(Indenter.single(), Grid((3, 3), (4.0, 0.0), 1.0), (1.0,))
    with pytest.raises(UserError, match="too far"):
        map_limits(Formula(), far, lambda _: None)


def test_two_tips_have_the_worse_of_both_and_a_separation() -> None:
    x, y, depth, apart = limits_of(Formula(), Scene(Indenter.dual(4.0), Pose(x=1, depth=2)), ())
    assert (x, y, depth) == pytest.approx((4e-3, 2e-3, 3e-3))
    assert apart == pytest.approx(1e-3 * np.hypot(4, 2))  # along x; sd 1 + |3| and 1 + |-1|
    across = limits_of(Formula(), Scene(Indenter.dual(4.0), Pose(x=1, yaw=90, depth=2)), ())[3]
    assert across == pytest.approx(1e-3 * np.hypot(2, 2))


def test_a_tip_that_does_not_touch_leaves_no_bound() -> None:
    scene = Scene(Indenter(3.0, ((-3, 0, 0), (3, 0, -5)), "uneven"), Pose(depth=1))
    assert limits_of(Formula(), scene, ()) == [np.inf] * 4
    maps = map_limits(Formula(), asked(Indenter.dual(12.0), (0.3,)), lambda _: None)
    line = summary(maps)[0]
    assert line["unbounded"] > 0
    assert line["n"] + line["unbounded"] + line["refused"] == 25
    rows = {(row["metric"], row["group"]): row for row in limit_rows(maps)}
    share = rows["bound_separation_unbounded", "depth 0.3 mm"]
    assert share["value"] == pytest.approx(line["unbounded"] / 25)
    assert all(row["value"] is None or np.isfinite(row["value"]) for row in rows.values())


@given(st.integers(0, 2**32 - 1), st.floats(0, 2 * np.pi))
def test_the_separation_is_that_of_drawn_contacts(seed: int, angle: float) -> None:
    """Delta method against 10,000 draws of both contacts, 2 um around places 7 mm apart."""
    rng = np.random.default_rng(seed)
    root = 2e-3 * rng.normal(size=(6, 6))
    apart = 7 * np.array([np.cos(angle), np.sin(angle)])
    draws = rng.normal(size=(10_000, 6)) @ root.T
    distance = np.linalg.norm(apart + draws[:, :2] - draws[:, 3:5], axis=1)
    assert separation_limit(root @ root.T, apart) == pytest.approx(distance.std(), rel=0.08)


def test_a_separation_needs_both_places_along_it() -> None:
    covariance = np.diag([1.0, np.inf, 1.0, 1.0, 1.0, np.inf])
    assert separation_limit(covariance, np.array([3.0, 0.0])) == pytest.approx(np.sqrt(2))
    assert separation_limit(covariance, np.array([0.0, 3.0])) == np.inf


class Apart(Formula):
    """D = (spacing in mm)^4 times the depth; x < -5 mm refuses."""

    def deviance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Any:
        if scene.pose.x < -5:
            raise UserError("too far to the left.")
        (x1, y1, _), (x2, y2, _) = scene.indenter.offsets
        return scene.pose.depth * np.hypot(x2 - x1, y2 - y1) ** 4


def test_two_tips_are_told_from_one_at_a_few_places() -> None:
    grid = Grid.centred(17, 0.8)
    request = LimitRequest(Indenter.dual(4.0, 1.0), grid, (1.0, 4.0))
    assert request.coarse == Grid.centred(5, 3.2)
    assert LimitRequest(Indenter.dual(4.0), Grid.centred(1, 0.8), (1.0,)).coarse.shape == (1, 1)
    maps = map_limits(Apart(), request, lambda _: None)
    assert maps.spacings is not None
    assert maps.spacings.shape == (2, 5, 5)
    assert np.isnan(maps.spacings[:, :, 0]).all()
    assert maps.spacings[0, :, 1:] == pytest.approx(np.sqrt(D_PRIME), rel=1e-4)
    assert maps.spacings[1, :, 1:] == pytest.approx(np.sqrt(D_PRIME / 2), rel=1e-4)
    lines = [line for line in summary(maps) if line["quantity"] == TWO_FROM_ONE]
    assert [(line["n"], line["refused"]) for line in lines] == [(20, 5), (20, 5)]
    text = " ".join(limit_remarks(maps))
    assert "75% of the pairs" in text
    assert "Below 2 mm" in text
    shown = terminal_text(limit_tables(maps)[1], 80).plain
    assert "1.73" in shown
    rows = {(row["metric"], row["group"]): row["value"] for row in limit_rows(maps)}
    assert rows["limit_mm", "depth 4 mm, median"] == pytest.approx(1.2249, rel=1e-3)


def test_one_tip_or_a_sensor_that_does_not_know_has_no_spacings() -> None:
    for sensor, indenter in ((Apart(), Indenter.single()), (Formula(), Indenter.dual(2.0))):
        maps = map_limits(sensor, asked(indenter), lambda _: None)
        assert maps.spacings is None


def test_a_bound_beyond_the_dome_is_none() -> None:
    class Rounded(StubSensor):
        def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Any:
            return np.diag([1e-6, 1e-6, 1e-6, 1e12, 1e-6, 1e-6])

    scene = Scene(Indenter.dual(4.0), Pose(depth=2))
    assert limits_of(Rounded(), scene, ()) == pytest.approx([np.inf, 1e-3, 1e-3, np.inf])


def test_the_table_names_what_is_left_out() -> None:
    maps = map_limits(Formula(), asked(Indenter.dual(9.0), (0.4,)), lambda _: None)
    text = " ".join(limit_remarks(maps))
    assert "of the worse of the two tips" in text
    assert "are refused: too far to the right." in text
    assert "have no bound" in text
    lines = terminal_text(limit_tables(maps)[0], 80).plain.splitlines()
    assert max(map(len, lines)) <= 80


def test_the_map_shows_empty_and_unbounded_cells() -> None:
    maps = map_limits(Formula(), asked(Indenter.dual(9.0), (0.4,)), lambda _: None)
    figure = limit_figure(maps, measured_on="simulated " * 30)
    assert image_bytes(figure, "png").startswith(b"\x89PNG")
