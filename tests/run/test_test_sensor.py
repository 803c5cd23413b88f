"""``--test``: other frames to be tested on, the training left as it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.records import StoredRun, unpack_contacts
from tactibench.run import RunPlan, TestOptions, read_test_options

pytestmark = pytest.mark.long

Planned = Callable[..., RunPlan]
Run = Callable[..., StoredRun]
REFERENCE = TestOptions(reference=True)
SHIFTED = TestOptions(parameters={"offset": "9.0"})


def rows(done: StoredRun) -> dict[tuple[str, str], Any]:
    return {(row.metric, row.group): row for row in done.record.metrics}


@pytest.mark.parametrize(
    ("protocol", "frames", "presses", "rejected"),
    [("exp1", 2, 1, 2), ("exp2", 4, 2, 0), ("exp3", 6, 3, 0)],
)
def test_reference_scenes_with_the_protocols_tips_inside_its_workspace(
    run: Run, protocol: str, frames: int, presses: int, rejected: int
) -> None:
    done = run(protocol, test=REFERENCE)
    truth = done.arrays("truth")
    assert len(truth["press"]) == done.record.data.test == frames
    assert len(set(truth["press"])) == done.record.sensor.test_sensor.presses == presses
    assert done.record.data.rejected == rejected
    for one, two in zip(
        unpack_contacts(truth), unpack_contacts(done.arrays("predictions")), strict=True
    ):
        np.testing.assert_allclose(one.xy, two.xy, atol=1 / 18 + 1e-9)
    assert rows(done)["missed", "all"].value == 0
    assert rows(done)["missed", "all"].clusters == presses
    assert done.record.partial is False


def test_what_the_reference_cannot_tell_is_neither_zero_nor_an_error(run: Run) -> None:
    found = rows(run("exp2", test=REFERENCE))
    assert {group for metric, group in found if metric == "resolved"} == {"7.0", "12.0", "all"}
    for metric in ("catch_resolved", "d_prime"):
        assert found[metric, "all"].value is None
    assert found["threshold_mm", "all"].censored == "<", "of the distances that there are"
    assert found["distance_mae_mm", "7.0"].low is None, "one press has no interval"


@pytest.mark.usefixtures("unscored")
@pytest.mark.parametrize("tested", [REFERENCE, SHIFTED], ids=["reference", "shifted"])
def test_weights_are_those_of_the_ordinary_run(
    run: Run, planned: Planned, tiny: Any, tested: TestOptions
) -> None:
    plan, other = planned("exp2"), planned("exp2", test=tested)
    assert other.weights.identity == plan.weights.identity
    assert other.name != plan.name
    assert not {w.key for w in other.frames.test} & {w.key for w in plan.frames.test}
    runs = [run("exp2"), run("exp2", test=tested)]
    assert len(tiny.TinyModel.fits) == 1
    assert len({one.record.identity.weights_hash for one in runs}) == 1


def test_the_same_presses_on_a_sensor_with_other_parameters(run: Run, planned: Planned) -> None:
    base, shifted = planned("exp1"), planned("exp1", test=SHIFTED)
    assert shifted.frames.test[0].scenes == base.frames.test[0].scenes
    assert shifted.frames.sensor_identity == base.frames.sensor_identity
    assert shifted.frames.test_identity["parameters"] == {"offset": 9.0}  # type: ignore[index]
    one, two = rows(run("exp1")), rows(run("exp1", test=SHIFTED))
    # 9 grey levels are half a millimetre, of which the model was told nothing
    assert two["mae_mm", "x"].value == pytest.approx(0.5, abs=0.03)
    assert one["mae_mm", "x"].value < 0.03


def test_the_record_the_plan_and_the_signature_say_it(run: Run, planned: Planned) -> None:
    done = run("exp1", test=SHIFTED)
    tested = done.record.sensor.test_sensor
    assert tested is not None
    assert tested.json_values() == {
        "name": "tactip-127",
        "parameters": {"offset": 9.0},
        "asked": ["sensor.offset=9.0"],
        "on": "another setting (offset=9.0)",
        "presses": 20,
    }
    assert done.record.sensor.parameters == {"offset": 0.0}
    assert "|seed:0|test:sensor.offset=9.0|weights:" in done.record.signature
    assert "-on-offset-9.0-s0-" in done.record.name
    text = "\n".join(planned("exp2", test=REFERENCE, store="none").lines())
    assert "test:  on known scenes: generate 4 (pairs) frames on known;" in text
    assert "take the trained weights from the cache" in text
    plain = run("exp1").record
    assert plain.test_sensor is None
    assert "tested" not in plain.identity.json_values()
    assert "test:" not in plain.signature


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (
            {"sensor": "other", "test": REFERENCE},
            "sensor 'other' has no reference scenes; tactip-127 have some",
        ),
        ({"sensor": "known"}, "use --sensor tactip-127 --test reference"),
        ({"test": TestOptions(parameters={"ofset": "1"})}, "did you mean 'offset'?"),
        ({"test": TestOptions(parameters={"offset": "x"})}, "must be a finite number"),
        (
            {"test": TestOptions(parameters={"offset": "0"})},
            "--test sensor.offset=0 is what the training frames are made with already",
        ),
    ],
    ids=str,
)
def test_requests_that_cannot_be_met(planned: Planned, request_: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError) as raised:
        planned(**request_)
    assert said in str(raised.value)


def test_a_reference_without_fitting_scenes(planned: Planned, tiny: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(tiny.TinyReference, "scenes", lambda _: {})
    with pytest.raises(UserError, match="none of the 0 known scenes"):
        planned(test=REFERENCE)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("refrence", "did you mean 'reference'?"),
        ("zzz", "known: data, reference, shots."),
        ("instance=1", "changes no sensor; write sensor.NAME=VALUE"),
        ("model.width=2", "changes no sensor"),
        ("sensor.=2", "changes no sensor"),
        ("", "is neither the word 'reference' nor sensor.NAME=VALUE"),
        ("shots=-1", "is no number of presses"),
        ("shots=10001", "from 0 to 10,000"),
        ("shots=5,shots=5", "given twice"),
    ],
)
def test_words_that_are_not_understood(text: str, said: str) -> None:
    with pytest.raises(UserError) as raised:
        read_test_options(tuple(text.split(",")))
    assert said in str(raised.value)


@given(
    st.booleans(), st.dictionaries(st.sampled_from("abc"), st.text(max_size=3)), st.integers(0, 99)
)
def test_what_is_read_can_be_asked_again(
    reference: bool, parameters: dict[str, str], shots: int
) -> None:
    asked = TestOptions(reference, parameters, shots=shots)
    assert read_test_options(tuple(asked.texts)) == asked
    assert bool(asked) == bool(asked.texts)
