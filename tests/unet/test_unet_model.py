"""The U-Net: its network, its maps, and where it sees mirrored frames and the sensor at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from drawn_presses import fit, presses

from tactibench import Frame, Grid, ModelContext, PlatePose, Pose, UserError
from tactibench_heatmaps import HertzGaussian, Offsets
from tactibench_unet import UNet, UNetNetwork


def test_the_paper_learns_heat_as_it_is_and_the_default_leaves_the_sigmoid_room(make_model):
    logits, heat = torch.tensor([-2.0, 0.0, 1.0, 4.0]), torch.tensor([0.0, 0.5, 0.7, 1.0])
    paper, default = make_model(recipe="paper"), make_model()
    np.testing.assert_allclose(paper.outputs(logits), logits.sigmoid(), rtol=1e-6)
    published = torch.nn.functional.binary_cross_entropy_with_logits(logits, heat)
    assert paper.loss(logits, heat) == published
    finite = torch.logit(torch.tensor([0.7])).requires_grad_()
    np.testing.assert_allclose(default.outputs(finite.detach()), 1.0, rtol=1e-6)
    default.loss(finite, torch.ones(1)).backward()
    assert abs(float(finite.grad)) < 1e-6
    assert default.outputs(torch.tensor([9.0])) == 1.0


def test_weights_are_read_with_the_headroom_they_were_trained_in(make_model, trained, tmp_path):
    trained.save(tmp_path)
    other = make_model(recipe="paper")
    other.load(tmp_path)
    frames, _ = presses(2, 5)
    assert np.array_equal(other.maps(frames), trained.maps(frames))


@pytest.mark.parametrize(("size", "stem"), [(64, 1), (96, 2), (96, 4)])
def test_every_size_and_stem_gives_maps_on_the_grid(make_model, size, stem):
    model = make_model(size=size, stem=stem)
    assert model.maps(presses(1, 5)[0]).shape == (1, 1, 64, 64)


def test_the_published_network_has_four_levels_and_a_bottleneck(make_model):
    """Channels 16, 32, 64, 128, bottleneck 256; 1.9 million weights."""
    model = make_model(width=16, stem=2)
    assert [block[0].out_channels for block in model.network.down] == [16, 32, 64, 128]
    assert model.network.bottleneck[0].out_channels == 256
    assert model.network.head.kernel_size == (1, 1)
    assert 1.85e6 < model.parameter_count() < 2.0e6


def test_a_stem_of_stride_4_takes_the_place_of_the_first_level(make_model):
    """A constant head gives a constant map, and each of its four outputs one cell in four."""
    network = make_model(width=16, stem=4).network
    assert [block[0].out_channels for block in network.down] == [32, 64, 128]
    assert network.head.out_channels == 4
    with torch.no_grad():
        network.head.weight.zero_()
        network.head.bias.copy_(torch.arange(4.0))
    maps = network(torch.zeros(1, 1, 64, 64, dtype=torch.uint8))
    assert torch.equal(maps[0, 0, :2, :2], torch.tensor([[0.0, 1.0], [2.0, 3.0]]))
    assert maps.shape == (1, 1, 64, 64)


@pytest.mark.long
def test_a_plate_is_read_from_the_contact_where_it_touches(make_model, tmp_path):
    """Labels from -4 to 1 mm, as a robot's z: the map shows them shifted, answers do not."""
    model = make_model(answer="plate", epochs=40, grid=Grid.centred(32, 0.8))
    report = fit(model, count=48, plate=True)
    frames, truth = presses(48, 1, plate=True)
    found = model.predict(frames)
    assert all(isinstance(pose, PlatePose) for pose in found)
    depth = [pose.depth - true.depth for pose, true in zip(found, truth, strict=True)]
    tilt = [pose.tilt - true.tilt for pose, true in zip(found, truth, strict=True)]
    assert np.median(np.abs(depth)) < 0.5
    assert np.median(np.abs(tilt)) < 2.0
    assert report.history[-1]["validation_mm"] < 2.0
    model.save(tmp_path)
    other = make_model(answer="plate", grid=Grid.centred(32, 0.8))
    other.load(tmp_path)
    assert other.predict(frames) == found


