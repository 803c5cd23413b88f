"""``tactibench data``, called as a person does."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tactibench.datasets import Draft, Header, Writer, open_dataset, verify
from tactibench.protocols import protocol_files

SMALL = ("--param", "sensor.size=32")
COUNT = 60


def rows_of(path: Path) -> dict[tuple[str, str], Any]:
    return {(row["metric"], row["group"]): row for row in json.loads(path.read_text())}


@pytest.fixture
def data_set(tmp_path: Path) -> Path:
    """Thirty samples, the last one bad, with a split."""
    with Writer(tmp_path / "set", Header("x", {}, (6, 5)), fsync=False) as writer:
        for n in range(30):
            status = "bad" if n == 29 else "ok"
            writer.add(Draft(np.full((6, 5), n, np.uint8), n, status=status))
        writer.split("mine", train=[0, 1], validation=[], test=[2, 3])
    return tmp_path / "set"


def test_verify_counts_and_prints_findings(cli: Any, data_set: Path, tmp_path: Path) -> None:
    assert cli("data", "verify", "set") == (0, "set: 30 samples, all as it was written\n", "")
    for path in sorted((data_set / "images/000000").iterdir())[:25]:
        path.write_bytes(path.read_bytes()[:-1])
    code, out, err = cli("data", "verify", "set", "--json", "found.json")
    assert (code, err) == (1, "")
    lines = out.splitlines()
    assert lines[0].startswith("set/images/000000/000000.png was changed after it was written")
    assert lines[-2:] == [
        "... and 5 more; --json FILE has all of them",
        "set: 30 samples, 25 findings",
    ]
    assert len(json.loads((tmp_path / "found.json").read_text())["findings"]) == 25
    assert "nowhere is no data set" in cli("data", "verify", "nowhere")[2]


def test_export_says_what_was_written_and_what_was_left_out(
    cli: Any, data_set: Path, tmp_path: Path
) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    code, out, err = cli("data", "export", "set", "out", "--json", "figures.json")
    assert (code, err) == (0, "")
    assert "; 1 marked bad left out; 0.0 MB" in out
    found = rows_of(tmp_path / "figures.json")
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert found["size", "all"]["value"] == sum(path.stat().st_size for path in files)
    assert found["samples", "train"]["value"] == 2
    assert "nothing is overwritten" in cli("data", "export", "set", "out")[2]


def test_a_protocol_becomes_a_data_set_and_the_same_command_goes_on(
    cli: Any, tmp_path: Path
) -> None:
    text = protocol_files()["exp3"].read_text(encoding="utf-8").replace('"exp3"', '"short"')
    for key in ("count", "per_distance", "test", "validation"):
        text = re.sub(rf"^{key} = \d+", f"{key} = 6", text, flags=re.MULTILINE)
    (tmp_path / "short.toml").write_text(text.replace("count = 6", "count = 20", 1))
    command = ("data", "generate", "short.toml", *SMALL, "--count", "3", "--out", "set")
    assert cli(*command) == (0, "set: 27 samples of tactip-127 written\n", "")
    dataset = open_dataset(tmp_path / "set")
    assert dataset.header.source["protocol"] == "short@3"
    assert set(dataset.splits) == {"short-single", "short-multiple"}
    kinds = {s.scene.indenter.name for s in dataset.samples if s.scene is not None}
    assert kinds == {"single", "dual", "triple", "tips"}
    assert cli(*command)[1] == "set: complete, 27 samples\n"
    header, journal = tmp_path / "set/dataset.json", tmp_path / "set/metadata.jsonl"
    before = journal.read_bytes()
    header.write_text(header.read_text().replace('"closed"', '"open"'))
    journal.write_bytes(before[:-400])
    assert "of 27 samples are there, going on" in cli(*command)[1]
    assert journal.read_bytes() == before
    assert verify(tmp_path / "set") == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "Missing argument 'PROTOCOL|PLAN.jsonl'"),
        (("nothing.jsonl",), "nothing.jsonl is no file"),
        (("exp1", "--sensor", "recorded"), "tactibench data import"),
        (("exp1", "--param", "model.width=3"), "KIND one of sensor; try --param sensor.size"),
    ],
)
def test_mistakes(refused: Callable[..., str], arguments: tuple[str, ...], says: str) -> None:
    assert says in refused("data", "generate", *arguments, "--out", "set")


@pytest.fixture
def plates(tmp_path: Path) -> Path:
    """Frames in which a grid of pins spreads as a plate of known offset and pivot would."""
    folder = tmp_path / "plates"
    (folder / "frames_bw").mkdir(parents=True)
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.linspace(20, 108, 7), np.linspace(20, 108, 7)), -1)

    def draw(name: str, scale: float) -> None:
        image = np.zeros((129, 129), np.uint8)
        for x, y in (grid.reshape(-1, 2) - 64) * scale + 64:
            cv2.circle(image, (round(x * 16), round(y * 16)), 48, 255, -1, cv2.LINE_AA, 4)
        assert cv2.imwrite(str(folder / "frames_bw" / name), image)

    draw("init_0.png", 1.0)
    lines = ["image_name,pose_2,pose_6"]
    for i in range(COUNT):
        depth, tilt = rng.uniform(1, 5), rng.uniform(-20, 20)
        draw(f"frame_{i}.png", 1 + 0.02 * depth**1.37)
        label = depth - 4 - 10 * (1 - np.cos(np.radians(tilt)))
        lines.append(f"frame_{i}.png,{float(label)!r},{float(tilt)!r}")
    (folder / "targets.csv").write_text("\n".join(lines))
    return folder


def test_fit_prints_the_command_that_imports_with_it(
    cli: Any, plates: Path, tmp_path: Path
) -> None:
    code, shown, _ = cli("data", "fit", plates, "--json", "fit.json")
    assert code == 0
    rows = rows_of(tmp_path / "fit.json")
    assert rows["offset a", "all"]["value"] == pytest.approx(4, abs=0.1)
    assert rows["pivot p", "all"]["value"] == pytest.approx(10, abs=2.5)
    line = shown.strip().splitlines()[-1].replace("TARGET", str(tmp_path / "out"))
    assert line.startswith("tactibench data import ")
    assert cli(*line.split()[1:])[0] == 0
    scenes = [sample.scene for sample in open_dataset(tmp_path / "out").samples]
    assert all(scene and 1 < scene.pose.depth < 5.2 for scene in scenes)


def test_report_says_how_good_the_sensor_is(cli: Any, plates: Path, tmp_path: Path) -> None:
    code, shown, _ = cli("data", "report", plates, "--out", "sensor.html", "--json", "sensor.json")
    assert code == 0
    rows = rows_of(tmp_path / "sensor.json")
    assert rows["pins found at rest", "all"]["value"] == 49
    assert rows["pins found at rest", "all"]["unit"] == "pins"
    assert [name for (name, _), row in rows.items() if not row["unit"]] == ["limit"]
    limit = rows["limit", "all"]["value"]
    assert limit in shown
    page = (tmp_path / "sensor.html").read_text()
    assert limit in page
    assert "<script" not in page


@pytest.mark.parametrize("table", ["", "x,y,depth,s0,s1\n0,0,1,3,4\n"])
def test_a_report_on_a_raw_folder_says_to_import_it(
    refused: Callable[..., str], tmp_path: Path, table: str
) -> None:
    (tmp_path / "raw").mkdir()
    if table:
        (tmp_path / "raw" / "log.csv").write_text(table)
    assert "`tactibench data import" in refused("data", "report", "raw")


def test_a_report_on_channels_has_a_unit_a_line(cli: Any, channels: Path, tmp_path: Path) -> None:
    assert cli("data", "report", channels, "--json", "skin.json")[0] == 0
    rows = rows_of(tmp_path / "skin.json")
    assert rows["noise at rest", "all"]["unit"] == "as recorded"
    assert [name for (name, _), row in rows.items() if not row["unit"]] == ["limit"]


def test_import_and_info_say_what_a_folder_holds(cli: Any, plates: Path, tmp_path: Path) -> None:
    shown = cli("data", "import", plates, "out")[1]
    assert "60 frames of 129x129 gray, labels without contacts" in shown
    shown = cli("data", "info", plates, "--json", "info.json", "--sheet", "sheet.png")[1]
    for text in ("60 of 129x129 gray, 60 presses", "none, labels only", "49 (49 to 49)"):
        assert text in shown
    found = rows_of(tmp_path / "info.json")
    assert -20 <= found["least", "pose_6"]["value"] < found["most", "pose_6"]["value"] <= 20
    assert found["most", "pose_6"]["unit"] == "deg"
    assert found["served", "exp1"]["value"] is False
    assert "only labels are known" in found["served", "exp1"]["reason"]
    assert cv2.imread(str(tmp_path / "sheet.png")) is not None
