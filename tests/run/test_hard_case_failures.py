"""A frame on which a model fails is counted in hard cases, and stops every other run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import Contacts, Frame, Pose, UserError
from tactibench.board import check_answers
from tactibench.records import pack
from tactibench.run import (
    AnswerRules,
    Failure,
    failure_arrays,
    failures_record,
    predict_frames,
    predict_or_fail,
)

FRAMES = [Frame(np.full((4, 4), k, np.uint8), 0.0, Pose()) for k in range(6)]
SHAPE = (4, 4)


class Fragile(StubModel):
    """Fails on frames 1 (raises), 2 (NaN), 3 (too many) and answers the others."""

    def predict(self, frames: Any) -> list[Any]:
        number = int(frames[0].image[0, 0])
        if number == 1:
            raise IndexError("index 127 is out\nof bounds \x1b[31m")
        if number == 2:
            return [Contacts(np.array([[np.nan, 0.0]]), np.ones(1), np.ones(1))]
        count = 3 if number == 3 else 1
        return [Contacts(np.zeros((count, 2)), np.ones(count), np.ones(count))]


class NanMaps(Fragile):
    """Frame 4 has a map that is not finite."""

    def maps(self, frames: Any) -> Any:
        self.seen = frames
        return np.full((1, 1, *SHAPE), np.nan if frames[0].image[0, 0] == 4 else 0.5, np.float32)

    def read_maps(self, _maps: Any) -> list[Any]:
        return self.predict(self.seen)


RULES = AnswerRules("contacts", 2, SHAPE)


def ask(model: Any) -> tuple[list[Any], list[Failure]]:
    done: list[int] = []
    answers, failures = predict_or_fail(model, FRAMES, RULES, done.append)
    assert sum(done) == len(FRAMES)
    return answers, failures


def test_failures_are_told_apart_and_named() -> None:
    answers, failures = ask(Fragile())
    assert [len(answer) for answer in answers] == [1, 0, 0, 0, 1, 1]
    assert [(one.row, one.raised) for one in failures] == [(1, True), (2, False), (3, True)]
    assert failures[0].cause == "IndexError: index 127 is out of bounds [31m"
    assert "xy holds a value that is not finite" in failures[1].cause
    assert "declares at most 2 contacts" in failures[2].cause


def test_maps_that_are_not_finite_count_as_such() -> None:
    _, failures = ask(NanMaps())
    assert [(one.row, one.raised) for one in failures][-1] == (4, False)


def test_other_protocols_stop_loudly() -> None:
    with pytest.raises(IndexError, match="out"):
        predict_frames(Fragile(), FRAMES, RULES, lambda _: None)  # type: ignore[arg-type]


def test_an_interruption_is_no_failure_of_the_model() -> None:
    class Stopped(Fragile):
        def predict(self, frames: Any) -> list[Any]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ask(Stopped())


def test_the_record_names_every_cause_once_with_its_first_case() -> None:
    _, failures = ask(Fragile())
    arrays = failure_arrays([*failures, failures[0]])
    found = failures_record(arrays, ["a:0", "blur:1", "blur:2", "dim:1", "b:0", "c:0"])
    assert found["frames"] == 4
    first = found["causes"][0]
    assert (first["first"], first["frames"]) == ("blur:1", 2)


def test_arrays_without_failures_have_their_types() -> None:
    arrays = failure_arrays([])
    assert {name: (a.dtype.kind, a.shape) for name, a in arrays.items()} == {
        "failed": ("i", (0,)),
        "raised": ("b", (0,)),
        "cause": ("U", (0,)),
    }


def submitted(**more: Any) -> dict[str, Any]:
    answers, failures = ask(Fragile())
    return {**pack(answers, "contacts"), **failure_arrays(failures), **more}


def test_answers_with_failures_are_checked() -> None:
    check_answers(submitted(), "contacts", 6, "a.npz", guarded=True)
    with pytest.raises(UserError, match="holds the arrays"):
        check_answers(submitted(), "contacts", 6, "a.npz")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"failed": np.array([1.0, 2.0, 3.0])}, "array 'failed' is missing or not how"),
        ({"failed": np.array([3, 2, 1])}, "rising numbers"),
        ({"failed": np.array([1, 2, 99])}, "rising numbers"),
        ({"failed": np.array([-3, 2, 3])}, "rising numbers"),
        ({"failed": np.array([0, 2, 3])}, "rising numbers"),  # frame 0 has a contact
        ({"raised": np.array([True])}, "array 'raised'"),
        ({"cause": np.array(["a", "b", "c\n"])}, "not printable"),
        ({"cause": np.array(["a", "b", "c" * 201])}, "longer than 200"),
    ],
)
def test_failures_of_strangers_are_not_believed(more: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        check_answers(submitted(**more), "contacts", 6, "a.npz", guarded=True)


def test_answers_of_another_shape_are_refused_before_failures_are_read() -> None:
    with pytest.raises(UserError, match="array 'count' has type"):
        check_answers(submitted(count=np.array(3)), "contacts", 6, "a.npz", guarded=True)


def test_missing_failures_are_refused() -> None:
    answers, _ = ask(Fragile())
    with pytest.raises(UserError, match="array 'failed' is missing"):
        check_answers(pack(answers, "contacts"), "contacts", 6, "a.npz", guarded=True)
