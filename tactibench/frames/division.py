"""The rows of a recording that train, validate and test."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from tactibench.errors import UserError
from tactibench.protocols.loader import LoadedProtocol


class Division(NamedTuple):
    """Rows of a recording that train, validate and test."""

    fit: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]


def divide_by_parts(parts: Sequence[str], presses: Sequence[str]) -> Division:
    """Return the rows of the parts "train", "validation" and "test" of a recording's own split.

    Raises:
        UserError: A part has no frames, or a press is in two parts.
    """
    names = ("train", "validation", "test")
    division = Division(
        *(tuple(row for row, part in enumerate(parts) if part == name) for name in names)
    )
    for name, rows in zip(names, division, strict=True):
        if not rows:
            raise UserError(
                f"the recording's split has no frames that this protocol can take in its part "
                f"{name!r}; give it some, or leave --param sensor.split out."
            )
    refuse_shared_presses(presses, division)
    return division


def published_frames(
    protocol: LoadedProtocol, names: Sequence[str], image: list[int] | None
) -> tuple[str, ...] | None:
    """Return the names of the published test frames; None where a recording is another one.

    The recording must hold all of them and more, at their size.

    Args:
        protocol: The protocol, which lists the published test frames.
        names: Names of the recording's frames.
        image: Height and width of its frames, px; None: not known.
    """
    published, recorded = protocol.test_frames, protocol.spec.recorded
    if not published or recorded is None or recorded.test_frames_size is None or image is None:
        return None
    same = set(published) < set(names) and tuple(image) == recorded.test_frames_size
    return published if same else None


def refuse_shared_presses(presses: Sequence[str], division: Division) -> None:
    """Raise UserError when frames of one press are in two parts: the test would not be fair."""
    part_of: dict[str, int] = {}
    for number, rows in enumerate(division):
        for row in rows:
            if part_of.setdefault(presses[row], number) != number:
                raise UserError(
                    f"frames of press {presses[row]!r} are in two parts of the split; a press "
                    "trains or tests, never both: divide the data set by press."
                )
