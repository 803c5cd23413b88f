"""The request of a run: its options, before anything is looked up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import PluginHost

REFERENCE, HIDDEN, DATA, SHOTS = "reference", "hidden", "data", "shots"
KINDS = ("model", "sensor", "encoder")
MOST_SHOTS = 10_000
"""Most labelled presses of a tested sensor: more of them would be a training of its own."""


@dataclass(frozen=True)
class TestOptions:
    """The sensor and presses of the test, where they are not those of the training.

    Attributes:
        reference: Whether to test on the sensor's reference scenes in place of the protocol's.
        parameters: Parameters of the tested sensor in place of those of the training.
        hidden: Whether to test on presses drawn from a secret seed.
        data: Folder of another sensor's recording.
        shots: Number of labelled single presses of the tested sensor that the model is shown before
            the test.
    """

    __test__ = False  # not a test case, whatever its name

    reference: bool = False
    parameters: Mapping[str, str] = field(default_factory=dict)
    hidden: bool = False
    data: Path | None = None
    shots: int = 0

    def __bool__(self) -> bool:
        return bool(self.texts)

    @property
    def texts(self) -> list[str]:
        """Return the options as texts of ``--test``, and "hidden" for hidden presses."""
        return [
            *([] if self.data is None else [f"{DATA}={folder_label(self.data)}"]),
            *([REFERENCE] if self.reference else []),
            *([HIDDEN] if self.hidden else []),
            *(f"sensor.{name}={value}" for name, value in self.parameters.items()),
            *([f"{SHOTS}={self.shots}"] if self.shots else []),
        ]


@dataclass(frozen=True)
class RunRequest:
    """The options of ``tactibench run``; None stands for the protocol's default.

    Attributes:
        protocol: Name or file of the protocol.
        model: Name of the model.
        regime: Name of the training regime.
        sensor: Name of the sensor.
        encoder: Name of the encoder.
        data: Folder of recorded frames.
        seed: Seed of the training.
        device: "auto", "cpu" or "cuda".
        parameters: Kind of a plugin ("model", "sensor" or "encoder") -> parameter -> value.
        quick: Whether to run with few presses, epochs and tests.
        limit: Most test presses; None for all.
        presses: Number of presses to learn from, of those that the protocol's split trains on, for
            a learning curve; None for all. Validation presses and those that a regime adds stay.
        test: The sensor and presses of the test, where they are not those of the training.
        published: File of published predictions for the test frames; None to search for it beside
            the data.
        runner: Command that starts the process in which the model answers, "" for this Python;
            None: it answers in this process, except to hidden presses.
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
    test: TestOptions = field(default_factory=TestOptions)
    published: Path | None = None
    runner: str | None = None

    @property
    def in_worker(self) -> bool:
        """Return whether the model answers in a process of its own, see ``run.worker``."""
        return self.test.hidden or self.runner is not None

    @property
    def partial(self) -> bool:
        """Return whether the run is quick or limited, so that its result may not be on a board."""
        return self.quick or self.limit is not None


def folder_label(path: Path) -> str:
    """Return the name of a folder after its parent's: records do not hold the machine's paths."""
    return "/".join(path.resolve().parts[1:][-2:])


def data_folder(path: Path | None, option: str = "--data") -> Path | None:
    """Return the folder that is given with an option, or None where none is given.

    Raises:
        UserError: The folder does not exist, or the path is no folder.
    """
    if path is not None and not path.is_dir():
        mistake = "is not a folder" if path.exists() else "does not exist"
        raise UserError(f"the data folder {path} {mistake}; check {option}.")
    return path


def read_parameters(
    texts: tuple[str, ...], kinds: tuple[str, ...] = KINDS
) -> dict[str, dict[str, str]]:
    """Return the parameters in texts: ``{"model": {"width": "32"}}`` of ``("model.width=32",)``.

    Args:
        texts: Texts of ``--param``.
        kinds: Kinds that have parameters here.

    Raises:
        UserError: A text is no KIND.NAME=VALUE with a known kind, or a parameter is given twice.
    """
    parameters: dict[str, dict[str, str]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        kind, dot, parameter = name.partition(".")
        if not equals or not dot or kind not in kinds or not parameter:
            example = "model.width=32" if "model" in kinds else "sensor.size=256"
            of_kinds = (c for c in PluginHost().catalogues if c.kind in kinds)
            known = {f"{c.kind}.{p.name}" for c in of_kinds for spec in c for p in spec.parameters}
            full = name if dot else f"{kinds[0]}.{name}"
            meant = did_you_mean(full, known if equals else (), f"try --param {example}.")
            raise UserError(
                f"--param {text!r} is not understood; write KIND.NAME=VALUE with KIND one of "
                f"{', '.join(kinds)}; {meant}"
            )
        if parameter in parameters.setdefault(kind, {}):
            raise UserError(f"--param {kind}.{parameter} is given twice; give it once.")
        parameters[kind][parameter] = value
    return parameters


def read_test_options(texts: tuple[str, ...], *, hidden: bool = False) -> TestOptions:
    """Return the options of ``("sensor.instance=1", "shots=50")``, ``("reference",)`` and the like.

    Args:
        texts: Texts of ``--test``.
        hidden: Whether to test on presses drawn from a secret seed.

    Raises:
        UserError: A text is not understood, or an option is given twice.
    """
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        kind, _, parameter = name.partition(".")
        if text == REFERENCE:
            continue
        if not equals and name != SHOTS:
            raise UserError(
                f"--test {text!r} is neither the word {REFERENCE!r} nor sensor.NAME=VALUE, for "
                "example sensor.instance=1, nor shots=N, nor data=FOLDER; "
                f"{did_you_mean(text, [REFERENCE, DATA, SHOTS])}"
            )
        if name not in (DATA, SHOTS) and (kind != "sensor" or not parameter):
            raise UserError(
                f"--test {text!r} changes no sensor; write sensor.NAME=VALUE, for example "
                "sensor.instance=1, or data=FOLDER; what the model is made with goes in --param."
            )
        if name in values:
            raise UserError(f"--test {name} is given twice; give it once.")
        values[name] = value
    folder, shots = values.pop(DATA, None), values.pop(SHOTS, "0")
    if folder == "":
        raise UserError("--test data= names no folder; write --test data=FOLDER.")
    parameters = {name.removeprefix("sensor."): value for name, value in values.items()}
    data = None if folder is None else Path(folder)
    return TestOptions(REFERENCE in texts, parameters, hidden, data, _read_shots(shots))


def _read_shots(text: str) -> int:
    if not text.isdecimal() or int(text) > MOST_SHOTS:
        raise UserError(
            f"--test shots={text} is no number of presses; write a whole number from 0 to "
            f"{MOST_SHOTS:,}, for example --test shots=50."
        )
    return int(text)
