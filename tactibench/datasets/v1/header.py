"""dataset.json: what holds for the whole data set."""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, NonNegativeInt, PositiveInt, TypeAdapter, ValidationError

from tactibench.datasets.v1.layout import HEADER
from tactibench.datasets.v1.mistakes import first_mistake
from tactibench.errors import UserError
from tactibench.records.files import write_json

SCHEMA_VERSION = 1
UNITS = {"length": "mm", "angle": "deg", "force": "N"}
AXES = "sxyz"
"""Angles are extrinsic rotations about x, y, z."""
FRAMES = {
    "sensor": "right-handed, origin at the undeformed apex, x right and y down in the image, "
    "z out of the dome",
}
_FLAT = "flat"
_OWN = ("uuid", "status", "counts", "journal_sha256")
"""What a data set has of its own: it does not matter when writing goes on."""


@dataclass(frozen=True)
class Header:
    """What holds for every sample.

    sensor: name, parameters, versions. image: (H, W). channels: 1 gray or 3 RGB. dome_radius_mm: of
    the pressed surface, inf where it is flat, None where nobody knows. source: importer, options
    and sha256 of what was read. counts, journal_sha256: written when the data set is closed.
    """

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=True)

    name: str
    sensor: Mapping[str, Any]
    image: tuple[PositiveInt, PositiveInt]
    channels: Literal[1, 3] = 1
    dome_radius_mm: float | None = None
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
    def shape(self) -> tuple[int, ...]:
        """Of an image: (H, W) or (H, W, 3)."""
        return (*self.image, 3) if self.channels == 3 else self.image


_FILE = TypeAdapter(Header)


def read_header(folder: Path) -> Header:
    """The header of a data set. Raises UserError with the key that is wrong."""
    path = folder / HEADER
    try:
        value = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise UserError(f"{folder} is no data set: it holds no {HEADER}.") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not valid JSON: {error}; restore it.") from None
    if not isinstance(value, dict):
        raise UserError(f"{path} holds no JSON object; restore it.")
    version = value.get("schema_version")
    if version != SCHEMA_VERSION:
        raise UserError(
            f"{path} has schema_version {version!r}, this tactibench reads {SCHEMA_VERSION}; "
            "take the tactibench that wrote it, or a newer one."
        )
    if value.get("dome_radius_mm") == _FLAT:
        value["dome_radius_mm"] = math.inf
    try:
        # As Python values a list would be no tuple.
        header = _FILE.validate_json(json.dumps(value))
    except ValidationError as error:
        raise UserError(f"{path}: {first_mistake(error, _names())}") from None
    _check(header, str(path))
    return header


def write_header(folder: Path, header: Header) -> None:
    """Write dataset.json. Raises UserError for a header that could not be read again."""
    _check(header, "the header of the data set")
    value = asdict(header)
    if header.dome_radius_mm is not None and math.isinf(header.dome_radius_mm):
        value["dome_radius_mm"] = _FLAT  # infinity has no meaning in JSON
    try:
        _FILE.validate_json(json.dumps({**value, "dome_radius_mm": None}, allow_nan=False))
    except ValidationError as error:
        raise UserError(f"the header of the data set: {first_mistake(error, _names())}") from None
    except (TypeError, ValueError) as error:
        raise UserError(f"the header of the data set cannot be written: {error}.") from None
    write_json(folder / HEADER, value)


def resumed(folder: Path, asked: Header) -> Header:
    """The header on the disk, when it is the one that is asked for but for what a data set has of
    its own. Raises UserError with the first key that differs, or when the data set is closed."""
    found = read_header(folder)
    if found.status == "closed":
        raise UserError(
            f"{folder} is closed: it holds {found.counts.get('samples', 0):,} samples and takes no "
            "more; name another folder."
        )
    for key in (f.name for f in fields(Header) if f.name not in _OWN):
        difference = _difference(key, _plain(found, key), _plain(asked, key))
        if difference:
            raise UserError(
                f"{folder} was begun with {difference}; go on with the same settings, or name "
                "another folder."
            )
    return found


def closed(header: Header, counts: Mapping[str, int], journal_sha256: str) -> Header:
    """The header of the finished data set."""
    return replace(header, status="closed", counts=dict(counts), journal_sha256=journal_sha256)


def _check(header: Header, where: str) -> None:
    radius = header.dome_radius_mm
    if radius is not None and not radius > 0:
        raise UserError(f"{where}: dome_radius_mm is {radius}; it must be positive or {_FLAT!r}.")


def _plain(header: Header, key: str) -> Any:
    """As it comes back from the disk: tuples as lists, keys as text."""
    return json.loads(json.dumps(getattr(header, key)))


def _difference(key: str, before: Any, now: Any) -> str:
    """The first key, however deep, that is not what it was, with both values; "" without one."""
    if before == now:
        return ""
    if isinstance(before, dict) and isinstance(now, dict):
        parts = (_difference(f"{key}.{k}", before.get(k), now.get(k)) for k in {**before, **now})
        return next(filter(None, parts))
    return f"{key} {_short(before)}, now it is {_short(now)}"


def _short(value: Any, most: int = 60) -> str:
    text = json.dumps(value)
    return text if len(text) <= most else f"{text[:most]}..."


def _names() -> list[str]:
    return [f.name for f in fields(Header)]
