"""What was asked for, before anything is looked up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tactibench.errors import UserError, did_you_mean

QUICK_FIT, QUICK_VALIDATION, QUICK_TEST, QUICK_EPOCHS = 200, 40, 40, 2
"""--quick: 200 training presses, 2 epochs, 40 test presses. It proves the path, nothing else."""


REFERENCE, HIDDEN, DATA = "reference", "hidden", "data"


def folder_label(path: Path) -> str:
    """How a folder is called in records: its name and its parent's, the machine's paths are not."""
    return "/".join(path.resolve().parts[1:][-2:])


@dataclass(frozen=True)
class TestedOn:
    """What presses the test scenes, where it is not what presses those of the training.

    reference: the sensor's reference scenes, in place of the protocol's. parameters: of the sensor,
    in place of those of the training. hidden: presses drawn from a seed that is kept secret. data:
    folder of another sensor's recording.
    """

    __test__ = False  # not a test case, whatever its name

    reference: bool = False
    parameters: Mapping[str, str] = field(default_factory=dict)
    hidden: bool = False
    data: Path | None = None

    def __bool__(self) -> bool:
        return self.reference or self.hidden or bool(self.parameters) or self.data is not None

    @property
    def texts(self) -> list[str]:
        """As they are given with ``--test``, and "hidden" for ``--hidden-seed``."""
        changed = [f"sensor.{name}={value}" for name, value in self.parameters.items()]
        words = {REFERENCE: self.reference, HIDDEN: self.hidden}
        folder = [] if self.data is None else [f"{DATA}={folder_label(self.data)}"]
        return [*folder, *(word for word, given in words.items() if given), *changed]


@dataclass(frozen=True)
class RunRequest:
    """The options of ``tactibench run``; None stands for the protocol's default.

    presses: learn from that many of the presses that the protocol's split trains on, for a learning
    curve; None: from all. The validation presses and those that a regime adds stay.
    released: file of published answers to the test frames; None: looked for beside the data.
    """

    protocol: str
    model: str
    regime: str | None = None
    sensor: str | None = None
    encoder: str | None = None
    data: Path | None = None
    seed: int = 0
    device: str = "auto"
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    quick: bool = False
    limit: int | None = None
    presses: int | None = None
    tested: TestedOn = field(default_factory=TestedOn)
    released: Path | None = None

    @property
    def partial(self) -> bool:
        """Whether the result may not stand on a board."""
        return self.quick or self.limit is not None


def read_parameters(texts: tuple[str, ...]) -> dict[str, dict[str, str]]:
    """``("model.width=32",)`` -> ``{"model": {"width": "32"}}``. Raises UserError."""
    found: dict[str, dict[str, str]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        kind, dot, key = name.partition(".")
        if not equals or not dot or kind not in ("model", "sensor", "encoder") or not key:
            raise UserError(
                f"--param {text!r} is not understood; write KIND.NAME=VALUE with KIND one of "
                "model, sensor, encoder, for example --param model.width=32."
            )
        if key in found.setdefault(kind, {}):
            raise UserError(f"--param {kind}.{key} is given twice; give it once.")
        found[kind][key] = value
    return found


def read_tested(texts: tuple[str, ...], *, hidden: bool = False) -> TestedOn:
    """``("reference",)``, ``("sensor.instance=1",)`` or ``("data=folder",)`` -> what to test on.

    Raises UserError.
    """
    parameters: dict[str, str] = {}
    folder: Path | None = None
    for text in texts:
        name, equals, value = text.partition("=")
        kind, _, key = name.partition(".")
        if text == REFERENCE:
            continue
        if name == DATA and equals:
            if not value:
                raise UserError("--test data= names no folder; write --test data=FOLDER.")
            if folder is not None:
                raise UserError("--test data is given twice; a run is tested on one recording.")
            folder = Path(value)
            continue
        if not equals:
            raise UserError(
                f"--test {text!r} is neither the word {REFERENCE!r} nor sensor.NAME=VALUE, for "
                "example sensor.instance=1, nor data=FOLDER; "
                f"{did_you_mean(text, [REFERENCE, DATA])}"
            )
        if kind != "sensor" or not key:
            raise UserError(
                f"--test {text!r} changes no sensor; write sensor.NAME=VALUE, for example "
                "sensor.instance=1, or data=FOLDER; what the model is made with goes in --param."
            )
        if key in parameters:
            raise UserError(f"--test sensor.{key} is given twice; give it once.")
        parameters[key] = value
    return TestedOn(REFERENCE in texts, parameters, hidden, folder)
