"""A data set, format v1: its files, opening, and the comparison with what was written.

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

Every key of a line always has the same type, and unknown values are left out. Readers that take the
type of a column from its first values (Hugging Face image folders, Arrow) then agree on it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt
from pydantic import (
    ConfigDict,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
)

from tactibench.contacts import Contacts, Indenter, Pose, Scene, Signal
from tactibench.errors import UserError, read_file
from tactibench.geometry import true_contacts
from tactibench.png import ImageKind, decode_png
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

Event = Mapping[str, Any]
Image = npt.NDArray[np.uint8]

PER_FOLDER = 1000
"""Images in one folder: file managers and network shares slow down with more."""

SCHEMA_VERSION = 1
UNITS = {"length": "mm", "angle": "deg", "force": "N"}
AXES = "sxyz"
"""Angles are extrinsic rotations about x, y, z."""
FRAMES = {
    "sensor": "right-handed, origin at the undeformed apex, x right and y down in the image, "
    "z out of the dome"
}

Status = Literal["ok", "bad"]
Forces = tuple[tuple[float, float, float], ...]

_FLAT = "flat"
REFERENCE_NAME = re.compile(rf"{REFERENCE}/(rest|\d{{6,}})\.png")
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
        raise UserError(f"{folder} was begun with {difference}; keep it, or name another folder.")
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


POSE_KEYS = ("x_mm", "y_mm", "yaw_deg", "tilt_deg", "depth_mm")
MOVE_KEYS = ("dx_mm", "dy_mm", "dyaw_deg")


@dataclass(frozen=True, kw_only=True)
class SceneKeys:
    """The keys of a scene: indenter and pose.

    A plate has no indenter_radius_mm, a tip of which nobody knows how deep it pressed no depth_mm,
    and a pose that did not move sideways no dx_mm, dy_mm, dyaw_deg. A sample without a scene has
    none of the keys.
    """

    indenter: str | None = None
    indenter_radius_mm: float | None = None
    indenter_offsets_mm: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    x_mm: float | None = None
    y_mm: float | None = None
    yaw_deg: float | None = None
    tilt_deg: float | None = None
    depth_mm: float | None = None
    dx_mm: float | None = None
    dy_mm: float | None = None
    dyaw_deg: float | None = None

    def scene(self, where: str) -> Scene | None:
        """Return the scene, None where there is no indenter.

        Args:
            where: File and line, the beginning of an error's sentence.

        Raises:
            UserError: A key of the scene is missing, or its indenter cannot exist.
        """
        values = {key: getattr(self, key) for key in POSE_KEYS}
        unknown = () if self.indenter_radius_mm is None else ("depth_mm",)  # not of a plate
        moves = (self.dx_mm, self.dy_mm, self.dyaw_deg)
        if self.indenter is None:
            if any(value is not None for value in (*values.values(), *moves)):
                raise UserError(f"{where}: a pose needs the key 'indenter'; add it.")
            return None
        missing = [key for key, v in values.items() if v is None and key not in unknown]
        if missing:
            raise UserError(f"{where}: the key {missing[0]!r} is missing; add it.")
        radius = math.inf if self.indenter_radius_mm is None else self.indenter_radius_mm
        try:
            indenter = Indenter(radius, self.indenter_offsets_mm, self.indenter)
        except ValueError as error:
            raise UserError(f"{where}: {error}; fix it.") from None
        place = (math.nan if value is None else value for value in values.values())
        return Scene(indenter, Pose(*place, *(move or 0.0 for move in moves)))


def scene_keys(scene: Scene) -> dict[str, Any]:
    """Return the keys of ``SceneKeys`` as JSON values; every number is a float."""
    indenter, pose = scene.indenter, scene.pose
    return {
        "indenter": indenter.name,
        **({} if indenter.is_plate else {"indenter_radius_mm": float(indenter.radius)}),
        "indenter_offsets_mm": [[float(v) for v in offset] for offset in indenter.offsets],
        "x_mm": float(pose.x),
        "y_mm": float(pose.y),
        "yaw_deg": float(pose.yaw),
        "tilt_deg": float(pose.tilt),
        **({} if math.isnan(pose.depth) else {"depth_mm": float(pose.depth)}),
        **(
            dict(zip(MOVE_KEYS, map(float, (pose.dx, pose.dy, pose.dyaw)), strict=True))
            if pose.moved
            else {}
        ),
    }


@dataclass(frozen=True, kw_only=True)
class Row(SceneKeys):
    """A line of metadata.jsonl: the image's file, the scene with the pose reached, the contacts.

    The contacts follow from the scene and the dome's radius; they are left out without either.
    """

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    file_name: str
    id: NonNegativeInt
    status: Status
    sha256: str
    press: str
    session: str = ""
    attempt: PositiveInt = 1
    t_frame_ns: int | None = None
    n_contacts: NonNegativeInt | None = None
    contacts_xy_mm: tuple[tuple[float, float], ...] = ()
    contacts_depth_mm: tuple[float, ...] = ()
    contacts_force_n: Forces | None = None
    labels: dict[str, float] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)


_ROW_FILE = TypeAdapter(Row)


def write_row(sample: Sample, dome_radius_mm: float | None) -> bytes:
    """Return the line of a sample, its line break included.

    Raises:
        UserError: A value is no JSON or not finite.
    """
    keys = ("file_name", "id", "status", "sha256", "press", "session", "attempt", "t_frame_ns")
    row: dict[str, Any] = {key: getattr(sample, key) for key in keys}
    if sample.t_frame_ns is None:
        del row["t_frame_ns"]
    if sample.scene is not None:
        row |= scene_keys(sample.scene)
    try:
        contacts = contacts_of(sample.scene, dome_radius_mm, sample.contacts_force_n)
    except ValueError as error:
        raise UserError(f"sample {sample.id}: {error}; give one force for every contact.") from None
    if contacts is not None:
        row["n_contacts"] = len(contacts)
        row["contacts_xy_mm"] = contacts.xy.tolist()
        if contacts.knows_depth:
            row["contacts_depth_mm"] = contacts.depth.tolist()
        if contacts.force is not None:
            row["contacts_force_n"] = contacts.force.tolist()
    row |= {key: value for key in ("labels", "extra") if (value := dict(getattr(sample, key)))}
    return json_line(row, f"sample {sample.id}")


def read_row(line: bytes, where: str) -> Sample:
    """Return the sample of a line.

    Raises:
        UserError: The line is damaged.
    """
    try:
        row = _ROW_FILE.validate_json(line)
    except ValidationError as error:
        raise UserError(f"{where}: {first_mistake(error, Row)}") from None
    if row.file_name not in (image_name(row.id), CHANNEL_FILE):
        raise UserError(
            f"{where}: file_name is {row.file_name!r}, but the image of id {row.id} is "
            f"{image_name(row.id)}; restore the line."
        )
    facts = {f.name: getattr(row, f.name) for f in fields(Sample) if f.name != "scene"}
    return Sample(scene=row.scene(where), **facts)


def json_line(value: dict[str, Any], what: str) -> bytes:
    """Return a line of JSON, its line break included.

    Raises:
        UserError: A value is no JSON or not finite.
    """
    try:
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        return text.encode() + b"\n"
    except (TypeError, ValueError, RecursionError) as error:
        raise UserError(
            f"{what} cannot be written: {error}; allowed are text, numbers, lists and objects."
        ) from None


def parse_object(line: bytes) -> dict[str, Any] | None:
    """Return the JSON object of a line; None where the line is no complete object."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def plan_lines(rows: Iterable[Mapping[str, Any]], plan: str = "the plan") -> bytes:
    """Return the lines of plan.jsonl.

    Args:
        rows: Objects with an ``id`` and anything else that the recorder needs.
        plan: Name of the plan, for errors.

    Raises:
        UserError: A value is no JSON, or an id is missing or repeated.
    """
    lines: list[bytes] = []
    ids: set[int] = set()
    for number, row in enumerate(rows, start=1):
        if type(row.get("id")) is not int or row["id"] in ids:
            raise UserError(
                f"row {number} of {plan} has the id {row.get('id')!r}; each needs a whole number."
            )
        ids.add(row["id"])
        lines.append(json_line(dict(row), f"row {number} of {plan}"))
    return b"".join(lines)


