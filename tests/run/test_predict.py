"""Predictions of a stopped run are taken for one set of weights, and never used when damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stubs import StubModel

from tactibench import UserError
from tactibench.contacts import Contacts, Frame, PlatePose, Pose
from tactibench.records import arrays_hash, pack
from tactibench.run import AnswerRules, Predictions, predict_frames, resumed_predictions

CONTACTS = [
    Contacts(np.array([[1.0, 2.0], [3.0, -4.0]]), np.array([1.0, 0.1]), np.array([0.9, 0.3])),
    Contacts.none(),
]
HEAT = np.linspace(0, 1, 2 * 4 * 4).reshape(2, 4, 4).astype(np.float16)


class Asked:
    """Counts how often the model is asked."""

    def __init__(self, answers: Any = CONTACTS, kind: str = "contacts", heat: Any = HEAT) -> None:
        self.count, self.answers, self.kind, self.heat = 0, answers, kind, heat

    def __call__(self) -> Predictions:
        self.count += 1
        return Predictions(pack(self.answers, self.kind), self.heat)


def test_kept_predictions_are_the_same_bits_and_the_model_is_asked_once(tmp_path: Path) -> None:
    ask, path = Asked(), tmp_path / "a.npz"
    first, second = (resumed_predictions(path, "w1", ask) for _ in range(2))
    assert ask.count == 1
    assert arrays_hash(first.arrays) == arrays_hash(second.arrays)
    assert np.array_equal(first.maps, second.maps)  # type: ignore[arg-type]
    assert np.array_equal(second.answers("contacts")[0].xy, CONTACTS[0].xy)  # type: ignore[union-attr]


def test_plates_without_an_answer_and_without_maps_are_kept(tmp_path: Path) -> None:
    ask = Asked([PlatePose(2.5, -3.0), None], "plate", None)
    for _ in range(2):
        predictions = resumed_predictions(tmp_path / "a.npz", "w1", ask)
    assert ask.count == 1
    assert predictions.map_arrays == {}
    assert predictions.answers("plate") == [PlatePose(2.5, -3.0), None]


@pytest.mark.parametrize("change", ["weights", "flipped", "cut", "empty", "no file"])
def test_the_model_is_asked_again(tmp_path: Path, change: str) -> None:
    ask, path = Asked(), tmp_path / "a.npz"
    resumed_predictions(path, "w1", ask)
    raw = path.read_bytes()
    middle = len(raw) // 2
    damaged = {
        "flipped": raw[:middle] + bytes([raw[middle] ^ 0xFF]) + raw[middle + 1 :],
        "cut": raw[:middle],
        "empty": b"",
    }
    if change in damaged:
        path.write_bytes(damaged[change])
    if change == "no file":
        path.unlink()
    for _ in range(2):
        predictions = resumed_predictions(path, "w2" if change == "weights" else "w1", ask)
        assert ask.count == 2
        assert np.array_equal(predictions.maps, HEAT)  # type: ignore[arg-type]


def test_a_model_with_maps_and_no_reader_is_told_to_write_one() -> None:
    class Maps(StubModel):
        def maps(self, frames: Any) -> Any:
            return np.zeros((len(frames), 1, 4, 4), np.float32)

    frame = Frame(np.zeros((8, 8), np.uint8), 0.0, Pose(), np.zeros((8, 8), np.uint8))
    rules = AnswerRules("contacts", None, (4, 4))
    with pytest.raises(UserError, match="model Maps gives maps, but has no read_maps"):
        predict_frames(Maps(), [frame], rules, lambda _: None)  # type: ignore[arg-type]
