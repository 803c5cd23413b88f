"""Answers (contacts or plate poses) as flat arrays, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, PlatePose

Arrays = dict[str, npt.NDArray[Any]]


def pack_contacts(answers: Sequence[Contacts]) -> Arrays:
    """count (N,), xy (M, 2), depth (M,), score (M,), std (M, 3) with NaN where none was given."""
    unknown = [np.full((len(a), 3), np.nan) if a.std is None else a.std for a in answers]
    return {
        "count": np.array([len(a) for a in answers], dtype=np.int64),
        "xy": np.concatenate([np.empty((0, 2)), *(a.xy for a in answers)]),
        "depth": np.concatenate([np.empty(0), *(a.depth for a in answers)]),
        "score": np.concatenate([np.empty(0), *(a.score for a in answers)]),
        "std": np.concatenate([np.empty((0, 3)), *unknown]),
    }


def unpack_contacts(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[Contacts, ...]:
    """The inverse of ``pack_contacts``."""
    ends = np.cumsum(arrays["count"])
    out = []
    for start, end in zip(ends - arrays["count"], ends, strict=True):
        part = slice(int(start), int(end))
        std = arrays["std"][part]
        given = None if np.isnan(std).any() or not len(std) else std
        out.append(Contacts(arrays["xy"][part], arrays["depth"][part], arrays["score"][part], given))
    return tuple(out)


def pack_plates(answers: Sequence[PlatePose | None]) -> Arrays:
    """given (N,) bool, depth (N,), tilt (N,); zero where no answer was given."""
    return {
        "given": np.array([a is not None for a in answers], dtype=bool),
        "plate_depth": np.array([a.depth if a else 0.0 for a in answers], dtype=np.float64),
        "plate_tilt": np.array([a.tilt if a else 0.0 for a in answers], dtype=np.float64),
    }


def unpack_plates(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[PlatePose | None, ...]:
    """The inverse of ``pack_plates``."""
    rows = zip(arrays["given"], arrays["plate_depth"], arrays["plate_tilt"], strict=True)
    return tuple(PlatePose(float(d), float(t)) if given else None for given, d, t in rows)


def pack(answers: Sequence[Answer | None], kind: str) -> Arrays:
    """Pack answers of one kind, "contacts" or "plate"."""
    if kind == "plate":
        return pack_plates([a if isinstance(a, PlatePose) else None for a in answers])
    return pack_contacts([a if isinstance(a, Contacts) else Contacts.none() for a in answers])
