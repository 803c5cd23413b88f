"""What was asked for, before anything is looked up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tactibench.errors import UserError

QUICK_FIT, QUICK_VALIDATION, QUICK_TEST, QUICK_EPOCHS = 200, 40, 40, 2
"""--quick: 200 training presses, 2 epochs, 40 test presses. It proves the path, nothing else."""


@dataclass(frozen=True)
class RunRequest:
    """The options of ``tactibench run``; None stands for the protocol's default.

    presses: learn from that many of the presses that the protocol's split trains on, for a learning
    curve; None: from all. The validation presses and those that a regime adds stay.
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