def plan_hash(lines: bytes) -> str:
    """Return the sha256 of a plan's lines; "" without a plan."""
    return hashlib.sha256(lines).hexdigest() if lines else ""


def read_plan(path: Path, sha256: str | None = None) -> tuple[dict[str, Any], ...]:
    """Return the rows of a plan; a missing file has none.

    Args:
        path: The plan's file.
        sha256: Hash that the file must have; None accepts any.

    Raises:
        UserError: The file was changed, or a line is no JSON object with an id of its own.
    """
    data = read_optional(path)
    if sha256 is not None and plan_hash(data) != sha256:
        raise UserError(f"{path} is not the plan that the data set was begun with; restore it.")
    rows = []
    for number, line in enumerate(data.splitlines(), start=1):
        row = parse_object(line)
        if row is None:
            raise UserError(f"{path} line {number} is no JSON object; fix it.")
        rows.append(row)
    plan_lines(rows, str(path))
    return tuple(rows)


def read_optional(path: Path) -> bytes:
    """Return the bytes of a file; a missing file has none."""
    return read_file(path) if path.exists() else b""


SUBSETS = ("train", "validation", "test")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True)
class Split:
    """Ids of three subsets; the samples of one press are in one subset only."""

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid")

    train: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]

    def subset_of(self) -> dict[int, str]:
        """Return id -> the subset that it is in."""
        return {number: subset for subset in SUBSETS for number in getattr(self, subset)}


