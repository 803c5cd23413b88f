"""The training loop: what it learns, its optimiser, the mean of its weights, and how it resumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from state_hash import state_hash
from torch import nn

from tactibench import UserError
from tactibench.training import (
    Examples,
    Muon,
    Recipe,
    average_weights,
    measure_statistics,
    orthogonalise,
)


@pytest.mark.parametrize(("optimiser", "schedule"), [("adam", "constant"), ("adamw", "one-cycle")])
def test_learning_reduces_the_loss(run, recipe, optimiser, schedule):
    recipe = replace(recipe, epochs=15, optimiser=optimiser, schedule=schedule)
    _, report = run(recipe=recipe)
    assert report.history[-1]["loss"] < 0.5 * report.history[0]["loss"]
    assert report.history[-1]["validation_loss"] < 0.5 * report.history[0]["validation_loss"]


def test_bf16_learns_like_float32(run, recipe):
    """A whole epoch in bf16 must see its own updates."""
    losses = [
        run(recipe=replace(recipe, precision=precision, epochs=6))[1].history[-1]["loss"]
        for precision in ("float32", "bf16")
    ]
    assert losses[1] == pytest.approx(losses[0], rel=0.05)


def test_the_mean_of_the_steps_is_trained_for(run, recipe):
    """Its weights are not the last ones, its statistics are measured over one epoch's batches."""
    mean, report = run(recipe=replace(recipe, average=0.9))
    last, _ = run(recipe=replace(recipe, average=0.0))
    assert int(mean.features[1].num_batches_tracked) == 4
    assert int(last.features[1].num_batches_tracked) == 16
    assert not torch.equal(mean.head[1].weight, last.head[1].weight)
    assert all(weight.requires_grad for weight in mean.parameters())
    assert not mean.training
    assert report.history[-1]["validation_loss"] < report.history[0]["validation_loss"]


def test_with_patience_the_best_mean_is_taken(run, recipe, make_examples):
    """What is validated is the opposite of what is learned, so the first epochs are the best."""
    held_out = make_examples(9, 2)
    opposite = replace(held_out, targets=-held_out.targets)
    recipe = replace(recipe, average=0.5, patience=3, schedule="constant")
    best, report = run(recipe=recipe, validation=opposite)
    count = report.notes["best_epoch"]
    assert count < report.epochs
    after_best, _ = run(recipe=replace(recipe, epochs=count, patience=None))
    for name, value in best.state_dict().items():
        assert torch.equal(value, after_best.state_dict()[name]), name


def test_progress_is_told_every_step_and_epoch(run, recipe, recorder):
    progress = recorder()
    _, report = run(progress=progress)
    assert progress.started == (recipe.epochs, 4)  # 30 frames in batches of 8
    assert len(progress.losses) == 4 * recipe.epochs
    assert [epoch for epoch, _, _ in progress.epochs] == [1, 2, 3, 4]
    assert report.epochs == 4
    assert report.resumed_from == 0
    assert report.seconds > 0


def test_the_loss_of_an_epoch_is_the_mean_over_frames(run, recorder):
    progress = recorder()
    _, report = run(progress=progress)
    steps = progress.losses[:4]
    assert report.history[0]["loss"] == pytest.approx((8 * sum(steps[:3]) + 6 * steps[3]) / 30)


def test_early_stopping_returns_the_best_weights(run, recipe, make_examples):
    """A rate so high that the loss soon grows: patience ends the training."""
    recipe = replace(
        recipe, epochs=40, learning_rate=0.3, schedule="constant", patience=3, optimiser="adam"
    )
    network, report = run(recipe=recipe)
    losses = [row["validation_loss"] for row in report.history]
    assert report.epochs == len(losses) < 40
    assert report.notes["best_epoch"] == 1 + int(np.argmin(losses)) == report.epochs - 3
    validation = make_examples(9, 2)
    with torch.inference_mode():
        outputs = network(validation.images)
    again = float(torch.nn.functional.mse_loss(outputs, validation.targets))
    assert again == pytest.approx(min(losses), rel=1e-6)


def test_a_loss_that_is_not_finite_ends_the_training(run):
    with pytest.raises(UserError, match="nan in epoch 1"):
        run(loss=lambda outputs, targets: (outputs - targets).mean() * float("nan"))


