"""The sensor as the benchmark sees it."""

import json
import subprocess
import sys
from importlib.resources import files

import numpy as np
import pytest

from tactibench import Grid, Indenter, Pose, Scene, SensorContext, UserError, gray_frames
from tactibench.geometry import true_contacts
from tactibench_sim import data_file, hooks
from tactibench_sim.mechanics import tables as table_file
from tactibench_sim.rendered_sensor import BATCH, FRAMES_PER_SECOND
from tactibench_sim.sensor import TacTip127, TacTip331

GRID = Grid.centred(64, 0.4)


def sensor(seed=7, kind=TacTip127, **parameters):
    return kind(SensorContext(np.random.SeedSequence(seed)), **parameters)


def scenes(count, seed=0):
    rng = np.random.default_rng(seed)
    kinds = [Indenter.single(), Indenter.dual(7.0), Indenter.triple((0.0, 1.0, 2.0))]
    out = [
        Scene(
            kinds[k % 3],
            Pose(*rng.uniform(-3, 3, 2), rng.uniform(-180, 180), 0.0, rng.uniform(0.5, 5)),
        )
        for k in range(count - 1)
    ]
    return [*out, Scene(Indenter.plate(), Pose(yaw=40, tilt=8, depth=3))]


def images(frames):
    return np.stack([frame.image for frame in frames])


@pytest.mark.parametrize("kind", [TacTip127, TacTip331])
def test_grouping_of_presses_does_not_matter(kind):
    several = scenes(70)
    with sensor(kind=kind) as one, sensor(kind=kind) as many, sensor(kind=kind) as mixed:
        single = [one.press(scene) for scene in several]
        batch = list(many.press_many(several))
        start = mixed.press_many(several[:40])
        some = [next(start) for _ in range(5)]
        some += [mixed.press(scene) for scene in several[5:20]]
        some += list(mixed.press_many(iter(several[20:])))
    assert (images(single) == images(batch)).all()
    assert (images(single) == images(some)).all()
    assert [f.timestamp for f in single] == [f.timestamp for f in batch]
    assert all(frame.pose is scene.pose for frame, scene in zip(batch, several, strict=True))


def test_same_seed_same_frames_other_seed_other_noise():
    several = scenes(4)
    first = images(sensor().press_many(several))
    assert (images(sensor().press_many(several)) == first).all()
    assert (images(sensor(8).press_many(several)) != first).mean() > 0.3
    again = sensor()
    list(again.press_many(several))
    with again:
        assert (images(again.press_many(several)) == first).all()


def test_frame_format():
    one = sensor()
    frame = one.press(Scene(Indenter.single(), Pose(depth=2)))
    rest = one.rest()
    assert frame.image.shape == (128, 128)
    assert frame.image.dtype == np.uint8
    assert frame.rest is rest.image
    assert not rest.image.flags.writeable
    times = [one.press(Scene(Indenter.single(), Pose())).timestamp for _ in range(3)]
    assert np.diff(times) == pytest.approx(1 / FRAMES_PER_SECOND)


def test_a_press_changes_the_frame_where_it_is():
    one = sensor(noise=False)
    rest = one.rest().image.astype(float)
    away = np.abs(one.press(Scene(Indenter.single(), Pose(x=5.0, depth=2.0))).image - rest)
    assert away[:, 64:].sum() > 1.5 * away[:, :64].sum()
    down = np.abs(one.press(Scene(Indenter.single(), Pose(y=5.0, depth=2.0))).image - rest)
    assert down[64:].sum() > 1.5 * down[:64].sum()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_do_not_matter(threads):
    several = scenes(200)
    one = sensor(threads=threads)
    assert (images(one.press_many(several)) == images(map(sensor().press, several))).all()
    assert one.press(several[0]).timestamp == pytest.approx(201 / FRAMES_PER_SECOND)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_consumer_that_stops_has_pressed_what_it_took(threads):
    several = scenes(400)
    asked = 0

    def source():
        nonlocal asked
        for scene in several:
            asked += 1
            yield scene

    one, plain = sensor(threads=threads), sensor()
    running = one.press_many(source())
    first = [next(running) for _ in range(3)]
    assert asked <= (threads + 1) * BATCH
    running.close()
    frames = [*first, one.press(several[3])]
    assert (images(frames) == images(map(plain.press, several[:4]))).all()
    assert frames[-1].timestamp == pytest.approx(4 / FRAMES_PER_SECOND)


@pytest.mark.parametrize("threads", [1, 2])
def test_presses_in_between_take_their_number(threads):
    several = scenes(12)
    one, plain = sensor(threads=threads), sensor()
    running = one.press_many(several[:9])
    order = [next(running), next(running), one.press(several[9]), *running, one.press(several[10])]
    told = [0, 1, 9, *range(2, 9), 10]
    assert (images(order) == images([plain.press(several[k]) for k in told])).all()


