"""Tests that are scored apart have errors, an order and ranks of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench.board import (
    PressErrors,
    ordered,
    press_errors_of,
    ranked_errors,
    ranks,
    read_press_errors,
    rows_of,
)
from tactibench.contacts import Contacts
from tactibench.metrics.detection import gospa
from tactibench.protocols import board_spec, load_protocol
from tactibench.records import pack, write_arrays

SPEC = load_protocol("exp2").spec
GROUPS = (
    *("6.5",) * 3,
    "catch",
    *("heldout:between",) * 2,
    "heldout:uneven",
    *("unseen:instance-1", "unseen:instance-2") * 2,
)


def answered(rng: np.random.Generator) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Truth of every group, and answers near it, one of them with a contact missing."""
    truth, seen = [], []
    for group in GROUPS:
        xy = rng.uniform(-6, 6, (1 if group == "catch" else 2, 2))
        truth.append(Contacts.truth(xy, np.full(len(xy), 2.0)))
        found = xy + rng.normal(0, 0.1, xy.shape)
        seen.append(Contacts(found, np.full(len(xy), 2.1), np.full(len(xy), 1.0)))
    seen[5] = Contacts.none()
    names = np.array([f"press-{k}" for k in range(len(GROUPS))])
    packed = {**pack(truth, "contacts"), "press": names, "group": np.array(GROUPS)}
    return packed, pack(seen, "contacts")


def test_errors_press_by_press_are_those_of_each_test(tmp_path: Path) -> None:
    truth, seen = answered(np.random.default_rng(0))
    errors = press_errors_of(SPEC, truth, seen)
    assert set(errors.press) == {"press-0", "press-1", "press-2"}  # no catch trial
    assert {name: own.press.tolist() for name, own in errors.apart.items()} == {
        "heldout": ["press-4", "press-5", "press-6"],
        "unseen": ["instance-1", "instance-2"],  # the unit is the sensor
    }
    places, found = (
        np.split(np.column_stack([one["xy"], one["depth"]]), np.cumsum(one["count"])[:-1])
        for one in (truth, seen)
    )
    each = [gospa(*pair, SPEC.test.gate_mm, 1) for pair in zip(places, found, strict=True)]
    expected, unseen = each[4:7], np.reshape(each[7:], (2, 2)).mean(axis=0)
    assert errors.apart["unseen"].error == pytest.approx(unseen)
    assert errors.apart["heldout"].error == pytest.approx(expected)
    assert errors.apart["heldout"].error[1] == SPEC.test.gate_mm  # two missed

    path = tmp_path / "run.npz"
    write_arrays(path, {**seen, **ranked_errors(SPEC, truth, seen)})
    read = read_press_errors(path)
    assert read is not None
    for one, other in ((read, errors), *((read.apart[n], errors.apart[n]) for n in errors.apart)):
        assert one.press.tolist() == other.press.tolist()
        assert one.error.tolist() == other.error.tolist()


def test_a_table_of_a_test_apart_has_its_own_order_and_ranks(fabricate) -> None:
    """The best on the nominal sensor is the worst on others."""
    rng = np.random.default_rng(2)
    presses = np.array([f"p{k:03d}" for k in range(200)])
    hard = rng.gamma(2, 1, 200)
    values = {"a": (0.1, 3.0), "b": (1.0, 2.0), "c": (2.0, 0.2)}
    made, errors = [], {}
    for name, (nominal, unseen) in values.items():
        for seed in range(3):
            metrics = (("gospa_depth_mm", "unseen", unseen),)
            record = fabricate(model=name, encoder=None, seed=seed, error=nominal, metrics=metrics)
            record.identity.weights_hash = f"{name}{seed}"
            noise = rng.normal(0, 0.01, 200)
            own = PressErrors(presses, hard * unseen + noise)
            errors[record.name] = PressErrors(presses, hard * nominal + noise, {"unseen": own})
            made.append(record)
    rows = rows_of(made)
    for apart, best in (("", "abc"), ("unseen", "cba")):
        found = ordered("exp1", rows, apart)
        assert "".join(row.first.model.name for row in found) == best
        ranked = ranks("exp1", found, errors, apart)
        assert ranked is not None
        assert ranked.by_row == ((1, 1), (2, 2), (3, 3))


@pytest.mark.parametrize("label", ["exp1", "exp2", "exp3"])
def test_every_test_apart_has_a_ranking_and_a_table(label: str) -> None:
    tests, board = load_protocol(label).spec.test.apart, board_spec(label)
    assert {one.name for one in tests} == set(board.apart)
    assert {block.apart for block in board.blocks} - {""} == set(board.apart)
    for test in tests:
        assert board.apart[test.name].metric in test.metrics
        shown = {
            column.metric
            for block in board.blocks
            for column in block.columns
            if column.group.partition(":")[0] == test.name
        }
        assert shown <= set(test.metrics)