def test_one_cycle_climbs_to_its_peak_and_falls_to_nothing():
    recipe = Recipe(epochs=1, batch=1, learning_rate=2.0, warmup=0.25)
    rates = [recipe.rate(step, 101) for step in range(101)]
    assert rates[0] == pytest.approx(2.0 / 25)
    assert max(rates) == pytest.approx(2.0, rel=2e-3)
    assert 24 <= int(np.argmax(rates)) <= 26
    assert rates[-1] == pytest.approx(2.0 / 1e4)
    assert (np.diff(rates[:25]) > 0).all()
    assert (np.diff(rates[26:]) < 0).all()


def walk(steps, decay):
    """The mean of a weight that is 1, 2, 3, ... after the steps."""
    network = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(network.weight)
    mean = average_weights(network, decay)
    for step in range(1, steps + 1):
        nn.init.constant_(network.weight, float(step))
        mean.update_parameters(network)
    return mean.module.weight.item()


def test_it_forgets_the_start_and_then_decays_evenly():
    decay, expected = 0.8, 1.0
    for step in range(2, 101):
        kept = min(decay, step / (9 + step))
        expected = kept * expected + (1 - kept) * step
    assert abs(walk(100, decay) - expected) < 1e-3
    assert abs(walk(100, decay) - (100 - decay / (1 - decay))) < 1e-3


def test_statistics_come_from_rows_that_stand_for_all():
    rng = np.random.default_rng(3)
    depth = rng.permutation(np.linspace(0, 1, 3000)).astype(np.float32)
    images = torch.zeros(len(depth), 1, 2, 2, dtype=torch.uint8)
    examples = Examples(images, torch.from_numpy(depth)[:, None])
    rows = examples.spread_rows(100)
    assert len(set(rows.tolist())) == 100
    taken = depth[rows.numpy()]
    assert abs(taken.mean() - depth.mean()) < 1e-3
    assert abs(taken.std() - depth.std()) < 1e-2
    assert sorted(examples.spread_rows(5000).tolist()) == list(range(3000))


def test_measured_statistics_are_means_over_the_batches():
    network = nn.Sequential(nn.BatchNorm2d(1))
    torch.nn.init.constant_(network[0].running_mean, 7.0)
    generator = torch.Generator().manual_seed(1)
    batches = [k + torch.rand(4, 1, 3, 3, generator=generator) for k in range(3)]
    measure_statistics(network, batches, lambda module, images: module(images))
    mean = torch.stack([batch.mean() for batch in batches]).mean()
    variance = torch.stack([batch.var() for batch in batches]).mean()
    torch.testing.assert_close(network[0].running_mean[0], mean)
    torch.testing.assert_close(network[0].running_var[0], variance)
    assert network[0].momentum == 0.1


CHECKPOINT = "checkpoint.safetensors"


@pytest.mark.parametrize("stop", [{"stop_after_epoch": 1}, {"stop_at_step": 11}])
@pytest.mark.parametrize(
    "changes",
    [{"optimiser": "adam"}, {"optimiser": "muon"}, {"precision": "bf16", "channels_last": True}],
)
def test_an_interrupted_training_resumes_to_the_same_bits(
    run, recipe, recorder, interrupted, tmp_path, stop, changes
):
    recipe = replace(recipe, patience=3, **changes)
    undisturbed, whole = run(recipe=recipe)
    with pytest.raises(interrupted):
        run(recipe=recipe, checkpoints=tmp_path, progress=recorder(**stop))
    progress = recorder()
    resumed, report = run(recipe=recipe, checkpoints=tmp_path, progress=progress)
    assert report.resumed_from > 0
    assert "checkpoint" not in report.notes
    assert state_hash(resumed) == state_hash(undisturbed)
    without_times = [{**row, "seconds": 0} for row in report.history]
    assert without_times == [{**row, "seconds": 0} for row in whole.history]
    assert [epoch for epoch, _, _ in progress.epochs] == [1, 2, 3, 4]
    assert len(progress.losses) == 4 * (4 - report.resumed_from)


def test_a_finished_training_is_not_repeated(run, recorder, tmp_path):
    first, _ = run(checkpoints=tmp_path)
    progress = recorder()
    second, report = run(checkpoints=tmp_path, progress=progress)
    assert progress.losses == []
    assert report.resumed_from == 4
    assert state_hash(first) == state_hash(second)