def test_what_cannot_work_is_refused_in_a_sentence(make_model):
    from tactibench_unet import UNet

    with pytest.raises(UserError, match="encoder"):
        UNet(ModelContext("contacts", Grid.centred(64, 0.4), 6.0))
    with pytest.raises(UserError, match="multiples of 16"):
        make_model(grid=Grid.centred(60, 0.4))


GRID = Grid.centred(32, 0.8)


def symmetric_frames() -> list[Frame]:
    rest = np.zeros((64, 64), np.uint8)
    rest[20:24, 20:24] = rest[20:24, 40:44] = rest[40:44, 20:24] = rest[40:44, 40:44] = 200
    return [Frame(rest, 0.0, Pose(), rest)]


@pytest.mark.parametrize(
    ("encoder", "options", "wanted"),
    [
        (HertzGaussian(), {}, (True, True)),
        (HertzGaussian(), {"recipe": "paper"}, (False, False)),
        (Offsets(), {}, (False, False)),  # its maps hold steps, which change sign
    ],
)
def test_mirrors_where_sensor_encoder_and_recipe_allow(encoder, options, wanted) -> None:
    model = UNet(ModelContext("contacts", GRID, 6.0, encoder=encoder), size=64, **options)
    model.prepare(symmetric_frames(), [])
    assert model.build().mirror == wanted


def test_a_lopsided_sensor_or_one_without_a_rest_frame_is_not_mirrored() -> None:
    model = UNet(ModelContext("contacts", GRID, 6.0, encoder=HertzGaussian()), size=64)
    lopsided = symmetric_frames()[0].rest.copy()
    lopsided[20:24, 20:24] = 0
    model.prepare([Frame(lopsided, 0.0, Pose(), lopsided)], [])
    assert model.build().mirror == (False, False)
    model.prepare([Frame(lopsided, 0.0, Pose(), None)], [])
    assert model.build().mirror == (False, False)


def test_outputs_of_mirrored_frames_are_turned_back() -> None:
    """In training an output is that of the frame or of a mirrored one; then a mean of two."""
    with torch.random.fork_rng():
        torch.default_generator.manual_seed(3)
        network = UNetNetwork(8, 2, (16, 16), 1, mirror=(True, True))
        frames = torch.randint(0, 255, (1, 1, 32, 32), dtype=torch.uint8)
        network.eval()
        possible = [
            network._logits(frames.flip(axes)).flip(axes) for axes in ((), (-1,), (-2,), (-1, -2))
        ]
        answered = network(frames)
        assert torch.allclose(answered, (possible[0] + possible[3]) / 2, atol=1e-6)
        network.train()
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.eval()
        seen: set[int] = set()
        for _ in range(40):
            found = network(frames)
            seen |= {k for k, one in enumerate(possible) if torch.allclose(found, one, atol=1e-6)}
    assert seen == {0, 1, 2, 3}


FLAT = np.full((64, 64), 20, np.uint8)


def with_rest(frames, rest=FLAT):
    return [replace(frame, rest=rest) for frame in frames]


@pytest.mark.parametrize(("options", "seen"), [({}, 2), ({"recipe": "paper"}, 1)])
def test_rest_is_shown_where_the_recipe_says_so(make_model, options, seen) -> None:
    frames, truth = presses(3, 1)
    model = make_model(size=64, **options)
    model.prepare(with_rest(frames), truth)
    assert model.inputs(frames).shape == (3, seen, 64, 64)
    model.prepare([*with_rest(frames[:2]), frames[2]], truth)  # one frame without
    assert model.inputs(frames).shape == (3, 1, 64, 64)


def test_each_frame_brings_its_own_rest_and_else_the_first_is_taken(make_model):
    frames, truth = presses(2, 1)
    model = make_model(size=64)
    model.prepare(with_rest(frames), truth)
    colour = np.repeat(np.full((32, 32, 1), 90, np.uint8), 3, axis=2)
    seen = model.inputs([*with_rest(frames[:1], colour), Frame(frames[1].image, 0.0, Pose())])
    assert torch.all(seen[0, 1] == 90)
    assert torch.all(seen[1, 1] == 20)
    np.testing.assert_array_equal(seen[1, 0].numpy(), frames[1].image)
