"""Croissant 1.0 JSON-LD of a data set's own folder (https://docs.mlcommons.org/croissant).

``metadata.jsonl`` is named with its sha256, and every line of it has the sha256 of its image, so
that the description pins every byte. Records are joined from images to lines by the image's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from tactibench.datasets import Dataset, Sample
from tactibench.datasets.exporting.croissant_context import CONTEXT
from tactibench.datasets.exporting.licence import address, named
from tactibench.datasets.exporting.words import description, title
from tactibench.datasets.schema import IMAGES, JOURNAL

CONFORMS = "http://mlcommons.org/croissant/1.0"
_JOURNAL, _IMAGES, _RECORDS = "journal", "images", "samples"
_TEXT, _INTEGER, _FLOAT = "sc:Text", "sc:Integer", "sc:Float"
_POSE = {
    "x_mm": "x of the indenter's axis",
    "y_mm": "y of it",
    "yaw_deg": "its turn about z",
    "tilt_deg": "its tilt",
    "depth_mm": "travel past first touch",
}


def croissant(dataset: Dataset) -> dict[str, Any]:
    """The JSON-LD document. A licence that nobody named is said to be unknown, not invented."""
    licence = named(dataset.header.licence)
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": title(dataset),
        "description": description(dataset),
        "conformsTo": CONFORMS,
        **({} if licence is None else {"license": address(licence)}),
        "keywords": ["tactile sensing", "robotics", str(dataset.header.sensor.get("name", ""))],
        "identifier": f"urn:uuid:{dataset.header.uuid}",
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": _JOURNAL,
                "name": JOURNAL,
                "contentUrl": JOURNAL,
                "description": "One line a sample, in the order they were written.",
                "encodingFormat": "application/jsonlines",
                "sha256": dataset.sha256,
            },
            {
                "@type": "cr:FileSet",
                "@id": _IMAGES,
                "name": IMAGES,
                "description": "8-bit PNG files; their sha256 stand in the lines.",
                "encodingFormat": "image/png",
                "includes": f"{IMAGES}/[0-9]*/*.png",
            },
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": _RECORDS,
                "name": _RECORDS,
                "key": {"@id": f"{_RECORDS}/id"},
                "field": _fields(dataset),
            }
        ],
    }


def _fields(dataset: Dataset) -> list[dict[str, Any]]:
    """Fields of the keys that at least one line has."""
    samples = dataset.samples
    fields = [
        _from_images("image", "sc:ImageObject", {"extract": {"fileProperty": "content"}}),
        {
            **_from_images(
                "file_name",
                _TEXT,
                {"extract": {"fileProperty": "fullpath"}, "transform": {"regex": "^(.*)$"}},
            ),
            "references": {"fileObject": {"@id": _JOURNAL}, "extract": {"column": "file_name"}},
        },
        _column("id", _INTEGER, "Unique in the data set."),
        _column("sha256", _TEXT, "Of the image's file."),
        _column("status", _TEXT, "ok or bad."),
        _column("press", _TEXT, "Samples of one press share it: split by it."),
        _column("session", _TEXT, "When the sensor was mounted once."),
        _column("attempt", _INTEGER, "1 for the first."),
    ]
    if any(s.t_frame_ns is not None for s in samples):
        fields.append(_column("t_frame_ns", _INTEGER, "When the frame was taken, ns."))
    scenes = [s.scene for s in samples if s.scene is not None]
    if scenes:
        fields.append(_column("indenter", _TEXT, "What was pressed."))
        fields += [_column(key, _FLOAT, f"Pose reached: {text}.") for key, text in _POSE.items()]
    if any(not scene.indenter.is_plate for scene in scenes):
        fields.append(_column("indenter_radius_mm", _FLOAT, "Of every tip; a plate has none."))
    if any(dataset.contacts(s) is not None for s in samples):
        fields.append(_contacts())
    return fields + _labels(samples)


def _contacts() -> dict[str, Any]:
    """The contacts of a sample: a list of x, y and depth, mm."""
    whole = f"{_RECORDS}/contacts"
    parts = [
        ("contacts_xy_mm", "x_mm", "$[0]"),
        ("contacts_xy_mm", "y_mm", "$[1]"),
        ("contacts_depth_mm", "depth_mm", ""),
    ]
    return {
        "@type": "cr:Field",
        "@id": whole,
        "name": "contacts",
        "repeated": True,
        "description": "Contacts that follow from pose and dome.",
        "subField": [
            {
                "@type": "cr:Field",
                "@id": f"{whole}/{name}",
                "name": name,
                "dataType": _FLOAT,
                "source": _source(column, path),
            }
            for column, name, path in parts
        ],
    }


def _labels(samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """One field a label; its name may be anything, so the id quotes it."""
    names = dict.fromkeys(name for sample in samples for name in sample.labels)
    return [
        {
            "@type": "cr:Field",
            "@id": f"{_RECORDS}/labels/{quote(name, safe='')}",
            "name": f"labels/{name}",
            "description": "As it was recorded, mm or deg.",
            "dataType": _FLOAT,
            "source": _source("labels", f'$["{_escaped(name)}"]'),
        }
        for name in names
    ]


def _column(key: str, kind: str, text: str) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": f"{_RECORDS}/{key}",
        "name": key,
        "description": text,
        "dataType": kind,
        "source": _source(key),
    }


def _from_images(key: str, kind: str, how: dict[str, Any]) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": f"{_RECORDS}/{key}",
        "name": key,
        "dataType": kind,
        "source": {"fileSet": {"@id": _IMAGES}, **how},
    }


def _source(column: str, path: str = "") -> dict[str, Any]:
    """A column of the journal, or a place inside its values."""
    source: dict[str, Any] = {"fileObject": {"@id": _JOURNAL}, "extract": {"column": column}}
    return {**source, "transform": {"jsonPath": path}} if path else source


def _escaped(name: str) -> str:
    """Inside the quotes of a JSON path."""
    return name.replace("\\", "\\\\").replace('"', '\\"')
