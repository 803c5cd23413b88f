"""An export is whole or absent; its card parses, and says the licence without inventing one."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from small_data_sets import Small, smalls, write_taps

from tactibench import UserError
from tactibench.datasets import (
    Dataset,
    export_dataset,
    hub_licence,
    is_dataset,
    licence_name,
    new_folder,
    open_dataset,
    verify,
    write_split,
)

FOLDERS = ("bristol", "hf-parquet")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write_taps(tmp_path_factory.mktemp("place") / "v1")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("format_", FOLDERS)
def test_an_empty_folder_is_taken_with_the_usual_rights(
    dataset: Dataset, tmp_path: Path, format_: str
) -> None:
    if format_ == "hf-parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    (tmp_path / "out").mkdir()
    rights = (tmp_path / "out").stat().st_mode
    export = export_dataset(dataset, tmp_path / "out", format_)
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out").stat().st_mode == rights
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert (export.files, export.size_bytes) == (len(files), sum(p.stat().st_size for p in files))
    assert (export.samples, export.bad) == (5, 0)


@pytest.mark.parametrize("format_", FOLDERS)
def test_a_folder_that_holds_something_is_refused(
    dataset: Dataset, tmp_path: Path, format_: str
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(UserError, match=r"holds files already; .* nothing is overwritten"):
        export_dataset(dataset, tmp_path, format_)
    assert names(tmp_path) == ["mine.txt"]


@pytest.mark.parametrize("kind", ["file", "link", "orphan", "inside"])
def test_a_place_where_no_folder_can_be_is_refused(
    dataset: Dataset, tmp_path: Path, kind: str
) -> None:
    target = tmp_path / "out"
    if kind == "file":
        target.write_text("mine")
    elif kind == "link":
        target.symlink_to(tmp_path / "elsewhere")
    elif kind == "orphan":
        target = target / "deeper"
    else:
        target = dataset.folder / "out"
    sentence = {"orphan": r"out is not there; make it first", "inside": r"lies in the data set"}
    with pytest.raises(UserError, match=sentence.get(kind, "is a file or a link")):
        export_dataset(dataset, target, "bristol")
    assert names(tmp_path) == ([] if kind in {"orphan", "inside"} else ["out"])


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, UserError])
def test_an_interrupted_export_leaves_nothing(
    dataset: Dataset, tmp_path: Path, error: type[BaseException]
) -> None:
    done = 0

    def advance(number: int) -> None:
        nonlocal done
        done += number
        assert names(tmp_path)[0].startswith(".out."), "written beside its place"
        if done == 3:
            raise error("stop")

    with pytest.raises(error):
        export_dataset(dataset, tmp_path / "out", "bristol", advance=advance)
    assert names(tmp_path) == []


def test_a_place_that_was_taken_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    target = tmp_path / "out"

    def meanwhile() -> None:
        with new_folder(target, tmp_path / "source") as folder:
            (folder / "ours").write_text("ours")
            target.mkdir()
            (target / "theirs").write_text("theirs")

    with pytest.raises(OSError, match="not empty"):
        meanwhile()
    assert names(tmp_path) == ["out", "source"]
    assert names(target) == ["theirs"]


def test_a_card_is_written_once_and_the_data_set_stays_sound(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    assert export_dataset(dataset, dataset.folder, "card").path == dataset.folder / "README.md"
    with pytest.raises(UserError, match=r"README\.md is there already"):
        export_dataset(dataset, dataset.folder, "card")
    assert verify(dataset.folder) == []


def test_formats_and_splits_are_known_by_name(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1")
    with pytest.raises(UserError, match=r"unknown format 'parquet'; did you mean 'hf-parquet'\?"):
        export_dataset(dataset, tmp_path / "out", "parquet")
    with pytest.raises(UserError, match=r"has no split 'mien'; did you mean 'mine'\?"):
        export_dataset(dataset, tmp_path / "out", "bristol", split="mien")
    export = export_dataset(dataset, tmp_path / "out", "bristol", split="mine")
    assert export.subsets == {"test": 2, "unassigned": 3}


def test_of_several_splits_one_must_be_named(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    folder = write_taps(tmp_path / "v1").folder
    (folder / "checksums.json").unlink()  # splits are changed by hand
    (folder / "splits/other.json").write_text('{"train": [0], "validation": [], "test": []}')
    (folder / "splits/mine.json").write_text('{"train": [0, 1], "validation": [4], "test": [2]}')
    dataset = open_dataset(folder)
    with pytest.raises(UserError, match=r"several splits \(mine, other\); choose one"):
        export_dataset(dataset, tmp_path / "out", "hf-parquet")
    export = export_dataset(dataset, tmp_path / "out", "hf-parquet", split="mine")
    assert export.subsets == {"train": 2, "validation": 1, "test": 1, "unassigned": 1}
    assert names(export.path) == ["README.md", "data", "header.json", "rest.png"]
    assert not is_dataset(export.path)
    assert export_dataset(dataset, tmp_path / "bristol", "bristol").subsets == {}


def test_nothing_good_to_export_is_said(tmp_path: Path) -> None:
    dataset = write_taps(tmp_path / "v1", count=0)
    with pytest.raises(UserError, match="holds no good sample"):
        export_dataset(dataset, tmp_path / "out", "bristol")


@pytest.mark.parametrize("name", ["test", "my-test", "val_2", "2dev.x", "by-press.train"])
def test_a_split_is_not_called_as_image_folders_call_a_part(dataset: Dataset, name: str) -> None:
    """Hugging Face would take its file for all the data there is (shown in a slow test)."""
    with pytest.raises(UserError, match="call the split after how it divides"):
        write_split(dataset.folder, name, dataset.splits["mine"], dataset.samples)
    assert list(dataset.splits) == ["mine"]


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
@given(smalls())
def test_any_name_and_label_makes_a_card_that_parses(small: Small) -> None:
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
