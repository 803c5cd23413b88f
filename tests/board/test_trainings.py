"""One name, one training."""

from __future__ import annotations

import pytest

from tactibench.board import compare_trainings
from tactibench.protocols import load_protocol
from tactibench.records import SensorId


@pytest.fixture
def compared(fabricate):
    """The comparison of records of protocols, given as their keywords."""

    def compare(*several, sealed=True):
        records = []
        for number, keys in enumerate(several):
            weights, sensor = keys.get("weights", "ab"), keys.get("whole_sensor")
            own = {k: v for k, v in keys.items() if k not in ("weights", "whole_sensor")}
            record = fabricate(**own)
            if sensor is not None:
                record.sensor = SensorId.model_validate(sensor)
            record.identity.weights_hash = weights
            record.name = f"r{number}"
            if sealed:
                record.identity.checksum = "1"
            records.append((record, load_protocol(record.protocol.id)))
        return compare_trainings(records)

    return compare


def test_protocols_that_train_on_other_presses_have_weights_of_their_own(compared) -> None:
    """``fine`` presses tips of 1 mm, the experiments tips of 3 mm."""
    found = compared(
        {"protocol": "exp1", "weights": "w"},
        {"protocol": "exp2", "weights": "w"},
        {"protocol": "fine", "weights": "of fine"},
    )
    assert (found.contradictions, found.names) == ((), 2)


def test_weights_are_one_for_all_protocols_of_a_seed(compared) -> None:
    fine = [
        {"protocol": p, "seed": s, "weights": f"w{s}"} for p in ("exp1", "exp2") for s in (0, 1)
    ]
    found = compared(*fine)
    assert (found.contradictions, found.names) == ((), 2)
    found = compared(*fine, {"protocol": "exp3", "seed": 1, "weights": "other"})
    (sentence,) = found.contradictions
    assert "r4 are both seed 1 of unet + hertz (single), but have weights w1 and other" in sentence


@pytest.mark.parametrize(
    "other",
    [
        {"regime": "multiple"},
        {"settings": {"width": 32}},
        {"encoder": "depth"},
        {"sensor": {"instance": 3}},
        {"limits": {"quick": False, "limit": None, "presses": 250}},
        {"data": {"train": 192, "validation": 20, "test": 100}},
        {"protocol": "surface"},
    ],
)
def test_what_is_part_of_a_name_has_a_training_of_its_own(compared, other) -> None:
    assert not compared({"weights": "a"}, {"weights": "b", **other}).contradictions


def test_another_test_has_the_same_training(compared) -> None:
    """A perturbed instance that is only tested is no other sensor to be trained on."""
    tested = {
        "name": "tactip-127",
        "parameters": {"instance": 3, "tier": "auto"},
        "asked": ["sensor.instance=3"],
        "on": "another instance",
        "presses": 1000,
    }
    nominal = {"name": "tactip-127", "origin": "simulated"}
    parameters = {"parameters": {"instance": 0, "tier": "auto"}}
    plain = {"weights": "a", "whole_sensor": {**nominal, **parameters}}
    other = {"weights": "b", "whole_sensor": {**nominal, **parameters, "tested": tested}}
    assert compared(plain, other).contradictions


def test_all_seeds_of_a_model_that_draws_nothing_have_one_training(compared) -> None:
    model = {"model": "superpose", "encoder": None}
    assert not compared({**model, "seed": 0}, {**model, "seed": 1}).contradictions
    found = compared({**model, "seed": 0, "weights": "a"}, {**model, "seed": 1, "weights": "b"})
    assert "which draws nothing when it is trained" in found.contradictions[0]
    drawn = compared({"seed": 0, "weights": "a"}, {"seed": 1, "weights": "b"})
    assert not drawn.contradictions


def test_records_without_a_checksum_are_counted(compared) -> None:
    found = compared({"weights": "a"}, {"protocol": "exp2", "weights": "b"}, sealed=False)
    assert (found.contradictions, found.older, found.older_names) == ((), 2, 1)
    assert (
        "2 older records without a checksum, among them names with several trainings: 1."
        in found.note
    )
