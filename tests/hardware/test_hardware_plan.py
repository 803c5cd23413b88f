"""Plans are checked before anything moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fake_station import make_settings
from hypothesis import given
from hypothesis import strategies as st

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.geometry import true_contacts
from tactibench.lab import Press
from tactibench_tactip import (
    CollectionPlan,
    EnvelopeSettings,
    Pose6,
    PressGeometry,
    Settings,
    check_plan,
    describe_indenter,
    envelope_violation,
    geometry_of,
    is_mounted,
    move_seconds,
    plan_of,
    with_smallest_turn,
)

KEYS = EnvelopeSettings()
HOME: Pose6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def one(scene: Scene) -> CollectionPlan:
    return CollectionPlan("test", (Press(0, "first", scene),), {})


def geometry(settings: Settings, z0: float = 0.0) -> PressGeometry:
    return geometry_of(settings).with_z0(z0)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (HOME, ""),
        ((12.0, -12.0, 10.0, 0.0, 0.0, 180.0), ""),
        ((12.1, 0.0, 0.0, 0.0, 0.0, 0.0), "half_width_mm"),
        ((0.0, float("nan"), 0.0, 0.0, 0.0, 0.0), "half_width_mm"),
        ((0.0, 0.0, -60.1, 0.0, 0.0, 0.0), "above_mm"),
        ((0.0, 0.0, 10.1, 0.0, 0.0, 0.0), "below_mm"),
        ((0.0, 0.0, float("nan"), 0.0, 0.0, 0.0), "above_mm"),
        ((0.0, 0.0, 0.0, float("nan"), 0.0, 0.0), "tilt_deg"),
        ((0.0, 0.0, 0.0, 0.0, float("nan"), 0.0), "tilt_deg"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, float("nan")), "yaw_deg"),
        ((0.0, 0.0, 0.0, 25.5, 0.0, 0.0), "tilt_deg"),
        ((0.0, 0.0, 0.0, 0.0, -26.0, 0.0), "tilt_deg"),
    ],
)
def test_the_envelope(pose: Pose6, message: str) -> None:
    assert message in envelope_violation(KEYS, pose)
    assert bool(message) == bool(envelope_violation(KEYS, pose))
    assert "yaw_deg" in envelope_violation(EnvelopeSettings(yaw_deg=90.0), (0, 0, 0, 0, 0, 91.0))


NOWHERE: Pose6 = (float("nan"),) * 6


@pytest.mark.parametrize(
    ("start", "pose", "message"),
    [
        ((0.0, 0.0, 12.0, 0.0, 0.0, 0.0), (0.0, 0.0, 11.9, 0.0, 0.0, 0.0), ""),
        ((0.0, 0.0, 12.0, 0.0, 0.0, 0.0), (0.0, 0.0, 12.1, 0.0, 0.0, 0.0), "below_mm"),
        ((0.0, 0.0, 12.0, 0.0, 0.0, 0.0), (0.0, 0.0, -61.0, 0.0, 0.0, 0.0), "above_mm"),
        ((0.0, 0.0, -80.0, 0.0, 0.0, 0.0), (0.0, 0.0, -79.5, 0.0, 0.0, 0.0), ""),
        ((40.0, 0.0, -30.0, 0.0, 0.0, 0.0), (30.0, 0.0, -30.0, 0.0, 0.0, 0.0), ""),
        ((40.0, 0.0, -30.0, 0.0, 0.0, 0.0), (-13.0, 0.0, -30.0, 0.0, 0.0, 0.0), "half_width_mm"),
        ((0.0, 0.0, 3.0, 40.0, 0.0, 0.0), (0.0, 0.0, -30.0, 40.0, 0.0, 0.0), ""),
        ((0.0, 0.0, 3.0, 40.0, 0.0, 0.0), (0.0, 0.0, -30.0, 41.0, 0.0, 0.0), "tilt_deg"),
        (NOWHERE, HOME, ""),
        (NOWHERE, (12.1, 0.0, 0.0, 0.0, 0.0, 0.0), "half_width_mm"),
        (NOWHERE, (0.0, 0.0, 0.0, 26.0, 0.0, 0.0), "tilt_deg"),
    ],
)
def test_the_way_back_into_the_envelope_is_free(start: Pose6, pose: Pose6, message: str) -> None:
    assert message in envelope_violation(KEYS, pose, start)
    assert bool(message) == bool(envelope_violation(KEYS, pose, start))


@pytest.mark.parametrize(
    ("scene", "reason"),
    [
        (Scene(Indenter.single(), Pose(13.0, 0.0, depth=1.0)), "half_width_mm"),
        (Scene(Indenter.single(), Pose(depth=6.6)), "deepest_mm"),
        (Scene(Indenter.plate(), Pose(tilt=30.0, depth=1.0)), "half_width_mm"),
    ],
)
def test_a_plan_that_leaves_the_envelope_is_refused(
    settings: Settings, scene: Scene, reason: str
) -> None:
    with pytest.raises(UserError, match=f"1 of 1 presses of test are refused.*{reason}"):
        check_plan(one(scene), settings, geometry(settings), turns=True)


def test_a_stage_refuses_what_it_would_have_to_turn(settings: Settings) -> None:
    plan = one(Scene(Indenter.dual(8.0), Pose(yaw=30.0, depth=1.0)))
    check_plan(plan, settings, geometry(settings), turns=True)
    with pytest.raises(UserError, match=r"turn of 30.0 deg.*--draw"):
        check_plan(plan, settings, geometry(settings), turns=False)
    check_plan(
        one(Scene(Indenter.dual(8.0), Pose(yaw=180.0, depth=1.0))),
        settings,
        geometry(settings),
        turns=False,
    )


@given(st.floats(0.0, 360.0), st.sampled_from([1, 2, 3, 4]))
def test_the_smallest_turn_presses_the_same_contacts(yaw: float, kind: int) -> None:
    indenter = {
        1: Indenter.single(),
        2: Indenter.dual(9.0),
        3: Indenter.triple((1.0, 1.0, 1.0)),
        4: Indenter.triple((0.0, 0.5, 1.0)),
    }[kind]
    scene = Scene(indenter, Pose(1.0, -2.0, yaw, 0.0, 3.0))
    found = with_smallest_turn(scene)
    assert abs(found.pose.yaw) <= {1: 0.0, 2: 90.0, 3: 60.0, 4: 180.0}[kind] + 1e-9
    one, other = (true_contacts(s) for s in (scene, found))
    order = [np.lexsort(np.round(c.xy.T, 6)) for c in (one, other)]
    assert one.xy[order[0]] == pytest.approx(other.xy[order[1]], abs=1e-6)
    assert one.depth[order[0]] == pytest.approx(other.depth[order[1]], abs=1e-6)


def test_mounts_and_words(settings: Settings) -> None:
    mounted = settings.indenter.indenter()
    assert is_mounted(mounted, Indenter.single())
    assert not is_mounted(mounted, Indenter.single(2.0))
    assert not is_mounted(mounted, Indenter.dual(8.0))
    for indenter in (Indenter.dual(7.5), Indenter.triple((0.0, 3.0, 1.0)), Indenter.plate()):
        assert is_mounted(indenter, indenter)
        assert not is_mounted(mounted, indenter)
        assert describe_indenter(indenter)
    assert not is_mounted(Indenter.dual(8.0), Indenter.dual(8.5))


@pytest.fixture
def plan_file(tmp_path: Path) -> str:
    """Single presses 3, 4 and 6 and pairs 5 and 7, in the order of their numbers."""
    row = (
        '{{"id": {}, "draw": "{}", "indenter": "{}", "indenter_radius_mm": 3.0, '
        '"indenter_offsets_mm": {}, "x_mm": 1.0, "y_mm": 0.0, "depth_mm": 2.0}}'
    )
    single, pair = ("singles", "single", [[0, 0, 0]]), ("pairs", "dual", [[-4, 0, 0], [4, 0, 0]])
    rows = [row.format(k, *(pair if k in (5, 7) else single)) for k in (3, 4, 5, 6, 7)]
    path = tmp_path / "plan.jsonl"
    path.write_text("\n".join(rows) + "\n")
    return str(path)


def test_presses_of_one_indenter_come_together(settings: Settings, plan_file: str) -> None:
    plan = plan_of(plan_file, settings)
    assert [press.id for press in plan.presses] == [3, 4, 6, 5, 7]
    assert [row["id"] for row in plan.rows()] == [3, 4, 6, 5, 7]


def test_a_draw_has_a_count_of_its_own(settings: Settings, plan_file: str) -> None:
    plan = plan_of(plan_file, settings, draws=("singles=2", "pairs"), count=1)
    assert [press.id for press in plan.presses] == [3, 6, 7]  # evenly spread
    with pytest.raises(UserError, match="write singles=N"):
        plan_of(plan_file, settings, draws=("singles=no",))
    with pytest.raises(UserError, match="no draw 'single'"):
        plan_of(plan_file, settings, draws=("single=3",))


def test_time_of_a_move_in_closed_form() -> None:
    start, end = HOME, (30.0, 40.0, 0.0, 0.0, 0.0, 0.0)
    assert move_seconds(start, end, 20.0, 500.0) == pytest.approx(50 / 20 + 20 / 500)
    assert move_seconds(start, (0.2, 0, 0, 0, 0, 0), 20.0, 500.0) == pytest.approx(2 * 0.02)
    assert move_seconds(start, (0, 0, 0, 0, 0, 90.0), 20.0, 500.0) == pytest.approx(1.8)


@pytest.mark.long
def test_deeper_than_the_sensor_is_not_drawn() -> None:
    shallow = make_settings(sensor={"deepest_mm": 3.0})
    plan = plan_of("exp1", shallow, draws=("singles",), count=20)
    assert len(plan) == 20
    assert max(press.scene.pose.depth for press in plan.presses) <= 3.0
    check_plan(plan, shallow, geometry(shallow), turns=False)
