"""Every score of a few frames is a valid record, whatever the model answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from tactibench.contacts import Contacts
from tactibench.protocols import load_protocol
from tactibench.records import Metric, Record, pack_contacts
from tactibench.records.record import _broken_invariants
from tactibench.run import score_arrays

Answers = list[Contacts]
RNG = np.random.default_rng(21)
PLACE = np.array([1.0, -2.0])


def scene(protocol: str, k: int) -> tuple[Contacts, str]:
    """The truth of frame ``k`` and its group."""
    middle = RNG.uniform(-5, 5, 2)
    if protocol == "exp1":
        return Contacts.truth([middle], [RNG.uniform(0.5, 4)]), "all"
    distance = (6.5, 9.0, 12.0)[k % 3]
    half = np.array([distance / 2, 0.0])
    return Contacts.truth([middle - half, middle + half], [2.0, 2.0]), str(distance)


def constant(truth: Answers) -> Answers:
    return [Contacts.truth([PLACE], [1.0]) for _ in truth]


def exact(truth: Answers) -> Answers:
    return truth


def absent(truth: Answers) -> Answers:
    return [Contacts.none() for _ in truth]


def far(truth: Answers) -> Answers:
    """Of a training that diverged: rounding of sums is larger than 1e-9 mm here."""
    return [Contacts(one.xy + 20138585.407, one.depth + 1e9, one.score) for one in truth]


def alike(truth: Answers) -> Answers:
    """All frames off by the same: no spread between presses."""
    return [Contacts(one.xy + 0.5, one.depth, one.score) for one in truth]


def random(truth: Answers) -> Answers:
    return [
        Contacts.truth(RNG.uniform(-8, 8, (count, 2)), RNG.uniform(0.5, 4, count))
        for count in RNG.integers(0, 4, len(truth))
    ]


MODELS = (constant, exact, absent, far, alike, random)


def scores(protocol: str, model: Callable[[Answers], Answers]) -> Iterator[list[Metric]]:
    spec = load_protocol(protocol).spec
    for count in (1, 3, 10) if protocol == "exp1" else (1, 4):
        truth, groups = zip(*(scene(protocol, k) for k in range(count)), strict=True)
        arrays = {
            **pack_contacts(truth),
            "press": np.array([f"p{k}" for k in range(count)]),
            "group": np.array(groups),
        }
        yield score_arrays(spec, arrays, pack_contacts(model(list(truth))), {})


@pytest.mark.parametrize("protocol", ["exp1", pytest.param("exp2", marks=pytest.mark.long)])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_no_invariant_is_broken(
    protocol: str, model: Callable[[Answers], Answers], fabricate: Callable[..., Record]
) -> None:
    for metrics in scores(protocol, model):
        record = fabricate(protocol).model_copy(update={"metrics": metrics})
        assert list(_broken_invariants(record)) == []
        for row in metrics:
            assert row.value is not None or row.low is row.high is None


def test_r2_of_a_constant_answer_has_a_value_and_no_interval() -> None:
    _, metrics, _ = scores("exp1", constant)
    row = next(m for m in metrics if (m.metric, m.group) == ("r2", "mean"))
    assert row.value is not None
    assert row.value < 0
    assert row.low is row.high is None
