"""The model that states where contacts are and how sure it is, and the field that it reads."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from drawn_pins import REST, draw, presses, pushed

from tactibench import Contacts, Frame, Grid, Pose, UserError
from tactibench.markers import PinTracker
from tactibench.training import flip_maps, torch_seed
from tactibench_mixture import DisplacementField, MixtureNetwork
from tactibench_mixture import model as module


def flat(answers):
    """x, y, depth of every contact of all frames."""
    rows = [np.column_stack([contacts.xy, contacts.depth]) for contacts in answers]
    return np.concatenate([np.empty((0, 3)), *rows])


@pytest.mark.long
def test_it_learns_where_and_how_deep_and_says_how_sure_it_is(make_mixture, fit):
    model = make_mixture(epochs=30)
    history = fit(model, *presses(192, 1)).history
    assert history[-1]["loss"] < history[0]["loss"] - 3
    frames, truth = presses(50, 8)
    found = model.predict(frames)
    right = [len(contacts) == 1 for contacts in found]
    assert sum(right) >= 20
    pairs = [(f, t) for f, t, one in zip(found, truth, right, strict=True) if one]
    error = flat([f for f, _ in pairs]) - flat([t for _, t in pairs])
    spread = flat(truth).std(axis=0)
    assert (np.abs(error).mean(axis=0) < spread * [0.1, 0.1, 0.6]).all()
    z = error / np.concatenate([f.std for f, _ in pairs])
    assert np.mean((z[:, :2] ** 2).sum(axis=1) < 5.991) >= 0.7


def test_frames_with_several_contacts_are_learned_from_and_kept_for_the_std(make_mixture, fit):
    frames, truth = presses(20, 1)
    image = draw(pushed(-4.0, 0.0, 3.0) + pushed(4.0, 0.0, 3.0) - REST)
    frames += [Frame(image, 0.0, Pose(), draw(REST))] * 20
    truth += [Contacts.truth([[-4.0, 0.0], [4.0, 0.0]], [3.0, 3.0])] * 20
    assert fit(make_mixture(epochs=1), frames, truth).notes["kept_for_std"] == 1


def test_an_encoder_of_another_kind_is_refused(make_mixture):
    class Heat:
        channels = 1

    with pytest.raises(UserError, match="kind mixture"):
        make_mixture(encoder=Heat())


def test_a_grid_that_its_cells_do_not_divide_is_refused(make_mixture):
    with pytest.raises(UserError, match="multiple of 16"):
        make_mixture(grid=Grid.centred(60, 0.4))


@pytest.fixture(scope="module")
def network():
    with torch_seed(1):
        network = MixtureNetwork(8, 32, (True, True))
        for weight in network.parameters():  # residual blocks are the identity at first
            torch.nn.init.normal_(weight, std=0.1)
    return network


def fields(count=3):
    return torch.randn(count, 2, 32, 32, generator=torch.Generator().manual_seed(2))


def test_shapes_and_the_first_guess():
    network = MixtureNetwork(8, 32, (False, False))
    contacts = torch.full((10, 2, 3), torch.nan)
    contacts[:, 0] = 1.0
    contacts[:5, 1] = 2.0
    network.initialise(fields(10) * 7, contacts)
    raw = network(fields())
    assert raw.shape == (3, 7, 16, 16)
    assert network.scale.item() == pytest.approx(1 / 7, rel=0.05)
    assert network.head.bias[0].item() * 4 == pytest.approx(np.log(1.5 / (256 - 1.5)), rel=1e-4)


@pytest.mark.parametrize("turned", [(True, False), (False, True), (True, True)])
def test_mirroring_in_training_mirrors_what_the_network_says(network, monkeypatch, turned):
    x = fields()
    flags = torch.tensor(turned).expand(3, 2)
    monkeypatch.setattr(module, "draw_flips", lambda count, allowed, device: flags)
    sign = torch.tensor([-1.0 if t else 1.0 for t in turned])
    network.eval()
    with torch.no_grad():
        plain = network(flip_maps(x, flags) * sign[:, None, None])
        network.train()
        found = network(x)
    network.eval()
    expected = flip_maps(plain, flags)
    expected[:, 1:3] *= sign[:, None, None]
    torch.testing.assert_close(found, expected)


def test_outputs_are_float32_within_autocast(network):
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        assert network(fields()).dtype == torch.float32


def field_of(rest):
    return DisplacementField(PinTracker(rest), 32)


def seen_by(field, image):
    return field(field.pins.tracker.track(image[None]))


def test_the_field_is_what_the_pins_do():
    field = field_of(draw(REST))
    assert np.abs(seen_by(field, draw(REST))).max() < 0.02
    moved = seen_by(field, draw(REST + np.array([0.8, -0.5])))
    np.testing.assert_allclose(moved[0, 0], 0.8, atol=0.06)
    np.testing.assert_allclose(moved[0, 1], -0.5, atol=0.06)
    none = field.pins.tracker.track(np.empty((0, 64, 64), np.uint8))
    assert field(none).shape == (0, 2, 32, 32)


def test_symmetry_is_seen_in_the_pins_at_rest():
    assert field_of(draw(REST)).symmetry == (True, True)
    assert field_of(draw(REST + np.array([0.3, 0.0]))).symmetry == (False, True)


def test_an_image_without_pins_is_refused():
    with pytest.raises(UserError, match="pins"):
        field_of(np.zeros((64, 64), np.uint8))
