"""Checkpoint of a training: all that it needs to go on after a kill, written after every epoch."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from tactibench.training.weights import DamagedFileError, read_container, write_container

FILE = "checkpoint.safetensors"
_SCHEMA = 1


@dataclass
class TrainingState:
    """Progress of a training after ``epoch`` epochs.

    Shuffling and layer noise are functions of seed and epoch and the learning rate is one of the
    step, so there is no generator and no schedule to store.
    """

    epoch: int = 0
    best_loss: float | None = None
    best_epoch: int = 0
    seconds: float = 0.0
    history: list[dict[str, float]] = field(default_factory=list)
    best: dict[str, torch.Tensor] = field(default_factory=dict)
    """Weights with the best validation loss."""


def save_checkpoint(
    directory: Path,
    identity: str,
    state: TrainingState,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    mean: nn.Module | None = None,
) -> None:
    """Replace the checkpoint in the folder; the one before stays whole until then.

    mean: of the weights over the steps, where there is one.
    """
    groups = {
        "network": network.state_dict(),
        "mean": {} if mean is None else mean.state_dict(),
        "best": state.best,
        "optimiser": {
            f"{index}/{name}": value
            for index, weight in enumerate(_weights(optimiser))
            for name, value in optimiser.state.get(weight, {}).items()
        },
    }
    tensors = {
        f"{group}/{name}": value for group, named in groups.items() for name, value in named.items()
    }
    facts = {name: value for name, value in vars(state).items() if name != "best"}
    write_container(directory / FILE, tensors, {"schema": _SCHEMA, "identity": identity, **facts})


def load_checkpoint(
    directory: Path,
    identity: str,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    mean: nn.Module | None = None,
) -> tuple[TrainingState, str | None]:
    """Put network, optimiser and mean where the checkpoint left them.

    Returns:
        The state and None; or a fresh state, nothing else touched, with a sentence that says why
        a checkpoint that is there was not used (None where there is none).
    """
    try:
        tensors, header = read_container(directory / FILE)
    except FileNotFoundError:
        return TrainingState(), None
    except DamagedFileError as error:
        return TrainingState(), f"the checkpoint was ignored: {error}"
    if header.pop("schema", None) != _SCHEMA or header.pop("identity", None) != identity:
        return TrainingState(), "the checkpoint was ignored: it is of another run"
    groups: dict[str, dict[str, torch.Tensor]] = {
        group: {} for group in ("network", "mean", "best", "optimiser")
    }
    for key, tensor in tensors.items():
        group, _, name = key.partition("/")
        groups[group][name] = tensor
    network.load_state_dict(groups["network"])
    _restore_optimiser(optimiser, groups["optimiser"])
    if mean is not None:
        mean.load_state_dict(groups["mean"])
    return TrainingState(**header, best=groups["best"]), None


def _weights(optimiser: torch.optim.Optimizer) -> list[torch.Tensor]:
    return [weight for group in optimiser.param_groups for weight in group["params"]]


def _restore_optimiser(optimiser: torch.optim.Optimizer, tensors: dict[str, torch.Tensor]) -> None:
    """Moments take the memory layout of their weight: fused kernels walk both in step."""
    weights = _weights(optimiser)
    for key, value in tensors.items():
        index, _, name = key.partition("/")
        weight = weights[int(index)]
        moment: Any = value.to(weight.device, copy=True)
        if value.shape == weight.shape:
            moment = torch.empty_like(weight, requires_grad=False).copy_(value)
        optimiser.state[weight][name] = moment
