"""Rank intervals: what presses and seeds tell apart, and rows that have too few of either."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactibench.board import (
    PressErrors,
    RankInterval,
    all_press_errors,
    rank_intervals,
    ranks,
    read_submissions,
    rows_of,
)
from tactibench.protocols import board_spec, protocol_files
from tactibench.stats import adjust_pairs

BOARD = Path(__file__).resolve().parents[2] / "leaderboards"
PRESSES = np.array([f"p{k:03d}" for k in range(200)])
SEEDS = 3


def records(fabricate, errors, seeds=SEEDS, **more):
    """Records of every model, one a seed, whose values are the means of their errors.

    errors: model -> (presses,) errors of every seed, or (seeds, presses).
    """
    made = []
    for name, values in errors.items():
        table = np.atleast_2d(values)
        for seed in range(seeds):
            own = table[seed % len(table)]
            record = fabricate(model=name, encoder=None, seed=seed, **more)
            record.identity.weights_hash = f"{name}{seed}"
            record.metric("gospa_depth_mm", "all").value = own.mean()
            made.append(record)
    return made


def kept(made, errors, presses=PRESSES):
    """The errors beside the records, press by press."""
    tables = {name: np.atleast_2d(values) for name, values in errors.items()}
    return {
        record.name: PressErrors(
            presses, tables[record.model.name][record.seed % len(tables[record.model.name])]
        )
        for record in made
    }


@pytest.fixture
def errors():
    """Presses differ much more than models do; b is only told from a by pairing."""
    rng = np.random.default_rng(0)
    hard = rng.gamma(2, 1, 200)
    return {"a": hard, "b": hard + 0.1 + rng.normal(0, 0.05, 200), "c": hard + 9.0}


def by_model(found, rows):
    """Ranks as a board shows them, by model; "" for none."""
    models = (row.first.model.name for row in rows)
    return {name: str(rank or "") for name, rank in zip(models, found.by_row, strict=True)}


def ranked(fabricate, errors, **more):
    made = records(fabricate, errors, **more)
    rows = rows_of(made)
    return by_model(ranks("exp1", rows, kept(made, errors)), rows)


def test_pairing_tells_apart_what_overlapping_intervals_do_not(fabricate, errors) -> None:
    made = records(fabricate, errors)
    rows = rows_of(made)
    paired = ranks("exp1", rows, kept(made, errors))
    assert by_model(paired, rows) == {"a": "1", "b": "2", "c": "3"}
    assert paired.note == ""
    # A row without errors of all its records has no rank.
    known = kept(made, errors)
    del known[next(record.name for record in made if record.model.name == "b")]
    some = ranks("exp1", rows, known)
    assert by_model(some, rows) == {"a": "1", "b": "", "c": "2"}


def test_seeds_are_averaged_press_by_press(fabricate, errors) -> None:
    """Seeds whose errors swap are as good as those that all have their mean."""
    swing = np.where(np.arange(200) % 2, 1.0, -1.0)
    table = errors["a"] + swing * np.array([[1.0], [-1.0], [0.0]])
    assert ranked(fabricate, {"a": table, "b": errors["a"]}) == {"a": "1–2", "b": "1–2"}


def independent_ranks(models):
    """Rank intervals of models (seeds, presses), computed with loops and scipy."""

    def p_value(one, other):
        apart = abs(np.log(one.mean() / other.mean()))
        press = one.mean(0) / one.mean() - other.mean(0) / other.mean()
        presses = [(press.var(ddof=1) / len(press), len(press) - 1)]
        seeds = [((e.mean(1) / e.mean()).var(ddof=1) / len(e), len(e) - 1) for e in (one, other)]
        found = []
        for terms in (seeds, seeds + presses):
            v = sum(x for x, _ in terms)
            f = v**2 / sum(x**2 / n for x, n in terms)
            found.append(2 * stats.t.sf(apart / v**0.5, f))
        return max(found)

    pairs = list(combinations(models, 2))
    adjusted = stats.false_discovery_control([p_value(models[a], models[b]) for a, b in pairs])
    best, worst = dict.fromkeys(models, 1), dict.fromkeys(models, len(models))
    for pair, p in zip(pairs, adjusted, strict=True):
        if p < 0.05:
            smaller, larger = sorted(pair, key=lambda name: models[name].mean())
            best[larger] += 1
            worst[smaller] -= 1
    return {n: f"{best[n]}" if best[n] == worst[n] else f"{best[n]}–{worst[n]}" for n in models}


def noisy(rng, scales, seed_share=0.05, press_sd=0.3, presses=200):
    """Errors of models that differ by a factor, of seeds that scatter it."""
    hard = rng.gamma(2, 1, presses) + 1.0
    return {
        name: scale
        * (hard + rng.normal(0, press_sd, presses) + rng.normal(0, 0.1, (SEEDS, presses)))
        * (1 + rng.normal(0, seed_share, (SEEDS, 1)))
        for name, scale in scales.items()
    }


@pytest.mark.parametrize("seed", range(6))
def test_ranks_are_those_of_an_independent_implementation(fabricate, seed) -> None:
    rng = np.random.default_rng(seed)
    errors = noisy(rng, {name: 1 + 0.1 * k**2 for k, name in enumerate("abcdef")})
    assert ranked(fabricate, errors) == independent_ranks(errors)


@given(st.integers(0, 10_000), st.integers(2, 9))
def test_a_smaller_error_never_has_a_worse_rank_than_rows_it_is_better_than(seed, count) -> None:
    """No inverted pair: a row that is significantly better ends before the other one."""
    rng = np.random.default_rng(seed)
    value = np.sort(rng.normal(size=count))
    difference = value[:, None] - value
    p = rng.random((count, count)) ** 3
    p = np.where(difference == 0, 1.0, np.minimum(p, p.T))
    found = rank_intervals(difference, p)
    surely = (adjust_pairs(p) < 0.05) & (difference < 0)
    for k, (best, worst) in enumerate(found):
        assert best <= worst
        assert best == 1 + surely[:, k].sum()
        assert worst == count - surely[k].sum()


def test_models_that_differ_by_their_seeds_alone_share_a_rank(fabricate) -> None:
    """In 95 % of the tables, though the presses alone tell nearly all trainings apart."""
    rng = np.random.default_rng(1)
    tables = 100
    shared = 0
    made = records(fabricate, dict.fromkeys("abcdef", 1.0))
    rows = rows_of(made)
    for _ in range(tables):
        errors = noisy(rng, dict.fromkeys("abcdef", 1.0), seed_share=0.1, press_sd=0.02)
        of_record = kept(made, errors)
        for record in made:
            record.metric("gospa_depth_mm", "all").value = of_record[record.name].error.mean()
        shared += set(ranks("exp1", rows, of_record).by_row) == {RankInterval(1, 6)}
    # Two standard deviations of such a share are 4.4 %.
    assert shared / tables > 0.95 - 0.044


def test_a_row_that_scatters_may_have_any_rank_and_moves_no_other(fabricate) -> None:
    hard = np.random.default_rng(1).gamma(2, 0.1, 200)
    scattering = np.stack([0.2 * hard, 0.2 * hard, 9 * hard])
    found = ranked(fabricate, {"a": hard, "b": 1.5 * hard, "c": scattering})
    assert found == {"a": "1–2", "b": "2–3", "c": "1–3"}


def test_three_seeds_tell_an_error_from_its_tenfold(fabricate) -> None:
    rng = np.random.default_rng(2)
    found = ranked(fabricate, noisy(rng, {name: 10.0**k for k, name in enumerate("abcdef")}))
    assert list(found.values()) == list("123456")


def test_rows_of_too_few_presses_or_seeds_have_no_rank(fabricate, errors) -> None:
    assert ranked(fabricate, errors, seeds=2) == {"a": "", "b": "", "c": ""}
    made = records(fabricate, errors)
    rows = rows_of(made)
    few = {n: PressErrors(PRESSES[:19], e.error[:19]) for n, e in kept(made, errors).items()}
    found = ranks("exp1", rows, few)
    assert found.by_row == (None, None, None)
    assert "3 rows have no rank: fewer than 20 presses or sensors" in found.note
    enough = {n: PressErrors(PRESSES[:20], e.error[:20]) for n, e in kept(made, errors).items()}
    assert None not in ranks("exp1", rows, enough).by_row


def test_seeds_of_one_training_count_once(fabricate, errors) -> None:
    """Whoever sends one training three times, under three seeds, has one."""
    made = records(fabricate, errors)
    for number, record in enumerate(made):
        record.identity.predictions_hash = f"answers {number}"
        if record.model.name == "a":
            record.identity.weights_hash = "same"
    rows = rows_of(made)
    found = ranks("exp1", rows, kept(made, errors))
    assert by_model(found, rows) == {"a": "", "b": "1", "c": "2"}
    assert "1 row has no rank" in found.note


def test_a_model_whose_three_seeds_answer_the_same_draws_nothing(fabricate, errors) -> None:
    made = records(fabricate, errors)
    for number, record in enumerate(made):
        own = record.model.name == "a"
        record.identity.predictions_hash = "same" if own else f"answers {number}"
        record.identity.weights_hash = "same" if own else f"weights {number}"
    rows = rows_of(made)
    assert by_model(ranks("exp1", rows, kept(made, errors)), rows)["a"] == "1"


@pytest.mark.parametrize(
    "protocol",
    [n for n in protocol_files() if board_spec(n).ranking and (BOARD / "submissions" / n).is_dir()],
)
def test_the_errors_that_rank_have_the_printed_error_as_their_mean(protocol) -> None:
    by = board_spec(protocol).ranking
    committed = read_submissions(BOARD, protocol)
    errors = all_press_errors(BOARD, committed)
    printed = {record.name: record.value(by.metric, by.group) for record in committed}
    means = {name: errors[name].error.mean() for name in errors if printed[name] is not None}
    assert means
    assert means == pytest.approx({name: printed[name] for name in means}, rel=1e-9)


def test_one_seed_of_a_shipped_model_that_draws_nothing_is_enough(fabricate, errors) -> None:
    named = dict(zip(("nearest", "superpose", "mean"), errors.values(), strict=True))
    found = ranked(fabricate, named, seeds=1)
    assert found == {"nearest": "1", "superpose": "2", "mean": "3"}


def test_a_row_without_the_error_and_a_protocol_without_an_order(fabricate, errors) -> None:
    made = records(fabricate, errors)
    for record in made:
        if record.model.name == "b":
            record.metric("gospa_depth_mm", "all").value = None
    rows = rows_of(made)
    assert by_model(ranks("exp1", rows, kept(made, errors)), rows) == {"a": "1", "b": "", "c": "2"}
    assert ranks("unordered", rows, {}) is None


def test_a_row_with_errors_of_few_presses_is_not_paired(fabricate, errors) -> None:
    """It could choose the presses that it is compared on."""
    made = records(fabricate, errors)
    rows = rows_of(made)
    for count, rank in ((199, "2"), (100, "1–2"), (20, "1–2")):
        known = kept(made, errors)
        for record in made:
            if record.model.name == "b":
                known[record.name] = PressErrors(PRESSES[:count], errors["b"][:count])
        assert by_model(ranks("exp1", rows, known), rows)["b"] == rank
    others = np.array([f"q{k:03d}" for k in range(200)])
    for model in "bc":
        mine = {r.name for r in made if r.model.name == model}
        known = kept(made, errors) | {name: PressErrors(others, errors[model]) for name in mine}
        assert by_model(ranks("exp1", rows, known), rows)[model] == ("1–2" if model == "b" else "3")
