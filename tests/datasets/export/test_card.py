"""Cards: front matter that parses, a licence that is said and never invented."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_data_sets import smalls, write_taps

from tactibench.datasets import export_dataset
from tactibench.datasets.export.card import hub_licence, licence_name


def front_matter(text: str) -> dict[str, Any]:
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    _, matter, _ = text.split("---\n", maxsplit=2)
    return dict(yaml.safe_load(matter))


def test_the_card_of_the_data_set_itself(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    text = export_dataset(dataset, dataset.folder, "card").path.read_text("utf-8")
    for sentence_ in (
        "# taps\n",
        "Licence: CC-BY-4.0.",
        "sensor 'tactip-127', 16 x 16 pixels, 8-bit gray, with a frame of the sensor at rest. "
        "Its dome has a radius of 20 mm.",
        "5 samples of 3 presses. Pressed by: single (3), dual (2); depth 2 mm, tilt 0 deg.",
        "| force_z | 0 to 1 |",
        "Units: length in mm, angle in deg",
        "Frame of reference 'sensor': right-handed, origin at the undeformed apex",
        "- `mine`: train 0 ids, validation 0 ids, test 2 ids",
        'load_dataset("imagefolder"',
    ):
        assert sentence_ in text
    assert text.startswith('---\npretty_name: "taps"\nlicense: "cc-by-4.0"\n')


def test_the_front_matter_names_the_files_of_every_part(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    export = export_dataset(dataset, tmp_path / "out", "hf-parquet")
    matter = front_matter((export.path / "README.md").read_text("utf-8"))
    (config,) = matter["configs"]
    assert config["data_files"] == [
        {"split": "test", "path": ["data/test-*.parquet"]},
        {"split": "unassigned", "path": ["data/unassigned-*.parquet"]},
    ]
    for part in config["data_files"]:
        for pattern in part["path"]:
            assert list(export.path.glob(pattern))
    assert matter["size_categories"] == ["n<1K"]


@settings(max_examples=12)
@given(st.data())
def test_any_name_and_label_makes_a_card_that_parses(data: st.DataObject) -> None:
    small = data.draw(smalls())
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        text = export_dataset(dataset, Path(place) / "card.md", "card").path.read_text("utf-8")
    matter = front_matter(text)
    assert matter["pretty_name"] == (" ".join(small.header.name.split()) or "data set")
    licence = " ".join(small.header.licence.split())
    if licence in {"", "unknown"}:
        assert matter["license"] == "unknown"
        assert "The licence of this data set is unknown" in text


@pytest.mark.parametrize(
    ("written", "hub"),
    [
        ("cc-by-4.0", {"license": "cc-by-4.0"}),
        ("Apache-2.0", {"license": "apache-2.0"}),
        ("GPL-3.0-or-later", {"license": "gpl-3.0"}),
        ("ODbL-1.0", {"license": "odbl"}),
        ("ask\n me", {"license": "other", "license_name": "ask me"}),
        *((unknown, {"license": "unknown"}) for unknown in ("", " ", "Unknown", "none", None)),
    ],
)
def test_licences_as_the_hub_calls_them(written: str | None, hub: dict[str, str]) -> None:
    assert hub_licence(licence_name(written)) == hub


@pytest.mark.parametrize(
    ("radius", "words"), [(None, "Nobody noted"), (math.inf, "It is flat."), (12.5, "12.5 mm")]
)
def test_the_dome_is_said(tmp_path: Path, radius: float | None, words: str) -> None:
    dataset = write_taps(tmp_path / "v1", dome_radius_mm=radius)
    assert words in export_dataset(dataset, tmp_path / "c.md", "card").path.read_text("utf-8")
