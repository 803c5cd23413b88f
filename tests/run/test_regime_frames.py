"""What a regime hands to ``fit``: in ``single``, frames of one contact and nothing else."""

from __future__ import annotations

from typing import Any

import pytest

pytestmark = pytest.mark.long

Shown = list[tuple[list[Any], list[Any]]]


@pytest.fixture
def handed(tiny: Any, monkeypatch: pytest.MonkeyPatch) -> Shown:
    """(frames, truth) of training and of validation, as every ``fit`` was given them."""
    seen: Shown = []
    fit = tiny.TinyModel.fit

    def _fit(self: Any, frames: Any, truth: Any, **more: Any) -> Any:
        seen.append((list(frames), list(truth)))
        seen.append(tuple(map(list, more["validation"])))  # type: ignore[arg-type]
        return fit(self, frames, truth, **more)

    monkeypatch.setattr(tiny.TinyModel, "fit", _fit)
    return seen


def tips(frame: Any) -> int:
    """How many tips the tiny sensor shows in a frame."""
    return int(frame.image[0, 3])


@pytest.mark.parametrize("protocol", ["exp1", "exp2", "exp3"])
def test_regime_single_shows_single_presses_only(run: Any, handed: Shown, protocol: str) -> None:
    run(protocol, regime="single")
    assert len(handed) == 2
    for frames, truth in handed:
        assert len(frames) == len(truth) > 0
        assert {tips(frame) for frame in frames} == {1}
        assert {len(contacts) for contacts in truth} == {1}


def test_regime_multiple_shows_several(run: Any, handed: Shown) -> None:
    run("exp2", regime="multiple")
    frames, truth = handed[0]
    assert {1, 2, 3} <= {tips(frame) for frame in frames}
    assert [tips(frame) for frame in frames] == [len(contacts) for contacts in truth]
