"""Checkpoint of a training, from which it continues after a kill; written after every epoch."""

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

    Shuffling and layer noise are functions of seed and epoch, and the learning rate is a function
    of the step, so no generator and no schedule is stored.

    Attributes:
        epoch: Number of epochs that are done.
        best_loss: The best validation loss; None where there is none.
        best_epoch: Number of epochs after which it was reached.
        seconds: Duration of the epochs, s.
        history: Loss and errors of every epoch.
        best: Weights with the best validation loss.
    """

    epoch: int = 0
    best_loss: float | None = None
    best_epoch: int = 0
    seconds: float = 0.0
    history: list[dict[str, float]] = field(default_factory=list)
    best: dict[str, torch.Tensor] = field(default_factory=dict)


def save_checkpoint(
    directory: Path,
    identity: str,
    state: TrainingState,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    mean: nn.Module | None = None,
) -> None:
    """Replace the checkpoint in the folder; the old one stays intact until then.

    Args:
        directory: Folder of the checkpoint.
        identity: Identity of the training.
        state: Progress of the training.
        network: The network.
        optimiser: Its optimiser.
        mean: Mean of the weights over the steps, where there is one.
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
    """Set network, optimiser and mean to their state in the checkpoint.

    Args:
        directory: Folder of the checkpoint.
        identity: Identity of the training.
        network: The network.
        optimiser: Its optimiser.
        mean: Mean of the weights over the steps, where there is one.

    Returns:
        The state of the checkpoint and None. Where it cannot be used, a fresh state and a sentence
        that tells why; nothing else is changed. Where there is none, a fresh state and None.
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
    """Set the state of an optimiser.

    Moments get the memory layout of their weight, because fused kernels read both in the same
    order.
    """
    weights = _weights(optimiser)
    for key, value in tensors.items():
        index, _, name = key.partition("/")
        weight = weights[int(index)]
        moment: Any = value.to(weight.device, copy=True)
        if value.shape == weight.shape:
            moment = torch.empty_like(weight, requires_grad=False).copy_(value)
        optimiser.state[weight][name] = moment
