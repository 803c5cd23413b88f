"""Cramer-Rao bounds of the simulated TacTip: symmetric, stable, and reached by least squares."""

import functools

import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.geometry import true_contacts
from tactibench_sim import (
    NUISANCES,
    Fitted127,
    Reference127,
    TacTip127,
    Tips,
    information,
    inverse,
    streams,
    tips_of,
)
from tactibench_sim import covariance as bound_of

SCENES = {
    "single": Scene(Indenter.single(), Pose(1.3, -0.8, depth=1.7)),
    "shallow": Scene(Indenter.single(), Pose(-2.1, 0.4, depth=0.05)),
    "deep": Scene(Indenter.single(), Pose(0.2, 3.0, depth=6.0)),
    "dual": Scene(Indenter.dual(7.0), Pose(0.6, -0.4, 25.0, depth=2.0)),
    "triple": Scene(Indenter.triple((0.0, 0.5, 1.0)), Pose(0.3, 0.2, 70.0, depth=3.0)),
    "plate": Scene(Indenter.plate(), Pose(yaw=30, tilt=8, depth=2.0)),
}


@functools.cache
def sensor(**parameters):
    return TacTip127(SensorContext(np.random.SeedSequence(3)), **parameters)


def covariance(scene, nuisances=(), step=0.004, **parameters):
    one = sensor(**parameters)
    tips = scene if isinstance(scene, Tips) else tips_of([scene])
    return bound_of(tips, one.clean, one.renderer.variance, nuisances, step)


def deviations(matrix):
    return np.sqrt(np.diag(matrix)).reshape(-1, 3)


@pytest.mark.parametrize(
    ("name", "nuisances"), [("shallow", ()), ("dual", NUISANCES), ("plate", ())]
)
def test_the_step_does_not_matter_over_a_decade(name, nuisances):
    reference = deviations(covariance(SCENES[name], nuisances))
    for step in (0.001, 0.01):
        found = deviations(covariance(SCENES[name], nuisances, step))
        assert found == pytest.approx(reference, rel=1e-3)


def turned(scene, degrees):
    pose = scene.pose
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    place = c * pose.x - s * pose.y, s * pose.x + c * pose.y
    return Scene(scene.indenter, Pose(*place, pose.yaw + degrees, pose.tilt, pose.depth))


