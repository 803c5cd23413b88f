"""Labels as arrays and back, and the file in which both baselines store their weights."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench import Answer, Contacts, PlatePose, UserError

Arrays = dict[str, npt.NDArray[Any]]
Kind = TypeVar("Kind", Contacts, PlatePose)


def pack(truth: Sequence[Answer], answer: str) -> Arrays:
    """Return N labels as arrays.

    Args:
        truth: The labels.
        answer: "contacts" or "plate".

    Returns:
        For "contacts": count (N,), and xy (M, 2) and depth (M,) in mm of all M contacts. For
        "plate": depth (N,) in mm and tilt (N,) in deg.

    Raises:
        TypeError: A label is of the other kind.
    """
    if answer == "plate":
        plates = _all_of(PlatePose, truth)
        return {
            "depth": np.array([plate.depth for plate in plates], dtype=np.float64),
            "tilt": np.array([plate.tilt for plate in plates], dtype=np.float64),
        }
    touches = _all_of(Contacts, truth)
    return {
        "count": np.array([len(contacts) for contacts in touches], dtype=np.int64),
        "xy": np.concatenate([np.empty((0, 2)), *(contacts.xy for contacts in touches)]),
        "depth": np.concatenate([np.empty(0), *(contacts.depth for contacts in touches)]),
    }


def _all_of(kind: type[Kind], truth: Sequence[Answer]) -> list[Kind]:
    fitting = [label for label in truth if isinstance(label, kind)]
    if len(fitting) != len(truth):
        raise TypeError(f"{len(truth) - len(fitting)} labels are no {kind.__name__}")
    return fitting


def unpack(arrays: Mapping[str, npt.NDArray[Any]]) -> list[Answer]:
    """Return the labels that ``pack`` was given."""
    if "tilt" in arrays:
        pairs = zip(arrays["depth"].tolist(), arrays["tilt"].tolist(), strict=True)
        return [PlatePose(depth, tilt) for depth, tilt in pairs]
    ends = np.cumsum(arrays["count"])
    return [
        Contacts.truth(arrays["xy"][end - n : end], arrays["depth"][end - n : end])
        for n, end in zip(arrays["count"], ends, strict=True)
    ]


def write(path: Path, arrays: dict[str, Any]) -> None:
    """Write an .npz; equal arrays give equal bytes."""
    with path.open("wb") as file:
        np.savez(file, **arrays)


def read(path: Path, answer: str, *names: str, optional: str = "") -> Arrays:
    """Read the arrays of ``pack`` and others from a file. Nothing is unpickled.

    Args:
        path: The file.
        answer: "contacts" or "plate".
        names: Further arrays that the file must hold.
        optional: One more array that it may hold.

    Raises:
        UserError: The file is missing or damaged, or holds other arrays, such as labels of another
            kind.
    """
    expected = {*names, *pack((), answer)}
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise UserError(f"{path} is no readable weights file: {reason}; train again.") from None
    if set(arrays) - {optional} != expected:
        raise UserError(
            f"{path} holds {', '.join(sorted(arrays))}, but a model that answers {answer!r} needs "
            f"{', '.join(sorted(expected))}; train again."
        )
    return arrays
