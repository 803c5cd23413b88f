from dataclasses import replace

import numpy as np
import pytest
import torch
from state_hash import state_hash

from tactibench import UserError
from tactibench.training import Recipe, Seeds, torch_seed


def test_the_same_seed_gives_the_same_bits_and_another_does_not(run):
    hashes = [state_hash(run(seed=seed)[0]) for seed in (7, 7, 8)]
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


@pytest.mark.parametrize("optimiser", ["adam", "adamw"])
@pytest.mark.parametrize("schedule", ["constant", "one-cycle"])
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


def test_at_most_200_validation_frames_are_decoded(run, recipe, make_examples):
    seen = []

    def error_mm(outputs, rows):
        seen.append((len(outputs), rows))
        return 1.0

    run(recipe=replace(recipe, epochs=1), validation=make_examples(450, 3), error_mm=error_mm)
    ((count, rows),) = seen
    assert count == len(rows) == 200
    assert rows[0] == 0
    assert rows[-1] == 449


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


def test_without_validation_frames_all_epochs_run(run, recipe, make_examples):
    _, report = run(recipe=replace(recipe, patience=1), validation=make_examples(0, 2))
    assert report.epochs == recipe.epochs
    assert "validation_loss" not in report.history[0]


def test_a_loss_that_is_not_finite_ends_the_training(run):
    with pytest.raises(UserError, match="nan in epoch 1"):
        run(loss=lambda outputs, targets: (outputs - targets).mean() * float("nan"))


def test_every_epoch_sees_every_frame_once_in_a_new_order():
    seeds = Seeds.draw(np.random.default_rng(3))
    first, second = seeds.permutation(50, 0), seeds.permutation(50, 1)
    assert sorted(first) == sorted(second) == list(range(50))
    assert list(first) != list(second)
    assert seeds.of_epoch(0) != seeds.of_epoch(1)


def test_seeded_gives_the_same_layer_twice():
    weights = []
    for _ in range(2):
        with torch_seed(11):
            weights.append(torch.nn.Linear(3, 3).weight)
    assert torch.equal(*weights)


def test_one_cycle_climbs_to_its_peak_and_falls_to_nothing():
    recipe = Recipe(epochs=1, batch=1, learning_rate=2.0, warmup=0.25)
    rates = [recipe.rate(step, 101) for step in range(101)]
    assert rates[0] == pytest.approx(2.0 / 25)
    assert max(rates) == pytest.approx(2.0, rel=2e-3)
    assert 24 <= int(np.argmax(rates)) <= 26
    assert rates[-1] == pytest.approx(2.0 / 1e4)
    assert (np.diff(rates[:25]) > 0).all()
    assert (np.diff(rates[26:]) < 0).all()


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_one_cycle_has_a_rate_for_the_shortest_training(steps):
    recipe = Recipe(epochs=1, batch=1)
    rates = [recipe.rate(step, steps) for step in range(steps)]
    assert all(0 < rate <= recipe.learning_rate for rate in rates)


@pytest.mark.parametrize(
    "wrong",
    [
        {"epochs": 0},
        {"batch": 0},
        {"learning_rate": 0.0},
        {"warmup": 1.0},
        {"average": 1.0},
        {"precision": "half"},
    ],
)
def test_an_impossible_recipe_is_refused(wrong):
    with pytest.raises(ValueError):  # noqa: PT011
        Recipe(**{"epochs": 1, "batch": 1} | wrong)


def test_a_users_choices_replace_those_of_the_recipe(recipe):
    assert recipe.with_choices() == recipe
    assert recipe.with_choices(9, "bf16") == replace(recipe, epochs=9, precision="bf16")