_SPLIT_FILE = TypeAdapter(Split)


def write_split(folder: Path, name: str, split: Split, samples: Iterable[Sample]) -> None:
    """Write splits/NAME.json. Name the split after how it divides, such as "by-press".

    Hugging Face loads a file with "train", "test" or the like in its name alone.

    Raises:
        UserError: An id is no sample or is named twice, a press is in two subsets, the name cannot
            be used, or another split has the name.
    """
    if not _NAME.fullmatch(name):
        raise UserError(f"a split cannot be called {name!r}; use letters, digits, '-', '_', '.'.")
    check_split(split, samples, f"split {name!r}")
    path = folder / SPLITS / f"{name}.json"
    if path.exists():
        if read_split(path) == split:
            return
        raise UserError(f"{path} is there already and divides otherwise; take another name.")
    write_json(path, {subset: list(getattr(split, subset)) for subset in SUBSETS})


def check_split(split: Split, samples: Iterable[Sample], where: str) -> None:
    """Check that every id is a sample, once, and that no press is in two subsets.

    Raises:
        UserError: An id is no sample or is named twice, or a press is in two subsets; the sentence
            begins with ``where``.
    """
    press = {sample.id: sample.press for sample in samples}
    subset_of_id: dict[int, str] = {}
    first_of_press: dict[str, tuple[str, int]] = {}
    for subset in SUBSETS:
        for number in getattr(split, subset):
            if number not in press:
                raise UserError(f"{where} names id {number} in {subset}, which is no sample.")
            if number in subset_of_id:
                raise UserError(
                    f"{where} names id {number} in {subset_of_id[number]} and again in {subset}; "
                    "a sample is in one part, once."
                )
            subset_of_id[number] = subset
            first, other = first_of_press.setdefault(press[number], (subset, number))
            if first != subset:
                raise UserError(
                    f"{where} leaks: ids {other} ({first}) and {number} ({subset}) are of one "
                    f"press, {press[number]!r}; keep all samples of a press in one part."
                )


def read_split(path: Path) -> Split:
    """Read a split.

    Raises:
        UserError: The file is damaged.
    """
    try:
        return _SPLIT_FILE.validate_json(json.dumps(read_json(path)))
    except ValidationError as error:
        raise UserError(f"{path}: {first_mistake(error, Split)}") from None


def split_files(folder: Path) -> Mapping[str, Path]:
    """Return name -> file of every split of a data set."""
    return {path.stem: path for path in sorted((folder / SPLITS).glob("[!.]*.json"))}


def read_lines(path: Path) -> list[bytes]:
    """Return the acknowledged lines of a journal without line breaks; a missing file has none.

    What stands behind the last line break, and a last line that is no JSON, was left by a write
    that was interrupted.

    Raises:
        UserError: The file cannot be read.
    """
    *lines, _ = read_optional(path).split(b"\n")
    if lines and parse_object(lines[-1]) is None:
        lines.pop()
    return lines


def lines_hash(lines: Sequence[bytes]) -> str:
    """Return the sha256 of the lines of a journal."""
    return hashlib.sha256(b"".join(line + b"\n" for line in lines)).hexdigest()


