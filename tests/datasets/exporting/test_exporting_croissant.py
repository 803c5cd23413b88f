"""Croissant: every field of the description finds its value in the files that it names."""

from __future__ import annotations

import fnmatch
import hashlib
import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactibench import UserError
from tactibench.datasets import Dataset, Header, Writer, open_dataset
from tactibench.datasets.exporting import export

Make = Callable[..., Dataset]


def value_of(source: dict[str, Any], row: dict[str, Any]) -> Any:
    """What a field's source means, for the paths that are used: $["name"] and $[0]."""
    value = row.get(source["extract"]["column"])
    path = source.get("transform", {}).get("jsonPath")
    if value is None or path is None:
        return value
    key = json.loads(path.removeprefix("$").replace("\n", "\\n"), strict=False)[0]
    return [one[key] for one in value] if isinstance(key, int) else value.get(key)


@settings(max_examples=12)
@given(st.data())
def test_every_field_finds_its_value(
    small_datasets: st.SearchStrategy[Any], data: st.DataObject
) -> None:
    small = data.draw(small_datasets)
    with tempfile.TemporaryDirectory() as place:
        dataset = small.write(Path(place) / "v1")
        made = export(dataset, dataset.folder, "croissant")
        document = json.loads(made.path.read_text("utf-8"))
        journal, images = document["distribution"]
        lines = (dataset.folder / journal["contentUrl"]).read_bytes()
        assert journal["sha256"] == hashlib.sha256(lines).hexdigest()
        rows = {row["id"]: row for row in map(json.loads, lines.splitlines())}
        (records,) = document["recordSet"]
        fields = {field["@id"]: field for field in records["field"]}
        assert len(fields) == len(records["field"])
        ids = value_of(fields["samples/id"]["source"], rows[dataset.samples[0].id])
        assert ids == dataset.samples[0].id
        for sample in dataset.samples:
            row = rows[sample.id]
            assert fnmatch.fnmatch(row["file_name"], images["includes"])
            labels = {
                field["name"].removeprefix("labels/"): value_of(field["source"], row)
                for name, field in fields.items()
                if name.startswith("samples/labels/")
            }
            assert {k: v for k, v in labels.items() if v is not None} == sample.labels
            contacts = dataset.contacts(sample)
            if contacts is not None:
                x, y, depth = (
                    value_of(field["source"], row)
                    for field in fields["samples/contacts"]["subField"]
                )
                assert (x, y) == (contacts.xy[:, 0].tolist(), contacts.xy[:, 1].tolist())
                assert depth == contacts.depth.tolist()


def test_the_reference_frame_is_no_record(make: Make, tmp_path: Path) -> None:
    dataset = make(tmp_path / "v1")
    made = export(dataset, dataset.folder, "croissant")
    pattern = json.loads(made.path.read_text("utf-8"))["distribution"][1]["includes"]
    found = [p.relative_to(dataset.folder).as_posix() for p in dataset.folder.rglob("*.png")]
    assert sum(fnmatch.fnmatch(name, pattern) for name in found) == 5
    assert len(found) == 6


@pytest.mark.parametrize(
    ("licence", "link"), [("mit", "https://spdx.org/licenses/MIT.html"), ("", None)]
)
def test_an_unknown_licence_is_not_invented(
    make: Make, tmp_path: Path, licence: str, link: str | None
) -> None:
    dataset = make(tmp_path / "v1", licence=licence)
    document = json.loads(export(dataset, dataset.folder, "croissant").path.read_text("utf-8"))
    assert document.get("license") == link
    assert ("is unknown" in document["description"]) == (link is None)
    assert document["conformsTo"] == "http://mlcommons.org/croissant/1.0"


def test_it_is_written_where_its_files_are_and_when_they_are_final(
    make: Make, tmp_path: Path
) -> None:
    dataset = make(tmp_path / "v1")
    with pytest.raises(UserError, match=re.escape(f"give {dataset.folder} itself")):
        export(dataset, tmp_path / "croissant.json", "croissant")
    writer = Writer(tmp_path / "open", Header("open", {"name": "s"}, (4, 4)))
    writer.leave_open()
    with pytest.raises(UserError, match="is still open"):
        export(open_dataset(tmp_path / "open"), tmp_path / "open", "croissant")