def _cut(path):
    path.write_bytes(path.read_bytes()[:-40])


def _flip(path):
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)


def _replace(path):
    path.write_bytes(b"not a checkpoint")


@pytest.mark.parametrize("damage", [_cut, _flip, _replace, lambda path: path.write_bytes(b"")])
def test_a_damaged_checkpoint_is_ignored_and_said(run, recorder, interrupted, tmp_path, damage):
    with pytest.raises(interrupted):
        run(checkpoints=tmp_path, progress=recorder(stop_after_epoch=2))
    damage(tmp_path / CHECKPOINT)
    network, report = run(checkpoints=tmp_path)
    assert report.resumed_from == 0
    assert "ignored" in report.notes["checkpoint"]
    assert state_hash(network) == state_hash(run()[0])


@pytest.mark.parametrize("difference", ["seed", "recipe", "identity", "data", "threads"])
def test_a_checkpoint_of_another_training_is_never_used(
    run, recipe, make_examples, tmp_path, monkeypatch, difference
):
    run(checkpoints=tmp_path)
    changed = {
        "seed": {"seed": 8},
        "recipe": {"recipe": replace(recipe, learning_rate=2e-2)},
        "identity": {"identity": {"model": "tiny", "width": 2}},
        "data": {"training": make_examples(30, 5)},
        "threads": {},
    }[difference]
    if difference == "threads":
        monkeypatch.setattr(torch, "get_num_threads", lambda: 99)
    network, report = run(checkpoints=tmp_path, **changed)
    assert report.resumed_from == 0
    assert "another" in report.notes["checkpoint"]
    assert state_hash(network) == state_hash(run(**changed)[0])


def random(shape, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape).astype(np.float32))


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 24),
    st.integers(1, 60),
    st.floats(1e-6, 1e6),
    st.integers(0, 100),
    st.sampled_from([torch.float32, torch.bfloat16]),
)
def test_directions_are_kept_and_their_sizes_made_equal(rows, columns, size, seed, dtype):
    matrix = random((rows, columns), seed) * size
    u, s, v = torch.linalg.svd(matrix, full_matrices=False)
    clear = s > 0.05 * s.norm()
    values = (u.T @ orthogonalise([matrix], dtype)[0] @ v.T).diagonal()[clear]
    assert ((values > 0.6) & (values < 1.3)).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_matrices_do_not_mix(dtype):
    matrices = [random(shape, seed) for seed, shape in enumerate([(12, 40), (20, 12), (16, 16)])]
    for alone, found in zip(matrices, orthogonalise(matrices, dtype), strict=True):
        torch.testing.assert_close(found, orthogonalise([alone], dtype)[0], atol=1e-6, rtol=1e-5)


def one_step(weight, gradient, lr=0.1, decay=0.0):
    parameter = torch.nn.Parameter(weight.clone())
    parameter.grad = gradient
    Muon([{"params": [parameter], "weight_decay": decay}], lr=lr).step()
    return parameter.detach()


@pytest.mark.parametrize("shape", [(16, 32), (16, 4, 3, 3), (32, 16)])
def test_a_step_is_as_long_as_adams(shape):
    step = one_step(torch.zeros(shape), random(shape)) / 0.1
    assert 0.1 < float(step.square().mean().sqrt()) < 0.3


@pytest.mark.parametrize("shape", [(5,), (1, 20), (16, 1, 3, 3), (3, 64)])
def test_small_weights_step_as_with_adamw(shape):
    weights = torch.nn.Parameter(random(shape, 1)), torch.nn.Parameter(random(shape, 1))
    ours = Muon([{"params": [weights[0]], "weight_decay": 0.1}], lr=0.01)
    theirs = torch.optim.AdamW([weights[1]], lr=0.01, weight_decay=0.1)
    for seed in range(4):
        weights[0].grad, weights[1].grad = random(shape, seed), random(shape, seed)
        ours.step()
        theirs.step()
    torch.testing.assert_close(weights[0], weights[1])


def test_decay_shrinks_weights_beside_the_step():
    weight, gradient = random((16, 16), 1), random((16, 16), 2)
    plain, shrunk = one_step(weight, gradient), one_step(weight, gradient, decay=0.5)
    torch.testing.assert_close(shrunk - plain, -0.1 * 0.5 * weight)