def read_events(folder: Path) -> tuple[Event, ...]:
    """Return the events of a data set in the order they were noted.

    Raises:
        UserError: A line is no JSON object.
    """
    events = []
    for number, line in enumerate(read_lines(folder / EVENTS), start=1):
        event = parse_object(line)
        if event is None:
            raise UserError(f"{folder / EVENTS} line {number} is no JSON object; restore it.")
        events.append(event)
    return tuple(events)


class Samples(Sequence[Sample]):
    """The samples of a journal, each read from its line when it is asked for.

    Args:
        path: Path of the journal, for errors.
        lines: Its acknowledged lines.
    """

    def __init__(self, path: Path, lines: Sequence[bytes]) -> None:
        self._path = path
        self._lines = lines

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._lines)

    @overload
    def __getitem__(self, row: int) -> Sample: ...

    @overload
    def __getitem__(self, row: slice) -> tuple[Sample, ...]: ...

    def __getitem__(self, row: int | slice) -> Sample | tuple[Sample, ...]:
        """Return the sample of a row, or the samples of a slice.

        Raises:
            IndexError: There is no such row.
            UserError: A line is damaged.
        """
        if isinstance(row, slice):
            return tuple(self[number] for number in range(len(self))[row])
        number = range(len(self))[row]
        return read_row(self._lines[number], f"{self._path} line {number + 1}")


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on the disk.

    Attributes:
        folder: The data set's folder.
        header: Facts that hold for every sample.
        samples: Samples in the order they were written, bad ones included.
        events: Events in the order they were noted.
        sha256: Identity of labels and signals: the hash of the journal, which holds every signal's.
    """

    folder: Path
    header: Header
    samples: Sequence[Sample] = field(repr=False)
    events: tuple[Event, ...] = field(repr=False)
    sha256: str

    @cached_property
    def rest(self) -> Signal | None:
        """Signal of the undeformed sensor, like that of a sample; None if it was not recorded."""
        for number, event in enumerate(self.events, start=1):
            if event.get("kind") == "reference":
                return self._reference(event, f"{self.folder / EVENTS} line {number}")
        return None

    def _reference(self, event: Event, where: str) -> Signal:
        name, sha256, kind = event.get("file_name"), str(event.get("sha256")), self.header.kind
        if not isinstance(kind, ChannelKind):
            if not isinstance(name, str) or not REFERENCE_NAME.fullmatch(name):
                raise UserError(f"{where} names no reference frame; restore the line.")
            return decode_png(name, self._read(self.folder / name, sha256, where), kind)
        try:
            row = np.array(event["channels"], "<f4").reshape(kind.shape)
        except (KeyError, TypeError, ValueError):
            row = np.empty(0, "<f4")
        if hashlib.sha256(row.tobytes()).hexdigest() != sha256:
            raise UserError(f"{where} does not hold the channels at rest; restore the line.")
        return row.astype(np.float32)

    @cached_property
    def splits(self) -> Mapping[str, Split]:
        """Name -> split.

        Raises:
            UserError: A split has a press in two subsets, names an id that is no sample, or is
                damaged.
        """
        splits = {name: read_split(path) for name, path in split_files(self.folder).items()}
        for name, path in split_files(self.folder).items():
            check_split(splits[name], self.samples, str(path))
        return splits

    def plan(self) -> tuple[Mapping[str, Any], ...]:
        """Return the rows of plan.jsonl.

        Raises:
            UserError: The plan was changed or is damaged.
        """
        return read_plan(self.folder / PLAN, self.header.plan_sha256)

    def contacts(self, sample: Sample) -> Contacts | None:
        """Return the contacts of a sample on the header's dome; None where one is unknown."""
        return contacts_of(sample.scene, self.header.dome_radius_mm, sample.contacts_force_n)

    def signal(self, sample: Sample) -> Signal:
        """Return the signal of a sample.

        Returns:
            An image, (H, W) or RGB (H, W, 3) uint8, or channels of the header's shape, float32.

        Raises:
            UserError: The file is not what was written; the sentence names file and sample.
        """
        data, kind = self.stored_bytes(sample), self.header.kind
        if isinstance(kind, ChannelKind):
            return np.frombuffer(data, "<f4").astype(np.float32).reshape(kind.shape)
        return decode_png(self.folder / sample.file_name, data, kind)

    def stored_bytes(self, sample: Sample) -> bytes:
        """Return the PNG file of a sample's image, or its row of channels, not decoded.

        Raises:
            UserError: The file is not what was written.
        """
        row = self._row_of[sample.id] if isinstance(self.header.kind, ChannelKind) else 0
        return self._read(self.folder / sample.file_name, sample.sha256, f"sample {sample.id}", row)

    def _read(self, path: Path, sha256: str, what: str, row: int = 0) -> bytes:
        """Return the bytes of a file, or of a row of channels, that have this hash."""
        kind = self.header.kind
        if isinstance(kind, ChannelKind):
            try:
                with path.open("rb") as file:
                    file.seek(row * kind.row_bytes)
                    data = file.read(kind.row_bytes)
            except OSError as error:
                raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
        else:
            data = read_file(path)
        if hashlib.sha256(data).hexdigest() != sha256:
            place = f"{path} row {row + 1}" if isinstance(kind, ChannelKind) else path
            raise UserError(f"{place} was changed after it was written ({what}); restore it.")
        return data

    @cached_property
    def _row_of(self) -> dict[int, int]:
        return {sample.id: row for row, sample in enumerate(self.samples)}


