from __future__ import annotations

import drawn_pins
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from tac_vgnn import tac_vgnn_folder

from tactibench import Indenter, Pose, Scene, SensorContext, UserError
from tactibench.markers import Tracker, Tracks

SEEDS = st.integers(0, 2**32 - 1)


def dimple(rest, centre, height, width):
    """Pins spread from a contact by up to ``height`` px."""
    away = rest - centre
    reach = np.hypot(*away.T)[:, None] / width
    return height * away / width * np.exp((1 - reach**2) / 2)


@pytest.fixture(scope="module")
def hexagon():
    return drawn_pins.hexagon(6, 13.0, 100.0)


@pytest.fixture(scope="module")
def few_pins():
    """37 pins in a frame of 100 px: discs are fitted to them fast."""
    return drawn_pins.hexagon(3, 13.0, 50.0)


@pytest.fixture(scope="module")
def tracker(hexagon, sketch):
    return Tracker(sketch(hexagon))


@pytest.fixture(scope="module")
def sketch():
    """Discs by the distance of pixel centres: fast, within 0.1 px."""
    row, column = np.indices((200, 200))

    def made(xy, radius=3.5, grey=False):
        away = np.full((200, 200), np.inf)
        for x, y in xy:
            window = np.s_[max(0, int(y) - 6) : int(y) + 8, max(0, int(x) - 6) : int(x) + 8]
            here = np.hypot(column[window] - x, row[window] - y)
            away[window] = np.minimum(away[window], here)
        light = np.clip(radius + 0.5 - away, 0, 1)
        return (255 * (light if grey else light > 0.5)).round().astype(np.uint8)

    return made


def nearest(places, true):
    apart = np.linalg.norm(places[:, None] - true, axis=-1)
    assert len(set(apart.argmin(axis=1))) == len(true) == len(places)
    return apart.min(axis=1)


@pytest.mark.parametrize(("soft", "tolerance"), [(True, 0.02), (False, 0.25)])
def test_pins_at_rest_are_where_discs_were_drawn(drawn, few_pins, soft, tolerance) -> None:
    true = few_pins + np.random.default_rng(1).uniform(-0.5, 0.5, few_pins.shape)
    image = drawn(true, 3.7, 100, soft=soft)
    if not soft:
        image = np.where(image > 100, 255, 0).astype(np.uint8)
    assert nearest(Tracker(image).rest, true).max() < tolerance


def test_the_rim_and_specks_are_no_pins_at_rest(drawn, rings) -> None:
    image = drawn(rings, 3.7, 360, soft=False)
    row, column = np.indices(image.shape)
    away = np.hypot(row - 179.5, column - 179.5)
    image[(away > 165) & (away < 169)] = 208
    image[5, 5] = image[350, 7] = image[350, 352] = 208
    assert nearest(Tracker(image).rest, rings).max() < 0.25


def test_pins_that_touch_at_rest_are_split(drawn) -> None:
    alone = [[20.0 + 20 * i, 20.0 + 20 * j] for i in range(8) for j in range(8)]
    true = np.array([*alone, [60.0, 185.0], [68.5, 188.0]])
    assert nearest(Tracker(drawn(true, 5.0, 200, soft=True), refine=False).rest, true).max() < 0.7


@settings(max_examples=12)
@given(SEEDS, st.floats(0, 14), st.booleans())
def test_pins_are_followed_through_a_press(tracker, sketch, seed, height, grey) -> None:
    rng = np.random.default_rng(seed)
    rest = tracker.rest
    true = rest + dimple(rest, 100 + rng.uniform(-15, 15, 2), height, 45.0)
    tracks = tracker.track(sketch(true, grey=grey)[None])
    assert tracks.seen.all()
    assert np.abs(tracks.xy[0] - true).max() < 0.4


@settings(max_examples=12)
@given(SEEDS, st.integers(1, 6), st.floats(0, 6))
def test_lost_pins_are_predicted_and_stray_blobs_ignored(
    tracker, sketch, seed, lost, height
) -> None:
    rng = np.random.default_rng(seed)
    rest = tracker.rest
    true = rest + dimple(rest, 100 + rng.uniform(-15, 15, 2), height, 45.0)
    gone = rng.choice(len(rest), lost, replace=False)
    stray = rng.uniform(5, 195, (4, 2))
    stray = stray[np.linalg.norm(stray[:, None] - true, axis=-1).min(axis=1) > 8.5]
    tracks = tracker.track(sketch(np.concatenate([np.delete(true, gone, axis=0), stray]))[None])
    kept = np.setdiff1d(np.arange(len(rest)), gone)
    off = np.linalg.norm(tracks.xy[0] - true, axis=1)
    assert tracks.seen[0, kept].all()
    assert off[kept].max() < 0.5
    inside = np.hypot(*(rest[gone] - 100).T) < 60
    unseen = gone[inside & ~tracks.seen[0, gone]]
    assert (off[unseen] < 3.0).all()
    assert tracks.seen[0, gone].sum() <= len(stray)


