"""Files, header and samples of a data set, format v1.

dataset.json       the header: facts that hold for every sample; status open or closed
plan.jsonl         the presses to be recorded, where they are known beforehand
metadata.jsonl     the journal: one line for every finished sample (a Hugging Face image folder)
images/000000/     PNG files, 1000 in a folder; images/reference/: the undeformed sensor
channels.f32       in place of images, where the sensor is no camera: a row of little-endian float32
                   for every line of the journal, ``numpy.fromfile(file, "<f4")``
events.jsonl       reference frames, stops, warnings
splits/NAME.json   ids of training, validation and test samples

A sample exists when its line stands in the journal. What an interrupted writer left behind the last
line is ignored by readers, and removed when writing goes on.
"""

from __future__ import annotations

import json
import math
import re
import uuid
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import prod
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    ConfigDict,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
)

from tactibench.contacts import Contacts, Scene, Signal
from tactibench.errors import UserError
from tactibench.geometry import true_contacts
from tactibench.png import ImageKind
from tactibench.protocols import first_mistake
from tactibench.records import read_json, write_json

HEADER = "dataset.json"
PLAN = "plan.jsonl"
JOURNAL = "metadata.jsonl"
EVENTS = "events.jsonl"
IMAGES = "images"
REFERENCE = f"{IMAGES}/reference"
SPLITS = "splits"
CHANNEL_FILE = "channels.f32"
LOCK = ".lock"

PER_FOLDER = 1000
"""Images in one folder: file managers and network shares slow down with more."""

SCHEMA_VERSION = 1
UNITS = {"length": "mm", "angle": "deg", "force": "N"}
AXES = "sxyz"
"""Angles are extrinsic rotations about x, y, z."""
FRAMES = {
    "sensor": "right-handed, origin at the undeformed apex, x right and y down in the image, "
    "z out of the dome",
}

Status = Literal["ok", "bad"]
Forces = tuple[tuple[float, float, float], ...]

_FLAT = "flat"
_REFERENCE_NAME = re.compile(rf"{REFERENCE}/(rest|\d{{6,}})\.png")
# These keys belong to one copy of a data set; they need not be equal when writing continues.
_OWN_KEYS = ("uuid", "status", "counts", "journal_sha256")


@dataclass(frozen=True)
class ChannelKind:
    """Shape of every sample's channels: (C,), or (rows, columns) of an array of taxels."""

    shape: tuple[int, ...]

    def __str__(self) -> str:
        return f"{'x'.join(map(str, self.shape))} channels"

    @property
    def row_bytes(self) -> int:
        """Bytes of a sample."""
        return 4 * prod(self.shape)


@dataclass(frozen=True)
class Header:
    """The facts that hold for every sample of a data set.

    Attributes:
        name: Name of the data set.
        sensor: Name, parameters and versions of the sensor.
        image: Height and width of every image, pixels; None where the samples hold channels.
        channels: 1 for gray, 3 for RGB.
        dome_radius_mm: Radius of the pressed surface, inf where it is flat, None if unknown.
        signal: Shape of every sample's float32 channels; () where the samples are images.
        signal_names: Names of the channels, in their order, as far as they are known.
        sites: Names of places; the label of that name says whether a sample touches it (1 or 0).
        units: Units of lengths, angles and forces.
        axes: Order of Euler angles.
        frames: Coordinate frames in words.
        licence: Licence of the data; empty: unknown.
        source: The importer, its options and the sha256 of the files that it read.
        plan_sha256: Hash of ``plan.jsonl``; empty without a plan.
        status: A closed data set is never changed.
        uuid: Identifier of this data set.
        counts: Numbers of samples and presses, written when the data set is closed.
        journal_sha256: Hash of the journal, written when the data set is closed.
        schema_version: Version of this format.
    """

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True)

    name: str
    sensor: Mapping[str, Any]
    image: tuple[PositiveInt, PositiveInt] | None = None
    channels: Literal[1, 3] = 1
    dome_radius_mm: PositiveFloat | None = None
    signal: tuple[PositiveInt, ...] = ()
    signal_names: tuple[str, ...] = ()
    sites: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=lambda: dict(UNITS))
    axes: str = AXES
    frames: Mapping[str, str] = field(default_factory=lambda: dict(FRAMES))
    licence: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)
    plan_sha256: str = ""
    status: Literal["open", "closed"] = "open"
    uuid: str = field(default_factory=lambda: str(uuid.uuid4()))
    counts: Mapping[str, NonNegativeInt] = field(default_factory=dict)
    journal_sha256: str = ""
    schema_version: Literal[1] = 1

    @property
    def kind(self) -> ImageKind | ChannelKind:
        """Size and colours of every image, or the shape of every sample's channels."""
        if self.image is None:
            return ChannelKind(self.signal)
        return ImageKind(*self.image, self.channels == 3)


