"""Answers (contacts, plate poses or named places) as flat arrays, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, PlatePose, Sites

Arrays = dict[str, npt.NDArray[Any]]
STEP = 2.0**-10
"""Step of stored places, depths, forces and tilts: about 1 um, 1 mN, 0.001 deg. A value moves by at
most half of it, a ninth of the smallest error on a board (0.0046 mm, of a depth). A model's further
digits are noise, and would be half of a file."""
LARGEST = 2.0**40
"""Larger values stay as they are: there the step is lost in a float64."""
RELATIVE = ("score", "std", "probability", "plate_std")
"""Numbers whose size may be anything: ten binary digits of them are stored, 0.1 %."""


def pack_contacts(answers: Sequence[Contacts]) -> Arrays:
    """Return the contacts of N frames as flat arrays of M rows, one row per contact.

    Returns:
        count (N,), xy (M, 2), depth (M,), score (M,) and std (M, 3), which is NaN where none was
        given; where the forces of all contacts are known, force (M, 3).
    """
    unknown = [np.full((len(a), 3), np.nan) if a.std is None else a.std for a in answers]
    forces = [a.force for a in answers if a.force is not None and len(a)]
    known = bool(forces) and sum(map(len, forces)) == sum(map(len, answers))
    return {
        "count": np.array([len(a) for a in answers], dtype=np.int64),
        "xy": np.concatenate([np.empty((0, 2)), *(a.xy for a in answers)]),
        "depth": np.concatenate([np.empty(0), *(a.depth for a in answers)]),
        "score": np.concatenate([np.empty(0), *(a.score for a in answers)]),
        "std": np.concatenate([np.empty((0, 3)), *unknown]),
        **({"force": np.concatenate(forces)} if known else {}),
    }


def unpack_contacts(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[Contacts, ...]:
    """Return the contacts of every frame from the arrays of ``pack_contacts``."""
    ends = np.cumsum(arrays["count"])
    out = []
    for start, end in zip(ends - arrays["count"], ends, strict=True):
        part = slice(int(start), int(end))
        std = arrays["std"][part]
        given_std = None if np.isnan(std).any() or not len(std) else std
        xy, depth, score = (arrays[name][part] for name in ("xy", "depth", "score"))
        force = arrays["force"][part] if "force" in arrays else None
        out.append(Contacts(xy, depth, score, given_std, force))
    return tuple(out)


def pack_plates(answers: Sequence[PlatePose | None]) -> Arrays:
    """Return the plate poses of N frames as flat arrays.

    Returns:
        given (N,) bool, plate_depth (N,), plate_tilt (N,) and plate_std (N, 2). Depth and tilt are
        zero where no answer was given, std is NaN where none was given.
    """
    stds = [a.std if a and a.std else (np.nan, np.nan) for a in answers]
    return {
        "given": np.array([a is not None for a in answers], dtype=bool),
        "plate_depth": np.array([a.depth if a else 0.0 for a in answers], dtype=np.float64),
        "plate_tilt": np.array([a.tilt if a else 0.0 for a in answers], dtype=np.float64),
        "plate_std": np.array(stds, dtype=np.float64).reshape(len(answers), 2),
    }


def unpack_plates(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[PlatePose | None, ...]:
    """Return the plate pose of every frame from the arrays of ``pack_plates``."""
    columns = ("given", "plate_depth", "plate_tilt", "plate_std")
    out: list[PlatePose | None] = []
    for given, depth, tilt, std in zip(*(arrays[name] for name in columns), strict=True):
        given_std = None if np.isnan(std).any() else (float(std[0]), float(std[1]))
        out.append(PlatePose(float(depth), float(tilt), given_std) if given else None)
    return tuple(out)


def pack_sites(answers: Sequence[Sites]) -> Arrays:
    """Return the named places of N frames as arrays: names (K,), probability and touched (N, K)."""
    names = answers[0].names if answers else ()
    if any(answer.names != names for answer in answers):
        raise ValueError("answers name different places")
    shape = (len(answers), len(names))
    return {
        "names": np.array(names, dtype=np.str_),
        "probability": np.array([a.probability for a in answers], dtype=np.float64).reshape(shape),
        "touched": np.array([a.touched for a in answers], dtype=bool).reshape(shape),
    }


def unpack_sites(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[Sites, ...]:
    """Return the named places of every frame from the arrays of ``pack_sites``."""
    names = tuple(arrays["names"].tolist())
    rows = zip(arrays["probability"].tolist(), arrays["touched"].tolist(), strict=True)
    return tuple(Sites(names, tuple(probability), tuple(touched)) for probability, touched in rows)


def pack(answers: Sequence[Answer | None], kind: str) -> Arrays:
    """Return answers of one kind as flat arrays.

    Args:
        answers: One answer of this kind a frame; None: no plate pose was given.
        kind: "contacts", "plate" or "sites".
    """
    by_kind: Any = {"contacts": pack_contacts, "plate": pack_plates, "sites": pack_sites}
    arrays: Arrays = by_kind[kind](answers)
    return arrays


def unpack(arrays: Mapping[str, npt.NDArray[Any]], kind: str) -> tuple[Answer | None, ...]:
    """Return the answers of one kind from the arrays of ``pack``."""
    by_kind: Any = {"contacts": unpack_contacts, "plate": unpack_plates, "sites": unpack_sites}
    answers: tuple[Answer | None, ...] = by_kind[kind](arrays)
    return answers


def round_answers(arrays: Mapping[str, npt.NDArray[Any]]) -> Arrays:
    """Return packed answers as they are stored and scored, without digits that say nothing."""
    return {
        name: _rounded(name, array) if array.dtype.kind == "f" else array
        for name, array in arrays.items()
    }


def _rounded(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if name in RELATIVE:
        mantissa, exponent = np.frexp(values)
        return np.asarray(np.ldexp(np.rint(mantissa / STEP) * STEP, exponent))
    near = np.clip(values, -LARGEST, LARGEST)
    return np.where(near == values, np.rint(near / STEP) * STEP, values)