@pytest.mark.parametrize(("degrees", "within"), [(180, 1e-6), (60, 0.02)])
def test_a_turned_press_has_the_turned_covariance(degrees, within):
    """The pins turn onto themselves by 60 deg, pixels by 90: exact by 180, else up to sampling."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turns = np.kron(np.eye(2), turn)
    expected = turns @ covariance(SCENES["dual"], size=256) @ turns.T
    found = covariance(turned(SCENES["dual"], degrees), size=256)
    scale = np.sqrt(np.diag(expected))
    unit = np.outer(scale, scale)
    assert np.abs(found / unit - expected / unit).max() < within


def test_tips_that_do_not_touch_do_not_count():
    alone = tips_of([SCENES["single"]])
    beside = Tips(
        np.concatenate([alone.xy, [[[9.0, 0.0]]]], axis=1),
        np.concatenate([alone.depth, [[-0.3]]], axis=1),
        alone.radius,
    )
    assert covariance(beside) == pytest.approx(covariance(alone), rel=1e-9)


def gauss_newton(one, frames, start, radius, rounds):
    """(N, U) least-squares estimates from (N, H W) frames with the simulator itself.

    The U unknowns are x, y and depth of each contact, and then friction where one more is given.
    """
    guess = np.tile(start, (len(frames), 1))
    for _ in range(rounds):
        image, slopes = linear(one, guess, radius)
        weight = slopes / np.asarray(one.renderer.variance(image))[:, None]
        left = weight @ slopes.transpose(0, 2, 1)
        right = weight @ (frames - image)[..., None]
        guess = guess + np.linalg.solve(left, right)[..., 0]
    return guess


def linear(one, values, radius, h=0.005):
    """(N, H W) frames of (N, U) unknowns and (N, U, H W) their slopes, forward differences."""
    n, unknown = values.shape
    moved = values[:, None] + np.vstack([np.zeros(unknown), h * np.eye(unknown)])
    rows = moved.reshape(n * (unknown + 1), unknown)
    count = 3 * (unknown // 3)
    parts = rows[:, :count].reshape(len(rows), -1, 3)
    friction = rows[:, -1] if unknown > count else None
    radii = np.full(len(parts), radius)
    images = one.clean(Tips(parts[..., :2], parts[..., 2], radii, friction=friction))
    images = images.reshape(n, unknown + 1, -1)
    return images[:, 0], (images[:, 1:] - images[:, :1]) / h


@pytest.mark.long
def test_least_squares_reaches_the_bound():
    """Gauss-Newton on noisy 8-bit frames, from 0.05 mm beside the truth: its spread is the bound.

    The spread of 500 estimates is known to 3.2 %.
    """
    one, scene, count = sensor(size=64, friction_within=0.0), SCENES["dual"], 500
    tips = tips_of([scene])
    with one:
        frames = [f.image for f in one.press_many([scene] * count)]
    frames = np.stack(frames).reshape(count, -1).astype(float)
    truth = np.concatenate([tips.xy[0], tips.depth[0][:, None]], axis=1).ravel()
    blocks = np.array_split(frames, 10)
    found = np.concatenate(
        [gauss_newton(one, block, truth + 0.05, tips.radius[0], rounds=4) for block in blocks]
    )
    expected = covariance(scene, size=64)
    sd = np.sqrt(np.diag(expected))
    assert found.std(axis=0, ddof=1) == pytest.approx(sd, rel=0.10)
    assert np.abs(found.mean(axis=0) - truth).max() < 5 * sd.max() / np.sqrt(count)
    separation = np.linalg.norm(found[:, :2] - found[:, 3:5], axis=1)
    apart = truth[:2] - truth[3:5]
    g = np.array([*apart, 0, *-apart, 0]) / np.linalg.norm(apart)
    assert separation.std(ddof=1) == pytest.approx(np.sqrt(g @ expected @ g), rel=0.10)


@pytest.mark.long
def test_least_squares_reaches_the_bound_with_friction_unknown():
    """The spread of 400 estimates of x, y, depth and friction is known to 3.5 %."""
    scene, count = Scene(Indenter.single(), Pose(3.2, -1.9, depth=2.2)), 400
    one = sensor(size=64, friction=0.5)
    points = np.repeat(one.points([scene]), count, axis=0)
    frames = one.renderer.frames(points, streams(np.random.SeedSequence(5), 0, count))
    frames = frames.reshape(count, -1).astype(float)
    truth = np.array([3.2, -1.9, 2.2, 0.5])
    found = gauss_newton(one, frames, truth + 0.03, 3.0, rounds=4)
    tips = one.indenter_tips([scene])
    full = inverse(information(tips, one.clean, one.renderer.variance, ("friction",)))
    assert found.std(axis=0, ddof=1) == pytest.approx(np.sqrt(np.diag(full)), rel=0.12)
    assert np.abs(found.mean(axis=0) - truth).max() < 5 * np.sqrt(np.diag(full).max() / count)
    unknown, known = one.covariance(scene, ("friction",)), one.covariance(scene)
    assert unknown == pytest.approx(full[:3, :3], rel=1e-6)
    assert (np.diag(unknown) > np.diag(known)).all()


def test_friction_is_a_nuisance_of_sensors_that_rub():
    scene = SCENES["dual"]
    rubbing, smooth = sensor(friction=0.5), sensor(friction=0.0)
    assert set(rubbing.nuisances) - set(smooth.nuisances) == {"friction"}
    assert rubbing.deviance(scene, ("friction",)) < rubbing.deviance(scene)
    with pytest.raises(UserError, match="no nuisance 'friction'"):
        smooth.covariance(scene, ("friction",))


def test_a_bound_is_one_row_a_contact():
    one = sensor()
    for name, scene in SCENES.items():
        limits = one.bound(scene)
        assert limits.shape == (len(true_contacts(scene)), 3)
        assert (limits > 0).all()
        assert limits.max() < (1.0 if name == "shallow" else 0.1)
    assert one.bound(Scene(Indenter.single(), Pose())).shape == (0, 3)
    assert np.isfinite(one.bound(Scene(Indenter.single(), Pose(depth=6.5)))).all()


def test_a_bound_falls_with_the_noise():
    scene = Scene(Indenter.single(), Pose(depth=1.5))
    quiet = sensor(read_noise=1.0, full_well=1e9).bound(scene)
    loud = sensor(read_noise=4.0, full_well=1e9).bound(scene)
    ratio = np.sqrt((16 + 1 / 12) / (1 + 1 / 12))
    assert loud / quiet == pytest.approx(np.full((1, 3), ratio), rel=1e-3)


def test_sensors_whose_presses_are_drawn_or_listed_have_no_bound():
    scene = Scene(Indenter.single(), Pose(depth=1.5))
    for kind in (Fitted127, Reference127):
        one = kind(SensorContext(np.random.SeedSequence(0)))
        assert one.nuisances == ()
        assert one.bound(scene) is one.covariance(scene) is one.deviance(scene) is None
