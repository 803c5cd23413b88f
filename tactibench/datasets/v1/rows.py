"""A sample <-> its line in metadata.jsonl.

Every key always has the same type, and what is not known is left out, so that readers that take the
type of a column from what they see (Hugging Face image folders, Arrow) agree on it.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from pydantic import ConfigDict, NonNegativeInt, PositiveInt, TypeAdapter, ValidationError

from tactibench.contacts import Scene
from tactibench.datasets.v1.layout import image_name
from tactibench.datasets.v1.mistakes import first_mistake
from tactibench.datasets.v1.sample import Sample, contacts_of
from tactibench.datasets.v1.scenes import SceneKeys, scene_keys
from tactibench.errors import UserError


@dataclass(frozen=True, kw_only=True)
class Row(SceneKeys):
    """A line: the image's file, the scene with the pose that was reached, and the contacts, which
    follow from it and from the dome's radius and are left out without either."""

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    file_name: str
    id: NonNegativeInt
    status: Literal["ok", "bad"]
    sha256: str
    press: str
    session: str = ""
    attempt: PositiveInt = 1
    t_frame_ns: int | None = None
    n_contacts: NonNegativeInt | None = None
    contacts_xy_mm: tuple[tuple[float, float], ...] = ()
    contacts_depth_mm: tuple[float, ...] = ()
    labels: dict[str, float] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)


_FILE = TypeAdapter(Row)


def row_text(sample: Sample, dome_radius_mm: float | None) -> bytes:
    """The line of a sample, its end included.

    Raises UserError for values that are no JSON or not finite.
    """
    return json_line(_row(sample, dome_radius_mm), f"sample {sample.id}")


def json_line(value: dict[str, Any], what: str) -> bytes:
    """A line of a journal, its end included. Raises UserError, which begins with ``what``, for
    values that are no JSON or not finite."""
    try:
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        return text.encode() + b"\n"
    except (TypeError, ValueError, RecursionError) as error:
        raise UserError(
            f"{what} cannot be written: {error}; allowed are text, finite numbers, and lists and "
            "objects of them."
        ) from None


def read_row(line: bytes, where: str) -> Sample:
    """The sample of a line. Raises UserError, which begins with ``where``."""
    row = _parsed(line, where)
    if row.file_name != image_name(row.id):
        raise UserError(
            f"{where}: file_name is {row.file_name!r}, but the image of id {row.id} is "
            f"{image_name(row.id)}; restore the line."
        )
    return Sample(
        row.id,
        row.file_name,
        row.sha256,
        row.status,
        row.scene(where),
        row.labels,
        row.press,
        row.session,
        row.attempt,
        row.t_frame_ns,
        row.extra,
    )


def check_contacts(line: bytes, where: str, dome_radius_mm: float | None) -> None:
    """Raises UserError when the contacts of a line are not those of its scene; they are derived,
    so they may differ in the last digits of another machine's sine."""
    row = _parsed(line, where)
    contacts = contacts_of(row.scene(where), dome_radius_mm)
    found = [*(v for xy in row.contacts_xy_mm for v in xy), *row.contacts_depth_mm]
    wanted: list[float] = []
    if contacts is not None:
        wanted = [*contacts.xy.ravel().tolist(), *contacts.depth.tolist()]
    close = len(found) == len(wanted) and all(
        math.isclose(a, b, rel_tol=0, abs_tol=1e-6) for a, b in zip(found, wanted, strict=True)
    )
    if row.n_contacts != (None if contacts is None else len(contacts)) or not close:
        raise UserError(
            f"{where}: the contacts are not those of the indenter at this pose; restore the line."
        )


def is_json(line: bytes) -> bool:
    """Whether a line is a whole JSON object, as every line that was written to its end is."""
    try:
        return isinstance(json.loads(line), dict)
    except (ValueError, RecursionError):
        return False


def _parsed(line: bytes, where: str) -> Row:
    try:
        return _FILE.validate_json(line)
    except ValidationError as error:
        known = [f.name for f in fields(Row)]
        raise UserError(f"{where}: {first_mistake(error, known)}") from None


def _row(sample: Sample, dome_radius_mm: float | None) -> dict[str, Any]:
    row: dict[str, Any] = {
        "file_name": sample.file_name,
        "id": sample.id,
        "status": sample.status,
        "sha256": sample.sha256,
        "press": sample.press,
        "session": sample.session,
        "attempt": sample.attempt,
    }
    if sample.t_frame_ns is not None:
        row["t_frame_ns"] = int(sample.t_frame_ns)
    if sample.scene is not None:
        row |= scene_keys(sample.scene)
        row |= _contact_keys(sample.scene, dome_radius_mm)
    if sample.labels:
        row["labels"] = {str(name): float(value) for name, value in sample.labels.items()}
    if sample.extra:
        row["extra"] = dict(sample.extra)
    return row


def _contact_keys(scene: Scene, dome_radius_mm: float | None) -> dict[str, Any]:
    contacts = contacts_of(scene, dome_radius_mm)
    if contacts is None:
        return {}
    return {
        "n_contacts": len(contacts),
        "contacts_xy_mm": contacts.xy.tolist(),
        "contacts_depth_mm": contacts.depth.tolist(),
    }
