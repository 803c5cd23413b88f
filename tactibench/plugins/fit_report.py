"""The report of a training, and what its model knew before."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, get_args

Prior = Literal["none", "plain addition", "nominal mechanics", "fitted to multi-contact labels"]
"""Knowledge that a model has, besides its frames, of contacts that press together: none; that their
displacements add up; the mechanics of a nominal sensor; a law that was fitted to labelled presses
with several contacts, those of its own training included."""
PRIORS: tuple[Prior, ...] = get_args(Prior)


@dataclass(frozen=True)
class FitReport:
    """Summary of a training.

    Attributes:
        epochs: Number of epochs, those before an interruption included.
        seconds: Time spent in this and earlier calls.
        resumed_from: Epoch of the checkpoint from which training went on; 0: from the start.
        history: One mapping per epoch.
        notes: JSON values for the record.
        prior: What the model knew of contacts that press together, see ``Prior``. A board shows it
            in a column; None stands there as "not stated".
    """

    epochs: int = 0
    seconds: float = 0.0
    resumed_from: int = 0
    history: tuple[dict[str, float], ...] = ()
    notes: dict[str, Any] = field(default_factory=dict)
    prior: Prior | None = None
