"""The configuration file: what it takes, and what it says of mistakes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from fake_station import EXAMPLE, STAGE

from tactibench import Indenter, UserError
from tactibench_tactip import BINDING, Settings, read_settings


@pytest.mark.parametrize("angles", ["180.3, -0.8, 2.0", "0.4, -0.3, 1.2", "363.1, 0.0, 0.0"])
def test_small_angles_in_degrees_are_taken(tmp_path: Path, angles: str) -> None:
    path = changed(tmp_path, "180.0, 0.0, -90.0]", f"{angles}]")
    assert read_settings(path).frames.work_frame[3] == float(angles.split(",")[0])


def test_the_example_is_valid_and_shows_every_table() -> None:
    tables = tomllib.loads(EXAMPLE)
    assert Settings.model_validate(tables).robot.driver == "ur"
    assert Settings.model_validate(tomllib.loads(STAGE)).robot.homes
    assert {"schema", *tables} == {"schema", *Settings.model_fields} - {"schema_"}


def changed(tmp_path: Path, before: str, after: str) -> Path:
    assert before in EXAMPLE
    path = tmp_path / "lab.toml"
    path.write_text(EXAMPLE.replace(before, after, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("press_mm_s", "pres_mm_s", r"unknown key 'robot.pres_mm_s'.*'press_mm_s'"),
        ("press_mm_s = 5.0", "press_mm_s = 50.0", r"'robot.press_mm_s' is 50.0.*equal to 20"),
        ('driver = "ur"', 'driver = "kuka"', r"'robot.driver' is 'kuka'.*'ur', 'grbl' or 'cri'"),
        ("settle_s = 0.2", "settle_s = nan", r"'timing.settle_s' is nan"),
        ('kind = "single"', 'kind = "dual"', r"distance_mm belongs to a dual"),
        ("press_mm_s = 5.0", "press_mm_s = 0.005", r"'robot.press_mm_s' is 0.005"),
        ("half_width_mm = 12.0", "half_width_mm = 0.012", r"'envelope.half_width_mm' is 0.012"),
        ("[109.1, -487.0, 341.3,", "[0.1091, -0.487, 0.3413,", r"work_frame lies .* in mm, not"),
        ("[0.0, 0.0, 89.1,", "[0.0, 0.0, 0.0891,", r"frames.tcp_pose lies 0.0891 mm"),
        ("180.0, 0.0, -90.0]", "3.14159, 0.0, -1.5708]", r"looks like radians; write degrees"),
        ("180.0, 0.0, -90.0]", "2.2214, -2.2214, 0.0]", r"looks like radians; write degrees"),
        ("schema = 1", "schema = 2", r"key 'schema' is 2"),
        ("schema = 1", "schema = [", r"not valid TOML"),
        ('address = "192.168.1.10"', "", r"'robot.address' is missing"),
    ],
)
def test_a_mistake_is_one_sentence_with_the_key(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    path = changed(tmp_path, before, after)
    with pytest.raises(UserError, match=message) as caught:
        read_settings(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="hw example` writes one"):
        read_settings(tmp_path / "none.toml")


def test_indenters() -> None:
    base = tomllib.loads(EXAMPLE)
    base["indenter"] = {"kind": "triple", "heights_mm": [0.0, 1.5, 3.0]}
    keys = Settings.model_validate(base).indenter
    assert keys.indenter() == Indenter.triple((0.0, 1.5, 3.0))
    base["indenter"] = {"kind": "dual", "distance_mm": 8.5}
    assert Settings.model_validate(base).indenter.indenter() == Indenter.dual(8.5)
    base["indenter"] = {"kind": "plate"}
    assert Settings.model_validate(base).indenter.indenter().is_plate


def test_a_data_set_is_bound_to_what_decides_on_frames_and_labels() -> None:
    tables = tomllib.loads(EXAMPLE)
    begun = Settings.model_validate(tables).binding()
    tables["robot"] |= {"address": "10.0.0.2", "watchdog_hz": 5.0}
    tables["camera"] |= {"source": 3, "stall_s": 2.0}
    tables["sensor"]["pins_tolerance"] = 6
    tables["indenter"] = {"kind": "dual", "distance_mm": 9.0}
    tables["safety"]["give_up"] = 9
    tables["timing"]["settle_s"] = 0.3
    tables["envelope"]["max_force_n"] = 10.0
    now = Settings.model_validate(tables)
    assert now.binding() == begun
    for table, key, value in (
        ("robot", "press_mm_s", 4.0),
        ("frames", "sensor", [0.1, 0.0, 0.0]),
        ("camera", "burst", 5),
        ("contact", "fixed_mm", 0.1),
    ):
        changed = {**tables, table: {**tables[table], key: value}}
        assert Settings.model_validate(changed).binding() != begun


def test_the_docs_name_every_key_that_binds_a_data_set() -> None:
    docs = (Path(__file__).parents[2] / "docs" / "hardware.md").read_text()
    refused = docs[docs.index("It refuses") : docs.index("Everything else may change")]
    for table in set(BINDING) - {"frames"}:
        assert all(f"`{key}`" in refused for key in BINDING[table])
