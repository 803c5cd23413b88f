"""The fit of the simulator to recorded presses as a file, with the frames that it saw."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Self

from tactibench import UserError
from tactibench_sim.real.unknowns import Unknowns

FILE = "calibration.json"


@dataclass(frozen=True)
class Calibration:
    """recording: sha256. frames: names of those that were fitted to. side: of its frames, px.

    rest_centre: mean of the pins at rest, px. kind: of the dome (``plates.kinds``). Files are
    written by `tactibench sim real FOLDER --keep FILE`.
    """

    recording: str
    frames: tuple[str, ...]
    side: int
    rest_centre: tuple[float, float]
    kind: str
    unknowns: Unknowns

    def write(self, path: Path) -> None:
        """Raises UserError where it cannot be written."""
        try:
            path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror}.") from None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Raises UserError for a file that is none of ``write``'s."""
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            x, y = map(float, content["rest_centre"])
            return cls(
                str(content["recording"]),
                tuple(map(str, content["frames"])),
                int(content["side"]),
                (x, y),
                str(content["kind"]),
                Unknowns(**{name: float(value) for name, value in content["unknowns"].items()}),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise UserError(
                f"{path} is no calibration ({type(error).__name__}: {error}); make one with "
                "`tactibench sim real FOLDER --keep FILE`."
            ) from None


@cache
def shipped() -> Calibration:
    """The fit to 200 presses of the public 331-pin recording that ships with the package."""
    with as_file(files(__package__).joinpath(FILE)) as path:
        return Calibration.read(path)
