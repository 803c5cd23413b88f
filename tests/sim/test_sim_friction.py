"""Drag of the skin: closed forms, limits, and finite elements that made no table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from other_scenes import sideways

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench_sim import (
    FrictionMechanics,
    ReferenceScene,
    TableMechanics,
    TacTip127,
    TacTip331,
    Tips,
    layout,
    reference_scenes,
    shipped_dome,
    tip_drag,
    tips_of,
)

Array = npt.NDArray[np.float64]
PINS = layout(127)
NAMES = {1: "single", 2: "pair", 3: "triple"}
RUBBED = [scene for scene in reference_scenes() if scene.friction]
FRICTIONLESS = TableMechanics(shipped_dome(), "coupled", other_tips=True)


def moved(scene: Scene, dx: float = 0.0, dy: float = 0.0, dyaw: float = 0.0) -> Tips:
    return tips_of([replace(scene, pose=replace(scene.pose, dx=dx, dy=dy, dyaw=dyaw))])


def single(x: float = 0.0, y: float = 0.0, depth: float = 2.0, radius: float = 3.0) -> Scene:
    return Scene(Indenter.single(radius), Pose(x, y, depth=depth))


def bases(friction: float, tips: Tips) -> Array:
    mechanics = FrictionMechanics(FRICTIONLESS, friction)
    return mechanics.displacement(mechanics.loads(tips), PINS)[0][0]


def sideways_force(friction: float, tips: Tips) -> Array:
    loads = FrictionMechanics(FRICTIONLESS, friction).loads(tips)
    return np.asarray(loads.pulls[0].force[0])


class TestNothingIsDragged:
    def test_a_press_at_the_apex_is_the_one_without_friction(self) -> None:
        tips = tips_of([single()])
        assert (
            bases(0.8, tips) == FRICTIONLESS.displacement(FRICTIONLESS.loads(tips), PINS)[0][0]
        ).all()

    def test_a_plate_goes_down_along_its_normal_and_drags_nothing(self) -> None:
        tips = tips_of([Scene(Indenter.plate(), Pose(tilt=12, yaw=30, depth=3))])
        assert not sideways_force(0.8, tips).any()

    def test_a_sensor_without_friction_makes_the_same_frame_of_a_moved_pose(self) -> None:
        context = SensorContext(np.random.SeedSequence(0))
        down, side = single(2, 1), Scene(Indenter.single(), Pose(2, 1, depth=2.0, dx=1.0, dyaw=20))
        frames = [TacTip127(context, friction=0.0).press(scene).image for scene in (down, side)]
        assert (frames[0] == frames[1]).all()

    def test_the_drag_fades_continuously_as_the_tip_lifts(self) -> None:
        sizes = []
        for depth in (0.1, 0.01, 0.001, 1e-6):
            down = single(depth=depth)
            sizes.append(abs(bases(0.8, moved(down, dx=1.0)) - bases(0.8, tips_of([down]))).max())
        assert sizes[0] < 0.1
        assert (np.diff(sizes) < 0).all()
        assert sizes[-1] < 1e-5


class TestLaw:
    def test_a_short_move_is_followed_and_a_long_one_slips_at_coulombs_limit(self) -> None:
        rubbing = FrictionMechanics(FRICTIONLESS, 0.8)
        normal = float(rubbing.forces(rubbing.loads(tips_of([single()])))[0, 0])
        compliance = float(tip_drag(3.0).compliance_at(np.array(2.0)))
        short = sideways_force(0.8, moved(single(0.01), dx=0.01))[0]
        assert short[0] == pytest.approx(0.01 / compliance, rel=0.02)
        long = sideways_force(0.8, moved(single(), dx=5.0))[0]
        assert long[0] == pytest.approx(0.8 * normal, rel=1e-9)
        assert abs(long[1:]).max() < 1e-12

    def test_half_way_to_the_slip_the_force_is_mindlins(self) -> None:
        rubbing = FrictionMechanics(FRICTIONLESS, 0.4)
        normal = float(rubbing.forces(rubbing.loads(tips_of([single()])))[0, 0])
        compliance = float(tip_drag(3.0).compliance_at(np.array(2.0)))
        way = 0.5 * 1.5 * 0.4 * normal * compliance
        force = sideways_force(0.4, moved(single(way), dx=way))[0, 0]
        assert force == pytest.approx(0.4 * normal * (1 - 0.5**1.5), rel=0.01)

    @pytest.mark.parametrize("x", [2.0, 6.0, 10.0])
    def test_a_tip_beside_the_apex_slides_and_pulls_the_skin_up_the_side(self, x: float) -> None:
        """Down by d it slides d sin(angle) over the skin, which spreads by 0.08 d to all sides."""
        tips = tips_of([single(x, depth=3.0)])
        mechanics = FrictionMechanics(FRICTIONLESS, 0.05)
        loads = mechanics.loads(tips)
        force, normal = loads.pulls[0].force[0, 0], mechanics.forces(loads)[0, 0]
        slide = np.sqrt(1 - tips.directions()[0][0, 0, 2] ** 2)
        pull = 0.05 * normal * slide / np.hypot(slide, 0.08)
        assert np.linalg.norm(force) == pytest.approx(pull, rel=0.1)
        assert abs(force @ loads.pressed[0].n[0, 0]) < 0.02 * np.linalg.norm(force)
        assert force[0] > 0 > force[2]  # it takes the skin down the side with it

    def test_a_tip_that_sticks_takes_the_skin_all_the_way(self) -> None:
        """With friction so large that nothing slips, the force is the slide over the compliance."""
        tips = tips_of([single(4.0, depth=0.5)])
        force = np.linalg.norm(sideways_force(50.0, tips)[0])
        n, delta = tips.directions()
        slide = 0.5 * np.sqrt(1 - n[0, 0, 2] ** 2)
        soft = float(tip_drag(3.0).compliance_at(delta[0, 0]))
        assert force == pytest.approx(slide / soft, rel=0.1)

    def test_coulombs_limit_holds_in_pairs_and_triples(self) -> None:
        rng = np.random.default_rng(5)
        for count, spacing in ((2, 7.0), (3, 8.0)):
            turn = 2 * np.pi * np.arange(count) / count
            around = spacing / 2 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
            xy = rng.uniform(-5, 5, (20, 1, 2)) + around
            tips = Tips(xy, rng.uniform(0.2, 3, (20, count)), np.full(20, 3.0))
            mechanics = FrictionMechanics(FRICTIONLESS, 0.5)
            loads = mechanics.loads(tips)
            pulled = np.linalg.norm(loads.pulls[0].force, axis=-1)
            assert (pulled <= 0.5 * mechanics.forces(loads) * 1.05 + 1e-3).all()

    def test_a_pair_that_turns_pulls_with_two_opposite_forces(self) -> None:
        pair = Scene(Indenter.dual(8.0), Pose(depth=2.0))
        force = sideways_force(0.8, moved(pair, dyaw=3.0))
        np.testing.assert_allclose(force[0] * [1, 1, -1], -force[1], atol=1e-8)

    def test_a_single_tip_that_turns_about_its_axis_drags_nothing(self) -> None:
        turned, still = moved(single(2, 1), dyaw=90.0), tips_of([single(2, 1)])
        np.testing.assert_allclose(bases(0.8, turned), bases(0.8, still), atol=1e-9)


@pytest.mark.parametrize("turn", [37.0, 90.0, 180.0])
def test_turning_the_scene_turns_the_field(turn: float) -> None:
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    spin = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    mechanics = FrictionMechanics(FRICTIONLESS, 0.7)
    one = moved(single(4, 0), dx=0.5, dy=0.2)
    place, way = spin[:2, :2] @ [4, 0], spin[:2, :2] @ [0.5, 0.2]
    other = moved(single(*place), dx=way[0], dy=way[1])
    first = mechanics.displacement(mechanics.loads(one), PINS)
    second = mechanics.displacement(mechanics.loads(other), PINS @ spin.T)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(b, a @ spin.T, atol=1e-11)


BOUNDS_MM = {"single": (0.15, 0.036), "pair": (0.08, 0.022), "triple": (0.08, 0.02)}
"""Measured: largest and median error of a pin base in the scenes to 3 mm depth, by kind."""


@pytest.mark.parametrize("scene", RUBBED, ids=lambda scene: scene.label)
def test_the_field_is_that_of_finite_elements_with_friction(scene: ReferenceScene) -> None:
    mechanics = FrictionMechanics(FRICTIONLESS, scene.friction)
    fields = [
        each.displacement(each.loads(scene.as_tips), scene.directions)[0][0]
        for each in (mechanics, FRICTIONLESS)
    ]
    error, without = (np.linalg.norm(field - scene.displacement, axis=1) for field in fields)
    largest, median = BOUNDS_MM[NAMES[len(scene.tips)]]
    if scene.depth <= 3:
        assert error.max() < largest
        assert np.median(error) < median
    assert error.max() < without.max()
    assert np.median(error) < np.median(without) + 0.002


def test_a_scene_has_one_field_whatever_else_is_in_the_batch() -> None:
    scenes = [
        Scene(Indenter.single(), Pose(2, 1, depth=2.0, dx=0.4)),
        Scene(Indenter.dual(7.0), Pose(depth=3.0, dx=0.4, dyaw=4.0)),
        Scene(Indenter.plate(), Pose(tilt=8.0, yaw=20.0, depth=2.0, dx=0.4)),
        Scene(Indenter.single(1.4), Pose(3, 3, depth=1.0, dy=0.2)),
        single(3, 0),
    ]
    mechanics = FrictionMechanics(FRICTIONLESS, 0.6)
    together = mechanics.displacement(mechanics.loads(tips_of(scenes)), PINS)[0]
    for scene, field in zip(scenes, together, strict=True):
        alone = mechanics.displacement(mechanics.loads(tips_of([scene])), PINS)[0][0]
        assert (alone == field).all()


class TestBadInput:
    @pytest.mark.parametrize(
        ("move", "message"),
        [
            ({"dx": 200.0}, "a move must be within 100 mm"),
            ({"dyaw": 270.0}, "180 deg"),
            ({"dy": float("nan")}, "must be finite"),
        ],
    )
    def test_a_move_that_cannot_be_is_refused(self, move: dict[str, float], message: str) -> None:
        with pytest.raises(UserError, match=message):
            moved(single(), **move)

    @pytest.mark.parametrize("radius", [0.9, 8.1, 10.0])
    def test_a_radius_beyond_the_tables_of_drag_is_refused(self, radius: float) -> None:
        with pytest.raises(UserError, match=r"drag for 1 to 8 mm.*sensor\.friction"):
            tip_drag(radius)


SIDEWAYS_MM = {"back_5": (0.068, 0.026), "sharp_5": (0.017, 0.009)}
"""Measured: largest and median error of a pin base. The pull that turns round lags by half."""


@pytest.mark.parametrize("run", SIDEWAYS_MM)
def test_a_press_that_goes_sideways_is_that_of_finite_elements(run: str) -> None:
    mechanics = FrictionMechanics(FRICTIONLESS, 0.5)
    largest, median = SIDEWAYS_MM[run]
    for tips, directions, u in sideways(run):
        error, without = (
            np.linalg.norm(each.displacement(each.loads(tips), directions)[0][0] - u, axis=1)
            for each in (mechanics, FRICTIONLESS)
        )
        assert error.max() < min(largest, without.max())
        assert np.median(error) < min(median, np.median(without))


def random_path(rng: np.random.Generator) -> Callable[[float], Scene]:
    """Return a press whose depth, place, turn or spacing grows with the argument, mm."""
    kind, what = rng.integers(3), rng.choice(["depth", "x", "yaw", "spacing"])
    radius, turn, yaw = 8 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi), rng.uniform(0, 180)
    depth, spacing = rng.uniform(0, 5.2 if kind == 0 else 3.2), rng.uniform(0.01, 12)
    heights = (0.0, *rng.uniform(0, 1.5, 2).tolist())

    def scene(way: float) -> Scene:
        goes = {name: way if name == what else 0.0 for name in ("depth", "x", "yaw", "spacing")}
        indenter = (
            Indenter.single(),
            Indenter.dual(spacing + goes["spacing"]),
            Indenter.triple(heights),
        )[kind]
        x, y = radius * np.cos(turn) + goes["x"], radius * np.sin(turn)
        pose = Pose(x, y, yaw + np.degrees(goes["yaw"] / 4), depth=depth + goes["depth"])
        return Scene(indenter, pose)

    return scene


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("kind", [TacTip127, TacTip331])
def test_no_pin_jumps_on_any_path(kind: type[TacTip127], friction: float) -> None:
    """The largest step of 0.02 mm is halved and halved again: a jump would stay as it is.

    At 1e-4 mm it is at most 0.002 px.
    """
    sensor = kind(SensorContext(np.random.SeedSequence(0)), friction=friction)
    rng = np.random.default_rng(3)

    def largest_step(scene: Callable[[float], Scene], ways: Array) -> tuple[int, float]:
        x, y, _ = sensor.renderer.project(sensor.points([scene(way) for way in ways.tolist()]))
        steps = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).max(axis=1)
        return int(steps.argmax()), float(steps.max())

    for _ in range(25):
        scene, ways = random_path(rng), np.linspace(0.0, 0.8, 41)
        while ways[1] - ways[0] > 1e-4:
            at, step = largest_step(scene, ways)
            ways = np.linspace(ways[at], ways[at + 1], 6)
        _, step = largest_step(scene, ways)
        assert step <= 0.002 * max((ways[1] - ways[0]) / 1e-4, 0.1)
