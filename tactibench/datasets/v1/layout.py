"""Where things are in a data set's folder."""

from __future__ import annotations

import re
from pathlib import Path

HEADER = "dataset.json"
PLAN = "plan.jsonl"
JOURNAL = "metadata.jsonl"
EVENTS = "events.jsonl"
IMAGES = "images"
REFERENCE = f"{IMAGES}/reference"
SPLITS = "splits"
CACHE = ".cache"
TRASH = ".trash"
LOCK = ".lock"

PER_FOLDER = 1000
"""Images in one folder: file managers and network shares slow down with more."""
UNFINISHED = ".part"
"""End of a temporary file's name; it starts with a dot, so that no reader of images takes it."""

_REFERENCE = re.compile(rf"{REFERENCE}/(rest|\d{{6,}})\.png")
_IMAGE = re.compile(rf"{IMAGES}/\d{{6,}}/(\d{{6,}})\.png")


def image_name(number: int) -> str:
    """``images/000000/000123.png``: the place of a sample's image follows from its id."""
    return f"{IMAGES}/{number // PER_FOLDER:06d}/{number:06d}.png"


def image_id(name: str) -> int | None:
    """The id whose image has this name; None for a file of any other name."""
    match = _IMAGE.fullmatch(name)
    if match is None or image_name(int(match[1])) != name:
        return None
    return int(match[1])


def is_reference(name: str) -> bool:
    """Whether this is the name of a frame of the undeformed sensor."""
    return _REFERENCE.fullmatch(name) is not None


def is_dataset(folder: Path) -> bool:
    """Whether the folder holds a data set of this format (or of a later version of it)."""
    return (folder / HEADER).is_file()