def test_blurred_pins_are_followed_with_softer_discs(drawn, few_pins) -> None:
    tracker = Tracker(drawn(few_pins, 3.5, 100, soft=True))
    xy = few_pins + dimple(few_pins, np.array([50.0, 55.0]), 3.0, 40.0)
    sharp = drawn(xy, 3.5, 100, soft=True)
    soft = np.round(gaussian_filter(sharp.astype(float), 0.8)).astype(np.uint8)
    found, clear = tracker.track(soft[None]), tracker.track(sharp[None])
    np.testing.assert_allclose(found.xy, clear.xy, atol=0.03)
    np.testing.assert_allclose(found.radius, clear.radius, atol=0.2)
    assert found.seen.all()


def test_frames_do_not_depend_on_each_other(tracker, sketch) -> None:
    rng = np.random.default_rng(3)
    images = np.stack([sketch(tracker.rest + rng.normal(0, 1, 2)) for _ in range(4)])
    together = tracker.track(images)
    assert isinstance(together, Tracks)
    assert len(together) == 4
    for k in (2, 0):
        alone = tracker.track(images[k : k + 1])
        assert np.array_equal(alone.xy[0], together.xy[k])
    assert np.array_equal(tracker.track(images[::-1]).xy, together.xy[::-1])


@pytest.mark.parametrize("level", [0, 90, 255])
def test_an_even_frame_leaves_pins_at_rest_unseen(tracker, level) -> None:
    tracks = tracker.track(np.full((1, 200, 200), level, dtype=np.uint8))
    assert not tracks.seen.any()
    assert np.array_equal(tracks.xy[0], tracker.rest)


@pytest.mark.parametrize(
    "images",
    [
        np.zeros((200, 200), dtype=np.uint8),
        np.zeros((2, 100, 200), dtype=np.uint8),
        np.zeros((2, 200, 200)),
    ],
)
def test_other_frames_are_refused(tracker, images) -> None:
    with pytest.raises(UserError, match="pins are tracked in gray frames"):
        tracker.track(images)


@pytest.mark.parametrize(
    "image", [np.zeros((8, 8, 3), dtype=np.uint8), np.zeros((8, 8)), np.zeros((64, 64), np.uint8)]
)
def test_other_rest_frames_are_refused(image) -> None:
    with pytest.raises(UserError, match="the rest frame"):
        Tracker(image)


@pytest.mark.long
def test_simulated_pins_are_found_to_a_hundredth_of_a_pixel() -> None:
    from tactibench.plugins import PluginHost

    context = SensorContext(np.random.SeedSequence(1))
    sensor = PluginHost().sensors["tactip-127"].build(context, friction_within=0.0)
    presses = [
        Scene(Indenter.single(), Pose(2.0, -3.0, 0.0, 0.0, 5.0)),
        Scene(Indenter.dual(7.0), Pose(0.5, 0.0, 40.0, 0.0, 3.0)),
        Scene(Indenter.single(), Pose()),
    ]
    images = np.stack([frame.image for frame in sensor.press_many(presses)])
    x, y, radius = sensor.renderer.project(sensor.points(presses))
    true = np.stack([x, y], axis=-1)
    tracker = Tracker(sensor.rest().image)
    which = np.linalg.norm(true[2][:, None] - tracker.rest, axis=-1).argmin(axis=1)
    assert sorted(which) == list(range(127))
    assert np.abs(tracker.rest[which] - true[2]).max() < 0.015
    tracks = tracker.track(images)
    error = tracks.xy[:, which] - true
    assert tracks.seen.all()
    assert np.sqrt(np.mean(error**2)) < 0.012
    assert np.abs(error).max() < 0.06
    assert np.corrcoef(tracks.radius[:, which].ravel(), radius.ravel())[0, 1] > 0.6


@pytest.mark.parametrize("pins", [127, 331])
def test_every_pin_of_real_presses_is_followed(pins) -> None:
    import cv2
    import pandas as pd

    folder = tac_vgnn_folder(f"{pins}/model_surface2d")
    table = pd.read_csv(folder / "targets.csv")
    little = table.image_name[table.move_1.abs() < 1].iloc[::80]  # sheared by less than 1 mm
    names = ["init_0.png", *little, *table.image_name.iloc[::250]]
    images = np.stack([cv2.imread(str(folder / "frames_bw" / n), 0) for n in names])
    tracker = Tracker(images[0])
    assert len(tracker.rest) == pins
    tracks = tracker.track(images)
    assert np.isfinite(tracks.xy).all()
    assert tracks.seen[: 1 + len(little)].all()
    assert tracks.seen.mean() > 0.999
    assert np.abs(tracks.xy[0] - tracker.rest).max() < 0.2


def test_overlapping_pins_are_told_apart_from_where_they_should_be(drawn, few_pins) -> None:
    """Three discs of 7 px within 5 px are one blob; known to half a spacing they are three."""
    whole = Tracker(drawn(few_pins, 3.5, 100, soft=True))
    middle = np.argsort(np.hypot(*(whole.rest - 50).T))[:3]
    true = whole.rest.copy()
    true[middle] = true[middle].mean(axis=0) + 0.35 * (true[middle] - true[middle].mean(axis=0))
    image = drawn(true, 3.5, 100, soft=True)
    off = np.random.default_rng(4).normal(0, 1.2, true.shape)
    tracks = whole.refit(image[None], (true + off)[None])
    assert tracks.seen.all()
    np.testing.assert_allclose(tracks.xy[0], true, atol=0.1)