@dataclass(frozen=True)
class Sample:
    """A finished sample: an image or channels on the disk, and what is known about it.

    Attributes:
        id: Number of the sample, unique in the data set, 0 or more.
        file_name: The image's file, relative to the data set's folder, or that of all channels.
        sha256: Hash of the image's file, or of the sample's row of channels.
        status: "bad": the sample is kept, but not to be used.
        scene: Indenter and the pose that it reached; None where only labels are known.
        labels: Labels as they were recorded, by their original names, mm and deg.
        press: Name that the samples of one press share. It is the unit of intervals and splits.
        session: Name of the recording session.
        attempt: 1 for the first attempt at this sample.
        t_frame_ns: Time of the frame on a clock that never steps back.
        extra: Anything else that was recorded, as JSON values.
        contacts_force_n: Force on the skin of every contact along x, y and z, N; None: not known.
    """

    id: int
    file_name: str
    sha256: str
    status: Status = "ok"
    scene: Scene | None = None
    labels: Mapping[str, float] = field(default_factory=dict)
    press: str = ""
    session: str = ""
    attempt: int = 1
    t_frame_ns: int | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    contacts_force_n: Forces | None = None


@dataclass(frozen=True, eq=False)
class Draft:
    """A sample that is to be written; see ``Sample`` for the other fields.

    Attributes:
        signal: (H, W) gray or (H, W, 3) RGB uint8, or the bytes of such a PNG file, which are
            written as they are; for a sensor without a camera, float32 channels.
        press: Name of the press; an empty one becomes the id as text.
    """

    signal: Signal | bytes
    id: int
    scene: Scene | None = None
    labels: Mapping[str, float] = field(default_factory=dict)
    press: str = ""
    session: str = ""
    t_frame_ns: int | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    status: Status = "ok"
    attempt: int = 1
    contacts_force_n: Forces | None = None

    def sample(self, file_name: str, sha256: str) -> Sample:
        """Return the finished sample.

        Args:
            file_name: File of the image or the channels, relative to the data set's folder.
            sha256: Hash of the image's file, or of the row of channels.
        """
        facts = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "signal"}
        facts["id"] = int(self.id)
        facts["labels"] = {str(name): float(value) for name, value in self.labels.items()}
        facts["press"] = self.press or str(self.id)
        return Sample(file_name=file_name, sha256=sha256, **facts)


def image_name(number: int) -> str:
    """Return the name of a sample's image by its id: ``images/000000/000123.png``."""
    return f"{IMAGES}/{number // PER_FOLDER:06d}/{number:06d}.png"


def is_reference_name(name: str) -> bool:
    """Return whether this is the name of a frame of the undeformed sensor."""
    return _REFERENCE_NAME.fullmatch(name) is not None


def is_dataset(folder: Path) -> bool:
    """Return whether a folder holds a data set of this format or of a later version of it."""
    return (folder / HEADER).is_file()


