"""What a training needs to go on after a kill, written after every epoch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from tactibench.training.container import DamagedFile, read_container, write_container

FILE = "checkpoint.safetensors"
_SCHEMA = 1


@dataclass
class TrainingState:
    """Where a training stands after ``epoch`` epochs. best: weights with the best validation loss.

    Shuffling and layer noise are functions of seed and epoch and the learning rate is one of the
    step, so there is no generator and no schedule to store.
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
    """Replace the checkpoint in the folder; the one before stays whole until then.

    mean: of the weights over the steps, where there is one.
    """
    directory.mkdir(parents=True, exist_ok=True)
    tensors = {f"network/{name}": value for name, value in network.state_dict().items()}
    if mean is not None:
        tensors |= {f"mean/{name}": value for name, value in mean.state_dict().items()}
    tensors |= {f"best/{name}": value for name, value in state.best.items()}
    tensors |= {f"optimiser/{name}": value for name, value in _optimiser_tensors(optimiser)}
    header = {
        "schema": _SCHEMA,
        "identity": identity,
        "epoch": state.epoch,
        "best_loss": state.best_loss,
        "best_epoch": state.best_epoch,
        "seconds": state.seconds,
        "history": state.history,
    }
    write_container(directory / FILE, tensors, header)


def load_checkpoint(
    directory: Path,
    identity: str,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    mean: nn.Module | None = None,
) -> tuple[TrainingState, str | None]:
    """Put network, optimiser and mean where the checkpoint left them.

    Returns the state and None; or a fresh state, nothing else touched, with a sentence that says
    why a checkpoint that is there was not used (None where there is none).
    """
    try:
        tensors, header = read_container(directory / FILE)
    except FileNotFoundError:
        return TrainingState(), None
    except DamagedFile as error:
        return TrainingState(), f"the checkpoint in {directory} was ignored: {error}"
    if header.get("schema") != _SCHEMA or header.get("identity") != identity:
        return TrainingState(), f"the checkpoint in {directory} was ignored: it is of another run"
    parts = _split(tensors)
    network.load_state_dict(parts["network"])
    _restore_optimiser(optimiser, parts["optimiser"])
    if mean is not None:
        mean.load_state_dict(parts["mean"])
    return (
        TrainingState(
            epoch=header["epoch"],
            best_loss=header["best_loss"],
            best_epoch=header["best_epoch"],
            seconds=header["seconds"],
            history=header["history"],
            best=parts["best"],
        ),
        None,
    )


def _split(tensors: dict[str, torch.Tensor]) -> dict[str, dict[str, torch.Tensor]]:
    names = ("network", "mean", "best", "optimiser")
    parts: dict[str, dict[str, torch.Tensor]] = {name: {} for name in names}
    for key, tensor in tensors.items():
        part, _, name = key.partition("/")
        parts[part][name] = tensor
    return parts


def _weights(optimiser: torch.optim.Optimizer) -> list[torch.Tensor]:
    return [weight for group in optimiser.param_groups for weight in group["params"]]


def _optimiser_tensors(optimiser: torch.optim.Optimizer) -> Iterator[tuple[str, torch.Tensor]]:
    for index, weight in enumerate(_weights(optimiser)):
        for key, value in optimiser.state.get(weight, {}).items():
            yield f"{index}/{key}", value


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