def open_dataset(folder: Path) -> Dataset:
    """Open a data set for reading; nothing is changed.

    Raises:
        UserError: The folder holds no data set, or the journal of a closed one was changed.
    """
    header, lines = read_header(folder), read_lines(folder / JOURNAL)
    sha256 = lines_hash(lines)
    if header.status == "closed" and sha256 != header.journal_sha256:
        raise UserError(
            f"{folder / JOURNAL} is not what it was when the data set was closed; restore it "
            f"(`tactibench data verify {folder}` says what is wrong)."
        )
    samples = Samples(folder / JOURNAL, lines)
    return Dataset(folder, header, samples, read_events(folder), sha256)


def count_samples(folder: Path) -> int:
    """Return the number of lines in the journal, which may be damaged.

    Raises:
        UserError: The folder holds no data set.
    """
    read_header(folder)
    return len(read_lines(folder / JOURNAL))


def verify(folder: Path, advance: Callable[[int], None] = lambda _: None) -> list[str]:
    """Compare signals, journals, plan and splits of a data set with what was written.

    Args:
        folder: The data set's folder, in which nothing is changed.
        advance: Called with the number of samples that were finished.

    Returns:
        One sentence for each thing that is not as it was written; none for an intact data set.

    Raises:
        UserError: The folder holds no data set.
    """
    header, lines = read_header(folder), read_lines(folder / JOURNAL)
    journal, findings, samples = folder / JOURNAL, list[str](), list[Sample]()
    row_of: dict[int, int] = {}
    for row, line in enumerate(lines):
        try:
            sample = read_row(line, f"{journal} line {row + 1}")
        except UserError as error:
            findings.append(str(error))
            continue
        samples.append(sample)
        if (first := row_of.setdefault(sample.id, row)) != row:
            findings.append(
                f"{journal} lines {first + 1} and {row + 1} are both of id {sample.id}; an id "
                "stands once: remove one of them."
            )
    if header.status == "closed" and lines_hash(lines) != header.journal_sha256:
        findings.append(
            f"{journal} is not what it was when the data set was closed (checksum, "
            f"{header.counts.get('samples', 0):,} samples then, {len(samples):,} now); restore it."
        )
    try:
        events = read_events(folder)
    except UserError as error:
        findings.append(str(error))
        events = ()
    dataset = Dataset(folder, header, samples, events, "")
    # A row of channels belongs to its line, also where lines before it are damaged.
    dataset.__dict__["_row_of"] = row_of
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for sentences in pool.map(lambda sample: list(_finding(dataset.signal, sample)), samples):
            findings += sentences
            advance(1)
    for number, event in enumerate(events, start=1):
        if event.get("kind") == "reference":
            where = f"{folder / EVENTS} line {number}"
            findings += _finding(dataset._reference, event, where)
    findings += _finding(dataset.plan)
    for path in split_files(folder).values():
        findings += _finding(lambda path=path: check_split(read_split(path), samples, str(path)))
    return findings


def _finding(check: Callable[..., object], *arguments: object) -> Iterator[str]:
    """Yield the sentence with which a check refuses its arguments, if it does."""
    try:
        check(*arguments)
    except UserError as error:
        yield str(error)