def contacts_of(
    scene: Scene | None, dome_radius_mm: float | None, forces: Forces | None = None
) -> Contacts | None:
    """Return the contacts of a scene; None where the scene, the dome or a point is unknown.

    Raises:
        ValueError: There is not one force for every contact.
    """
    if scene is None or dome_radius_mm is None:
        return None
    try:
        return true_contacts(scene, dome_radius_mm, forces)
    except UserError:  # a plate on a flat pad touches everywhere
        return None


_HEADER_FILE = TypeAdapter(Header)


def read_header(folder: Path) -> Header:
    """Read the header of a data set.

    Raises:
        UserError: The folder holds no data set, or a key of the header is wrong.
    """
    path = folder / HEADER
    if not is_dataset(folder):
        raise UserError(f"{folder} is no data set: it holds no {HEADER}.")
    value = read_json(path)
    if not isinstance(value, dict):
        raise UserError(f"{path} holds no JSON object; restore it.")
    version = value.get("schema_version")
    if version != SCHEMA_VERSION:
        raise UserError(
            f"{path} has schema_version {version!r}, but this tactibench reads {SCHEMA_VERSION}; "
            "commit e6a49ac9 reads data sets of an older form, a newer tactibench those of a newer."
        )
    return _parse_header(value, str(path))


def _parse_header(value: dict[str, Any], where: str) -> Header:
    if value.get("dome_radius_mm") == _FLAT:
        value = {**value, "dome_radius_mm": math.inf}
    try:
        # Strict validation takes a JSON list for a tuple, but not a Python one.
        header = _HEADER_FILE.validate_json(json.dumps(value))
    except ValidationError as error:
        raise UserError(f"{where}: {first_mistake(error, Header)}") from None
    if (header.image is None) != bool(header.signal):
        raise UserError(f"{where}: exactly one of 'image' and 'signal' says what samples hold.")
    return header


def write_header(folder: Path, header: Header) -> None:
    """Write dataset.json.

    Raises:
        UserError: The header could not be read back: a value is wrong or no JSON.
    """
    value = asdict(header)
    if header.dome_radius_mm == math.inf:
        value["dome_radius_mm"] = _FLAT  # infinity has no meaning in JSON
    try:
        _parse_header(value, "the header of the data set")
        left_out = ["image"] if header.signal else ["signal", "signal_names"]
        for key in left_out if header.sites else [*left_out, "sites"]:
            del value[key]
        write_json(folder / HEADER, value)
    except (TypeError, ValueError) as error:
        raise UserError(f"the header of the data set cannot be written: {error}.") from None


def resume_header(folder: Path, expected: Header) -> Header:
    """Return the header on the disk, so that writing can continue.

    Raises:
        UserError: The data set is closed, or a setting on the disk is not the expected one.
    """
    header = read_header(folder)
    if header.status == "closed":
        raise UserError(
            f"{folder} is closed: it holds {header.counts.get('samples', 0):,} samples and takes "
            "no more; name another folder."
        )
    own = dict.fromkeys(_OWN_KEYS)
    # As they come back from the disk: tuples as lists, keys as text.
    before, now = (json.loads(json.dumps(asdict(each) | own)) for each in (header, expected))
    if difference := _difference("", before, now):
        raise UserError(
            f"{folder} was begun with {difference}; go on with the same settings, or name another "
            "folder."
        )
    return header


def _difference(key: str, before: Any, now: Any) -> str:
    """Return in words the first key, however deep, whose value differs; "" if there is none."""
    if before == now:
        return ""
    if isinstance(before, dict) and isinstance(now, dict):
        name = f"{key}." if key else ""
        texts = (_difference(f"{name}{k}", before.get(k), now.get(k)) for k in {**before, **now})
        return next(filter(None, texts))
    return f"{key} {_shorten(before)}, now it is {_shorten(now)}"


def _shorten(value: Any, most: int = 60) -> str:
    text = json.dumps(value)
    return text if len(text) <= most else f"{text[:most]}..."