def test_a_kept_frame_does_not_keep_its_batch():
    frame = next(sensor().press_many(scenes(64)))
    assert frame.image.base is None
    assert frame.image.flags.owndata


@pytest.mark.parametrize("output", ["grey", "rgb", "bw"])
def test_outputs_of_a_sensor(output):
    one = sensor(output=output, glare=1.0, size=64)
    frames = list(one.press_many(scenes(3)))
    shape = (64, 64, 3) if output == "rgb" else (64, 64)
    assert all(frame.image.shape == one.rest().image.shape == shape for frame in frames)
    assert gray_frames(frames, 64).shape == (3, 64, 64)
    if output == "bw":
        assert set(np.unique(images(frames))) == {0, 255}
    limits = one.bound(scenes(3)[0])
    assert np.isfinite(limits).all()
    assert (one.bound(scenes(3)[0]) > 0).all()
    quiet = sensor(output=output, noise=False)
    touched = quiet.press(Scene(Indenter.single(), Pose(depth=0.0)))
    assert (touched.image == quiet.rest().image).all()


def test_an_individual_differs_in_every_run_alike():
    scene = scenes(1)[0]
    frames = [sensor(seed, instance=5).press(scene).image for seed in (1, 1, 2)]
    assert (frames[0] == frames[1]).all()
    rest = [sensor(seed, instance=n).rest().image for seed, n in ((1, 5), (2, 5), (1, 6), (1, 0))]
    assert (rest[0] == rest[1]).all()
    assert (rest[0] != rest[2]).any()
    assert (rest[0] != rest[3]).any()
    assert (rest[3] == sensor().rest().image).all()


def test_lost_pins_are_not_seen():
    whole, lossy = sensor(noise=False), sensor(noise=False, pin_loss=0.2)
    assert len(lossy.directions) == 127 - 25
    assert len(lossy.describe()["lost_pins"]) == 25
    missing = whole.rest().image.astype(int) - lossy.rest().image
    assert missing.min() >= 0
    assert missing.max() > 100


def test_wrong_optics_are_refused():
    with pytest.raises(UserError, match="until air is left"):
        sensor(camera_distance=20.0)
    with pytest.raises(UserError, match="not in the gel"):
        sensor(gel_length=10.0)
    with pytest.raises(TypeError, match="nonsense"):
        sensor(nonsense=1)


@pytest.mark.parametrize(("threads", "place"), [(1, 5), (2, 5), (2, 64), (2, 70), (3, 150)])
def test_frames_before_a_bad_scene_come_first(threads, place):
    good, bad = scenes(place), Scene(Indenter.single(), Pose(depth=-1.0))
    seen, one = [], sensor(threads=threads)
    with pytest.raises(UserError, match="depth is -1 mm"):
        seen.extend(one.press_many([*good, bad, *good]))
    assert len(seen) == place
    assert (images(seen) == images(sensor().press_many(good))).all()
    assert one.press(good[0]).timestamp == pytest.approx((place + 1) / FRAMES_PER_SECOND)


def test_press_many_takes_no_scenes():
    assert list(sensor().press_many([])) == []


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (Scene(Indenter.single(0.5), Pose(depth=1)), "radius is 0.5 mm"),
        (Scene(Indenter.single(), Pose(depth=6.6)), "tables end at 6.5 mm"),
        (Scene(Indenter.single(), Pose(x=20.0, depth=1)), "beyond 55 deg"),
    ],
)
def test_scenes_without_a_table_are_refused(scene, named):
    for call in (sensor().press, sensor().bound, lambda s: sensor().surface(s, GRID)):
        with pytest.raises(UserError, match=named) as caught:
            call(scene)
        assert str(caught.value).endswith(".")


def test_describe_is_json_and_tells_sensors_apart():
    one = sensor().describe()
    assert json.loads(json.dumps(one)) == one
    others = [
        sensor(kind=TacTip331),
        sensor(tier="superpose"),
        sensor(size=64),
        sensor(noise=False),
        sensor(pin_length=1.5),
        sensor(camera_distance=60.0),
        sensor(brightness=150.0),
        sensor(instance=1),
        sensor(instance=2),
        sensor(pin_loss=0.1),
        sensor(output="bw"),
    ]
    texts = {json.dumps(other.describe(), sort_keys=True) for other in others}
    assert len(texts | {json.dumps(one, sort_keys=True)}) == 12
    assert sensor(threads=3).describe() == one
    assert len(one["tables"]["sha256"]) == 64


