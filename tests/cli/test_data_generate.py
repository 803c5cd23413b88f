"""``tactibench data generate`` with the simulated sensor."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactibench.datasets import open_dataset, verify
from tactibench.protocols import protocol_files

SMALL = ("--param", "sensor.size=32")
LINE = (
    '{"id": %d, "indenter": "ball", "indenter_radius_mm": 3, "x_mm": %d, "y_mm": 0, "depth_mm": 2}'
)


@pytest.fixture
def protocol(tmp_path: Path) -> Path:
    """exp3 with few presses."""
    text = protocol_files()["exp3"].read_text(encoding="utf-8")
    text = text.replace('id = "exp3"', 'id = "short"')
    for key in ("count", "per_distance", "test", "validation"):
        text = re.sub(rf"^{key} = \d+", f"{key} = 6", text, flags=re.MULTILINE)
    path = tmp_path / "short.toml"
    path.write_text(text.replace("count = 6", "count = 20", 1), encoding="utf-8")
    return path


def test_a_protocol_becomes_a_data_set(cli: Any, tmp_path: Path, protocol: Path) -> None:
    command = ("data", "generate", protocol, *SMALL, "--count", "3", "--out", "set")
    code, out, err = cli(*command)
    assert (code, err) == (0, "")
    assert out == "set: 27 samples of tactip-127 written\n"
    dataset = open_dataset(tmp_path / "set")
    assert dataset.header.status == "closed"
    assert dataset.header.source["protocol"] == "short@2"
    assert dataset.signal(dataset.samples[26]).shape == (32, 32)
    assert set(dataset.splits) == {"short-single", "short-multiple"}
    kinds = {s.scene.indenter.name for s in dataset.samples if s.scene is not None}
    assert kinds == {"single", "dual", "triple", "tips"}
    assert verify(tmp_path / "set") == []
    code, out, _ = cli(*command)
    assert (code, out) == (0, "set: complete, 27 samples\n")


def test_the_same_command_goes_on(cli: Any, tmp_path: Path) -> None:
    plan = tmp_path / "presses.jsonl"
    plan.write_text("".join(LINE % (number, number) + "\n" for number in range(4)))
    command = ("data", "generate", "--plan", plan, *SMALL, "--out", "set")
    assert cli(*command)[0] == 0
    journal = tmp_path / "set/metadata.jsonl"
    before = journal.read_bytes()
    header = tmp_path / "set/dataset.json"
    header.write_text(header.read_text().replace('"closed"', '"open"'))
    journal.write_bytes(before[:-400])
    code, out, err = cli(*command)
    assert (code, err) == (0, "")
    assert "of 4 samples are there, going on" in out
    assert journal.read_bytes() == before
    assert verify(tmp_path / "set") == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "either a protocol, such as exp1, or --plan FILE"),
        (("surface", "--sensor", "tactip-127"), "takes the presses of a recorded folder"),
        (("exp1", "--sensor", "recorded"), "tactibench data import"),
        (("exp1", "--param", "model.width=3"), "only the sensor has parameters here"),
        (("exp1", "--param", "sensor.instances=4"), "a data set holds the rest frame of one"),
    ],
)
def test_mistakes(refused: Callable[..., str], arguments: tuple[str, ...], says: str) -> None:
    assert says in refused("data", "generate", *arguments, "--out", "set")
