"""Rows that were tested on something else than they were trained for stand in their own tables."""

from __future__ import annotations

import pytest
from changed_record import changed_record

from tactibench.board import (
    FOLDER,
    NOMINAL,
    PERTURBED,
    TESTED,
    compact,
    gather_records,
    measured_on,
    sections_of,
    select_section,
    slot,
    text_of,
    trained_for,
)
from tactibench.protocols import load_protocol
from tactibench.report.board_page import board_page

REFERENCE = {
    "name": "tactip-127-fem",
    "parameters": {"noise": True},
    "asked": ["reference"],
    "on": "finite-element scenes",
    "presses": 7,
}
OTHER = {
    "name": "tactip-127",
    "parameters": {"instance": 1},
    "asked": ["sensor.instance=1"],
    "on": "another individual (instance=1)",
    "presses": 1000,
}


NOMINAL_ONE = {
    "name": "tactip-127",
    "parameters": {"instance": 0},
    "asked": [],
    "on": "the nominal sensor",
    "presses": 1000,
}


@pytest.fixture
def tested(fabricate):
    def made(on, test=1000, **more):
        record = fabricate(**more)
        return changed_record(
            record,
            {
                "sensor.tested": on,
                "identity.data": [on["on"]],
                "data.test": test,
                "name": f"{record.name}-{on['name']}-{on['presses']}",
            },
        )

    return made


@pytest.fixture
def records(fabricate, tested):
    return [
        tested(OTHER),
        tested(REFERENCE, 35),
        fabricate(),
        fabricate(sensor={"instance": 1}),
        tested(OTHER, seed=1),
        tested(REFERENCE, 35, model="mean", encoder=None),
    ]


def test_they_follow_the_sensor_and_never_share_a_table(records):
    sections = sections_of(records)
    assert [section.kind for section in sections] == [NOMINAL, TESTED, TESTED, PERTURBED]
    assert [section.title for section in sections] == [
        "Simulated sensor tactip-127",
        "Simulated sensor tactip-127, tested on another individual (instance=1)",
        "Simulated sensor tactip-127, tested on finite-element scenes",
        "Simulated sensor tactip-127, instance=1: a perturbed individual",
    ]
    assert [len(section.rows) for section in sections] == [1, 1, 2, 1]
    assert sections[1].rows[0].seeds == (0, 1)


def test_they_differ_although_their_test_frames_were_not_recorded(fabricate, tested):
    one, two = fabricate(), tested(OTHER)
    two.identity.data = one.identity.data
    assert len(sections_of([one, two])) == 2
    assert slot(one) != slot(two)


def test_the_page_says_how_many_frames_and_how_to_add_trivial_rows(records):
    text = board_page(load_protocol("exp1"), records, []).markdown()
    head = "<summary>Simulated sensor tactip-127, tested on finite-element scenes</summary>"
    part = text.partition(head)[2]
    assert part
    assert "tested on 35 frames of 7 presses: `--test reference`." in part
    assert "tactibench run exp1 --model nearest --test reference`" in part
    assert "tested on 1,000 presses: `--test sensor.instance=1`." in text
    assert "### Cost" not in part.partition("<summary>Simulated")[0]
    assert board_page(load_protocol("exp1"), records[::-1], []).markdown() == text


def test_the_page_says_how_many_sensors_a_model_learned_from(tested):
    text = board_page(
        load_protocol("exp1"), [tested(NOMINAL_ONE, sensor={"instances": 64})], []
    ).markdown()
    told = "Trained on 64 sensors of the make and tested on 1,000 presses of the nominal sensor."
    assert told in text
    assert ": ``" not in text


def test_they_stand_beside_the_same_weights_on_the_protocols_own_test(fabricate, tested):
    records = [
        *(tested(OTHER, error=0.4, seed=seed) for seed in (0, 1)),
        *(fabricate(error=error, seed=seed) for seed, error in ((0, 0.1), (1, 0.3), (2, 0.9))),
        *(fabricate(error=0.7, seed=seed, sensor={"instance": 1}) for seed in (0, 1)),
    ]
    part = board_page(load_protocol("exp1"), records, []).markdown()
    (line,) = (
        line
        for line in part.partition("### Beside the protocol's own test")[2]
        .partition("The same weights")[0]
        .splitlines()
        if line.startswith("| unet")
    )
    assert "| 2 | 0.4000" in line  # of the two seeds that were tested elsewhere, 0.1 and 0.3
    assert "| 0.2000" in line


def test_other_weights_are_not_set_beside_them(fabricate, tested):
    records = [tested(OTHER, seed=3), fabricate(seed=0), fabricate(seed=3, regime="multiple")]
    assert "Beside the" not in board_page(load_protocol("exp1"), records, []).markdown()


def test_curves_and_frontiers_leave_them_out(records, tmp_path):
    folder = tmp_path / FOLDER / "exp1"
    folder.mkdir(parents=True)
    for record in records:
        (folder / f"{record.name}.json").write_text(text_of(record), encoding="utf-8")
    found = gather_records("exp1", tmp_path, None)
    assert len(found) == 2
    assert select_section(found, None, "exp1").kind == NOMINAL
    assert trained_for(records) == [records[2], records[3]]


def test_a_record_is_valid_and_committed_without_the_sensors_description(tested):
    record = tested(REFERENCE)
    record.identity.tested = {"describe": "long"}
    assert len(compact(record).identity.tested) == 64


def test_what_it_was_measured_on(fabricate, tested):
    assert measured_on(fabricate()) == "simulated sensor tactip-127"
    assert measured_on(tested(REFERENCE)) == (
        "simulated sensor tactip-127, tested on finite-element scenes"
    )


def moved(tested, source, target, **more):
    on = {
        "name": "recorded",
        "parameters": {"labels": "auto"},
        "asked": [f"data={target}"],
        "on": f"recording {target}",
        "presses": 1000,
        "trained_on": source,
    }
    return changed_record(
        tested(on, **more), {"data.of_tested_sensor": {"left_out_calibrated": 42}}
    )


def test_every_pair_of_sensors_has_a_table_and_says_what_was_simulated(tested):
    pairs = [
        ("real recording tac/331", "tac/127"),
        ("real recording tac/127", "tac/331"),
        ("simulated fitted-127", "tac/127"),
    ]
    records = [
        moved(tested, *pair, protocol="transfer", model=model, encoder=None)
        for pair in pairs
        for model in ("pins", "kernel")
    ]
    sections = sections_of(records)
    assert {section.title for section in sections} == {
        "Real recording tac/127, trained on real recording tac/331",
        "Real recording tac/331, trained on real recording tac/127",
        "Real recording tac/127, trained on simulated fitted-127",
    }
    assert all(len(section.rows) == 2 for section in sections)
    assert measured_on(records[-1]) == "real recording tac/127, trained on simulated fitted-127"
    text = board_page(load_protocol("transfer"), records, []).markdown()
    assert "the simulated sensor to 42, which test nothing; offset and pivot" in text
    assert "| labelled frames besides |" in text
    assert "Trivial rows" not in text