def test_surface_is_deepest_under_the_tip():
    one, pose = sensor(), Pose(x=3.0, y=-2.0, depth=2.0)
    surface = one.surface(Scene(Indenter.single(), pose), GRID)
    row, column = np.unravel_index(surface.argmax(), surface.shape)
    touch = 20 / 21  # the first touch lies nearer the apex than the tip's axis
    assert GRID.xy(row, column) == pytest.approx([3.0 * touch, -2.0 * touch], abs=0.35)
    assert surface.max() == pytest.approx(1.97, abs=0.05)
    assert surface.min() < 0  # the bulge
    wide = one.surface(Scene(Indenter.single(), pose), Grid.centred(64, 1.0))
    assert wide[0, 0] == 0


def test_bound_is_one_row_a_contact():
    one = sensor()
    several = scenes(6)
    for scene in several:
        limits = one.bound(scene)
        assert limits.shape == (len(true_contacts(scene)), 3)
        assert (limits > 0).all()
        assert limits.max() < 0.1
    assert one.bound(Scene(Indenter.single(), Pose())).shape == (0, 3)


def test_bound_at_the_tables_end():
    assert np.isfinite(sensor().bound(Scene(Indenter.single(), Pose(depth=6.5)))).all()


def test_a_table_of_ones_own(tmp_path):
    mine = tmp_path / "dome.npz"
    with np.load(str(files("tactibench_sim.mechanics").joinpath(table_file.FILE))) as archive:
        arrays = {k: archive[k] for k in archive.files if k not in ("parameters", "sha256")}
    arrays["sphere3_w"] = arrays["sphere3_w"] * np.float32(0.5)
    data_file.write(mine, arrays, table_file.shipped().parameters)
    scene = Scene(Indenter.single(), Pose(depth=3))
    one, other = sensor(), sensor(table=str(mine))
    assert (one.press(scene).image != other.press(scene).image).any()
    assert one.describe() != other.describe()
    with pytest.raises(UserError, match="cannot be read"):
        sensor(table=str(tmp_path / "missing.npz"))


def test_a_table_of_one_radius(tmp_path):
    """As scripts/fem/tabulate_dome.py makes it for one --radius: it has no plate."""
    mine = tmp_path / "four.npz"
    with np.load(str(files("tactibench_sim.mechanics").joinpath(table_file.FILE))) as archive:
        arrays = {k.replace("sphere3", "sphere4"): archive[k] for k in archive.files}
    kept = ("delta", "polar", *(name for name in arrays if name.startswith("sphere4")))
    parameters = {"dome": table_file.shipped().parameters["dome"]}
    data_file.write(mine, {name: arrays[name] for name in kept}, parameters)
    four = sensor(table=str(mine), friction=0.5)
    assert (four.rest().image == sensor().rest().image).all()
    assert four.points([Scene(Indenter.single(4.0), Pose(depth=3.0, dx=1.0))]).any()
    for radius, depth, dx, said in (
        (3.0, 2.0, 0.0, "tables for: 4 mm"),
        (4.0, 5.0, 1.0, "tables of drag end at 4 mm"),
    ):
        with pytest.raises(UserError, match=said):
            four.press(Scene(Indenter.single(radius), Pose(depth=depth, dx=dx)))


def test_bound_falls_with_the_noise():
    scene = Scene(Indenter.single(), Pose(depth=1.5))
    quiet = sensor(read_noise=1.0, full_well=1e9).bound(scene)
    loud = sensor(read_noise=4.0, full_well=1e9).bound(scene)
    ratio = np.sqrt((16 + 1 / 12) / (1 + 1 / 12))
    assert loud / quiet == pytest.approx(np.full((1, 3), ratio), rel=1e-3)


def test_bound_of_a_shadowed_tip_is_infinite():
    scene = Scene(Indenter(3.0, ((0, 0, 4.0), (1.5, 0, 0.4)), "shadow"), Pose(depth=4.0))
    assert len(true_contacts(scene)) == 2
    limits = sensor().bound(scene)
    assert np.isfinite(limits[0]).all()
    assert np.isinf(limits[1]).all()


def test_the_specs_fit_the_class():
    for spec in hooks.tactibench_sensors():
        kind = spec.load()
        built = kind(SensorContext(np.random.SeedSequence(0)), **spec.settings({}))
        assert built.describe() == sensor(kind=kind).describe()
        assert spec.name == built.describe()["sensor"]


def test_hooks_are_light():
    code = (
        "import sys, tactibench_sim.hooks as h; h.tactibench_sensors(); h.tactibench_commands();"
        "sys.exit(bool({'numpy', 'numba', 'click', 'scipy'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_finite_elements_without_ngsolve_say_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ngsolve", None)
    with pytest.raises(UserError, match=r'pip install "tactibench\[fem\]"'):
        sensor(tier="fem")
