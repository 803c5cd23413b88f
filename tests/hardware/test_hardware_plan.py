"""Plans are checked before anything moves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
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
    estimate_seconds,
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


def test_a_plate_is_limited_in_tilt(make: Callable[..., Settings]) -> None:
    settings = make(envelope={"half_width_mm": 20.0})
    steep, flat = (one(Scene(Indenter.plate(), Pose(tilt=t, depth=1.0))) for t in (26.0, 20.0))
    check_plan(flat, settings, geometry(settings), turns=True)
    with pytest.raises(UserError, match="tilt_deg"):
        check_plan(steep, settings, geometry(settings), turns=True)


def test_first_touch_far_below_makes_a_plan_leave_the_envelope(settings: Settings) -> None:
    plan = one(Scene(Indenter.single(), Pose(depth=6.0)))
    check_plan(plan, settings, geometry(settings), turns=True)
    with pytest.raises(UserError, match="below_mm"):
        check_plan(plan, settings, geometry(settings, 4.5), turns=True)


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


def test_sideways_motion_is_at_one_height_for_all_presses(settings: Settings) -> None:
    scenes = [
        Scene(Indenter.single(), Pose(x, y, depth=2.0)) for x, y in ((0, 0), (6, -6), (-3, 5))
    ]
    heights = [geometry(settings).path(scene).above[2] for scene in scenes]
    assert heights == pytest.approx([-settings.envelope.clearance_mm] * 3)


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


def test_a_plan_file(settings: Settings, tmp_path: Path) -> None:
    path = tmp_path / "plan.jsonl"
    rows = [
        '{"id": 3, "indenter": "single", "indenter_radius_mm": 3.0, "x_mm": 1.0, "y_mm": 0.0, '
        '"depth_mm": 2.0}',
        '{"id": 5, "indenter": "dual", "indenter_radius_mm": 3.0, "indenter_offsets_mm": '
        '[[-4, 0, 0], [4, 0, 0]], "x_mm": 0.0, "y_mm": 0.0, "depth_mm": 1.0}',
        '{"id": 4, "indenter": "single", "indenter_radius_mm": 3.0, "x_mm": 2.0, "y_mm": 0.0, '
        '"depth_mm": 2.0}',
    ]
    path.write_text("\n".join(rows) + "\n")
    plan = plan_of(str(path), settings)
    assert [press.id for press in plan.presses] == [3, 4, 5]  # one indenter after the other
    assert [len(presses) for _, presses in plan.mounts()] == [2, 1]
    assert len(plan_of(str(path), settings, count=1)) == 2
    assert [row["id"] for row in plan.rows()] == [3, 4, 5]
    with pytest.raises(UserError, match="no draw 'singles'"):
        plan_of(str(path), settings, draws=("singles",))


def test_a_draw_has_a_count_of_its_own(settings: Settings) -> None:
    plan = plan_of("exp2", settings, draws=("singles=26", "pairs=2", "catch"), count=5)
    taken = Counter(press.draw for press in plan.presses)
    assert taken == {"singles": 26, "pairs": 2 * 12, "catch": 5}  # 12 distances
    with pytest.raises(UserError, match="write singles=N"):
        plan_of("exp2", settings, draws=("singles=no",))
    with pytest.raises(UserError, match="no draw 'single'"):
        plan_of("exp2", settings, draws=("single=3",))


def test_time_of_a_move_in_closed_form() -> None:
    start, end = HOME, (30.0, 40.0, 0.0, 0.0, 0.0, 0.0)
    assert move_seconds(start, end, 20.0, 500.0) == pytest.approx(50 / 20 + 20 / 500)
    assert move_seconds(start, (0.2, 0, 0, 0, 0, 0), 20.0, 500.0) == pytest.approx(2 * 0.02)
    assert move_seconds(start, (0, 0, 0, 0, 0, 90.0), 20.0, 500.0) == pytest.approx(1.8)


def test_the_estimate_counts_every_press(settings: Settings) -> None:
    press = Press(0, "p", Scene(Indenter.single(), Pose(depth=3.0)))
    few, many = (estimate_seconds([press] * n, settings) for n in (10, 20))
    assert 1.5 < (many - few) / 10 < 6.0


@pytest.mark.long
def test_deeper_than_the_sensor_is_not_drawn(make: Callable[..., Settings]) -> None:
    shallow = make(sensor={"deepest_mm": 3.0})
    plan = plan_of("exp1", shallow, draws=("singles",), count=20)
    assert len(plan) == 20
    assert max(press.scene.pose.depth for press in plan.presses) <= 3.0
    check_plan(plan, shallow, geometry(shallow), turns=False)
