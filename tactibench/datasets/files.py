"""Files of a data set: lines of metadata.jsonl and plan.jsonl, and splits/NAME.json, and back.

Every key always has the same type, and unknown values are left out. Readers that take the type of a
column from its first values (Hugging Face image folders, Arrow) then agree on it.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, NonNegativeInt, PositiveInt, TypeAdapter, ValidationError

from tactibench.contacts import Indenter, Pose, Scene
from tactibench.datasets.schema import (
    CHANNEL_FILE,
    SPLITS,
    Forces,
    Sample,
    Status,
    contacts_of,
    image_name,
)
from tactibench.errors import UserError
from tactibench.png import read_file
from tactibench.protocols import first_mistake
from tactibench.records import read_json, write_json

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
            f"{what} cannot be written: {error}; allowed are text, finite numbers, and lists and "
            "objects of them."
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
                f"row {number} of {plan} has the id {row.get('id')!r}; every row needs a whole "
                "number of its own."
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
        raise UserError(
            f"a split cannot be called {name!r}; a name has letters, digits, '-', '_' and '.'."
        )
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
