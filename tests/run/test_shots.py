"""``--test shots=N``: labelled presses of the tested sensor, which ``adapt`` alone is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from tactibench import UserError
from tactibench.board import command_options, rows_of
from tactibench.records import StoredRun
from tactibench.run import RunPlan, TestOptions

Planned = Callable[..., RunPlan]
Run = Callable[..., StoredRun]


def shifted(shots: int = 0, **more: Any) -> TestOptions:
    """A tested sensor whose depths read half a millimetre too large."""
    return TestOptions(parameters={"offset": "9.0"}, shots=shots, **more)


@pytest.fixture
def adapting(tiny: Any, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The tiny model learns the tested sensor's mean offset of depth; numbers of presses shown."""
    shown: list[int] = []

    def adapt(self: Any, frames: Any, truth: Any) -> Mapping[str, Any]:
        shown.append(len(frames))
        read = [self._read(frame)[0][2] for frame in frames]
        self.offset = float(np.mean([t.depth[0] for t in truth]) - np.mean(read))
        return {"offset": self.offset}

    monkeypatch.setattr(tiny.TinyModel, "adapt", adapt)
    return shown


def depth_error(run: StoredRun) -> float | None:
    return run.record.value("mae_mm", "z")


@pytest.mark.parametrize("protocol", ["exp1", "exp2", "exp3"])
def test_single_presses_of_the_tested_sensor_that_test_nothing(
    planned: Planned, adapting: list[int], protocol: str
) -> None:
    plan = planned(protocol, test=shifted(12))
    shots = plan.frames.few_shot
    assert shots is not None
    assert len(shots.scenes) == 12
    assert {len(scene.indenter.offsets) for scene in shots.scenes} == {1}
    space = plan.spec.workspace
    for scene in shots.scenes:
        assert space.depth_min_mm <= scene.pose.depth <= space.depth_max_mm
        assert max(abs(scene.pose.x), abs(scene.pose.y)) <= space.half_width_mm
    others = {scene for frames in plan.frames for scene in frames.scenes}
    assert not others & set(shots.scenes)
    assert shots.identity["parameters"] == {"offset": 9.0}  # type: ignore[attr-defined]


@pytest.mark.long
def test_they_correct_the_answers_and_no_weights(run: Run, tiny: Any, adapting: list[int]) -> None:
    without, after = run(test=shifted()), run(test=shifted(10))
    assert depth_error(without) == pytest.approx(0.5, abs=0.05)
    assert depth_error(after) < 0.05  # type: ignore[operator]
    assert adapting == [10]
    assert len(tiny.TinyModel.fits) == 1
    assert without.record.identity.weights_hash == after.record.identity.weights_hash
    assert without.record.identity.data == after.record.identity.data


def test_the_record_the_plan_the_row_and_the_signature_say_it(
    run: Run, planned: Planned, adapting: list[int]
) -> None:
    record = run(test=shifted(10)).record
    seen = record.data.of_tested_sensor
    assert seen is not None
    assert (seen.labelled_frames, record.shots) == ([10], 10)
    assert seen.adapted[0]["shots"] == 10
    assert "|test:sensor.offset=9.0,shots=10|" in record.signature
    assert "-on-offset-9.0-shots-10-s0-" in record.name
    plan = "\n".join(planned(test=shifted(11)).lines())
    assert "  shots: generate 11 (shots) frames on tactip-127" in plan
    other = run(test=shifted()).record
    rows = rows_of([record, other])
    assert [row.label for row in rows] == ["tiny (single)", "tiny, 10 labelled presses (single)"]
    assert {command_options(row.first) for row in rows} == {" --test sensor.offset=9.0"}


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"test": TestOptions(shots=5)}, "presses of another sensor than the trained one"),
        ({"test": TestOptions(reference=True, shots=5)}, "few scenes for the test alone"),
        ({"protocol": "stability", "test": shifted(5)}, "tests many sensors at once"),
    ],
)
def test_where_none_can_be_shown(
    planned: Planned, adapting: list[int], asked: dict[str, Any], said: str
) -> None:
    if asked.pop("protocol", None):
        from tactibench.protocols import protocol_files

        asked["protocol"] = str(protocol_files()["stability"])
    with pytest.raises(UserError, match=said):
        planned(**asked)


def test_a_model_that_cannot_adapt_is_refused(planned: Planned) -> None:
    with pytest.raises(UserError, match="model tiny cannot adapt to labelled presses"):
        planned(test=shifted(5))


def test_a_model_that_says_so_when_it_is_asked(
    run: Run, tiny: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiny.TinyModel, "adapt", lambda *_: None)
    with pytest.raises(UserError, match="cannot adapt to labelled presses"):
        run(test=shifted(5))
