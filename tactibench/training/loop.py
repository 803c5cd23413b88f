"""The training loop of all learned models: deterministic and resumable.

Steps at a high learning rate circle the minimum that they have reached; their mean lies inside the
circle (Polyak and Juditsky 1992; for networks Izmailov et al. 2018, "Averaging weights leads to
wider optima and better generalization"). Averaged weights have no statistics of batch normalisation
of their own, and running averages over the last few batches would bias the predictions of a network
that reads an absolute depth. So the statistics are measured over many frames ("precise" batch
normalisation, Wu and Johnson 2021, Rethinking "Batch" in BatchNorm).

A checkpoint, from which a training continues after a kill, is written after every epoch.

``Muon`` makes steps of equal size in every direction of a layer's matrix:
Jordan et al. 2024, "Muon: an optimizer for hidden layers in neural networks", with the step length
of Liu et al. 2025, "Muon is scalable for LLM training", which makes AdamW's learning rate fit.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn.modules.batchnorm import _BatchNorm
from torch.optim.swa_utils import AveragedModel

from tactibench.errors import UserError
from tactibench.plugins import FitReport, Progress
from tactibench.training.inference import autocast, deterministic_kernels
from tactibench.training.recipe import Recipe, Seeds, torch_seed
from tactibench.training.targets import Examples
from tactibench.training.weights import DamagedFileError, read_container, write_container

_MOMENTUM = 0.95
"""As published with the method (Jordan, 2024)."""
_SMALLEST = 10
"""A kernel with fewer rows or columns (first and last layer) has no directions to balance."""
_STEPS = 5
"""Number of Newton-Schulz steps for which the coefficients below are made."""
_A, _B, _C = 3.4445, -4.7750, 2.0315
"""x -> a x + b x^3 + c x^5 drives singular values of 0..1 to about 0.7..1.2 in five steps."""
_RMS = 0.2
"""Root mean square of an AdamW step at learning rate 1."""


class Muon(torch.optim.Optimizer):
    """Muon for kernels, AdamW for biases, scales and kernels of the first and last layer.

    A convolution's kernel is a matrix of output channels by everything else. Weight decay is
    decoupled, as in AdamW. The state holds tensors only.

    Args:
        params: Groups of weights.
        lr: Learning rate.
        dtype: Type of the orthogonalisation, bfloat16 where the machine computes in it.
    """

    def __init__(
        self,
        params: Iterable[dict[str, Any]],
        lr: float,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__(params, {"lr": lr, "weight_decay": 0.0})
        self._dtype = dtype
        small = [
            group | {"params": [w for w in group["params"] if not _has_directions(w)]}
            for group in self.param_groups
        ]
        self._small = torch.optim.AdamW(small, fused=True)
        self._small.state = self.state  # both share one state, for checkpoints

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """Take one step; ``closure`` is not used."""
        del closure
        for group, small in zip(self.param_groups, self._small.param_groups, strict=True):
            small["lr"] = group["lr"]
            large = [w for w in group["params"] if w.grad is not None and _has_directions(w)]
            momenta = [_momentum(weight.grad, self.state[weight]) for weight in large]
            for weight, even in zip(large, orthogonalise(momenta, self._dtype), strict=True):
                length = _RMS * math.sqrt(max(even.shape))
                weight.mul_(1 - group["lr"] * group["weight_decay"])
                weight.add_(even.reshape(weight.shape), alpha=-group["lr"] * length)
        self._small.step()


def _has_directions(weight: torch.Tensor) -> bool:
    return min(_matrix(weight).shape) >= _SMALLEST


def _matrix(weight: torch.Tensor) -> torch.Tensor:
    return weight.flatten(1) if weight.ndim > 1 else weight.reshape(1, -1)


def _momentum(gradient: torch.Tensor, state: dict[str, torch.Tensor]) -> torch.Tensor:
    """Return Nesterov's momentum as a matrix, and update the momentum in the state."""
    momentum = state.setdefault("momentum", torch.zeros_like(gradient))
    momentum.lerp_(gradient, 1 - _MOMENTUM)
    return _matrix(gradient.lerp(momentum, _MOMENTUM))


def orthogonalise(
    matrices: Sequence[torch.Tensor], dtype: torch.dtype = torch.float32
) -> list[torch.Tensor]:
    """Return U V^T (R, C) of each matrix's singular value decomposition U S V^T, approximately.

    The results are float32, in the order of the matrices.

    In float32 the steps are computed on the small square Gram matrices, whose polynomials multiply
    the matrices, and on all matrices of one size together: a step takes 4 products of that size,
    not 2 with the long side. In bfloat16 that would not be stable, so the steps are computed on the
    full matrices. Singular values below about 1e-3 of the norm end below 0.7.
    """
    wide = [matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T for matrix in matrices]
    scaled = [x / x.norm().clamp_min(1e-12) for x in (matrix.float() for matrix in wide)]
    even = _iterate_whole(scaled) if dtype == torch.bfloat16 else _iterate_gram(scaled)
    return [x if x.shape == matrix.shape else x.T for x, matrix in zip(even, matrices, strict=True)]


def _iterate_whole(matrices: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    even = []
    for matrix in matrices:
        x = matrix.to(torch.bfloat16)
        for _ in range(_STEPS):
            square = x @ x.T
            x = torch.addmm(x, _B * square + _C * (square @ square), x, beta=_A)
        even.append(x.float())
    return even


def _iterate_gram(matrices: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    even = list(matrices)
    for side in sorted({len(matrix) for matrix in matrices}):
        rows = [row for row, matrix in enumerate(matrices) if len(matrix) == side]
        gram = torch.stack([matrices[row] @ matrices[row].T for row in rows])
        unit = torch.eye(side, dtype=gram.dtype, device=gram.device)
        product = unit.expand_as(gram)
        for _ in range(_STEPS):
            factor = _A * unit + _B * gram + _C * (gram @ gram)
            product = factor @ product
            gram = factor @ (factor @ gram)
        for row, polynomial in zip(rows, product, strict=True):
            even[row] = polynomial @ matrices[row]
    return even


_RAMP = 10
"""The mean after n steps reaches back over about a ninth of them, so it forgets the start."""


def average_weights(network: nn.Module, decay: float) -> AveragedModel:
    """Return an exponential moving average of a network's weights, with a decay per step.

    Its ``update_parameters`` adds the weights of a step. Its ``module`` is a network with the mean
    weights; the statistics of batch normalisation in it are those of the last step until they are
    measured.
    """

    def update(mean: Any, weights: Any, count: torch.Tensor | int) -> None:
        steps = int(count)
        share = min(decay, (1 + steps) / (_RAMP + steps))
        torch._foreach_lerp_(mean, weights, 1 - share)

    mean = AveragedModel(network, multi_avg_fn=update)
    return mean.eval().requires_grad_(requires_grad=False)


@torch.no_grad()
def measure_statistics(
    network: nn.Module,
    batches: Iterable[torch.Tensor],
    forward: Callable[[nn.Module, torch.Tensor], torch.Tensor],
) -> None:
    """Replace the running statistics of batch normalisation by plain means over batches of images.

    Args:
        network: A network that is changed in place; nothing happens where it has no batch
            normalisation.
        batches: Batches of images.
        forward: forward(network, images), the pass in the arithmetic of the training.
    """
    layers = [module for module in network.modules() if isinstance(module, _BatchNorm)]
    if not layers:
        return
    momenta = [layer.momentum for layer in layers]
    for layer in layers:
        layer.reset_running_stats()
        layer.momentum = None
        layer.train()
    for images in batches:
        forward(network, images)
    for layer, momentum in zip(layers, momenta, strict=True):
        layer.momentum = momentum


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


Loss = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
ErrorMm = Callable[[torch.Tensor, npt.NDArray[np.int64]], float | None]

_DECODED = 200
"""Validation frames that are decoded for the error in mm after each epoch."""
_STATISTICS = 512
"""Training frames over which the statistics of batch normalisation are measured. 256 frames that
are spread evenly (``Examples.spread_rows``) move the U-Net's error by 1 %, 512 random ones by
14 %."""
_EVALUATION_BATCH = 50
"""Frames of a validation batch, to bound the memory."""


@dataclass(frozen=True)
class _Place:
    """The device and the arithmetic in which the network computes.

    Attributes:
        device: "cpu" or "cuda".
        precision: "float32" or "bf16".
    """

    device: str
    precision: str

    def outputs(self, network: nn.Module, images: torch.Tensor) -> torch.Tensor:
        """Return the float32 outputs of a forward pass.

        Every pass has its own autocast, because autocast caches the weights that it has cast.
        """
        with autocast(self.precision, self.device):
            outputs: torch.Tensor = network(images)
        return outputs.float()


@dataclass(frozen=True, eq=False)
class _Training:
    """Everything that all epochs of a training use.

    Attributes:
        network: The network that takes the steps.
        mean: Mean of the weights over the steps; None where the last weights are taken.
        optimiser: Optimiser of the network.
        recipe: Schedule of the training.
        loss: loss(outputs, targets).
        seeds: Seeds of the training.
        place: Device and arithmetic.
        examples: Training examples.
    """

    network: nn.Module
    mean: AveragedModel | None
    optimiser: torch.optim.Optimizer
    recipe: Recipe
    loss: Loss
    seeds: Seeds
    place: _Place
    examples: Examples

    @property
    def result(self) -> nn.Module:
        """The network that is the result of the training."""
        return self.network if self.mean is None else self.mean.module

    def batches(self, epoch: int) -> tuple[torch.Tensor, ...]:
        """Return the rows of the examples, batch by batch, in the order of an epoch."""
        order = torch.from_numpy(self.seeds.permutation(len(self.examples), epoch))
        return torch.split(order, self.recipe.batch)

    @cached_property
    def _representative(self) -> torch.Tensor:
        return self.examples.spread_rows(_STATISTICS)

    def measure_statistics(self) -> None:
        """Measure the statistics of the mean network over batches, each of them spread evenly."""
        rows = self._representative
        count = -(-len(rows) // self.recipe.batch)
        batches = (rows[first::count] for first in range(count))
        images = (self.examples.take(batch, self.place.device)[0] for batch in batches)
        measure_statistics(self.result, images, self.place.outputs)


def train(
    network: nn.Module,
    training: Examples,
    validation: Examples,
    *,
    recipe: Recipe,
    loss: Loss,
    error_mm: ErrorMm,
    seeds: Seeds,
    identity: Mapping[str, Any],
    progress: Progress,
    device: str = "cpu",
    checkpoints: Path | None = None,
) -> FitReport:
    """Train ``network`` in place; it ends in float32, evaluation mode, on the device.

    With ``checkpoints`` the state is stored after every epoch. The same call then continues from it
    and ends with bit-identical weights (on the same machine, with the same number of threads and
    version of torch). A damaged checkpoint or one of another training is not used, and
    ``notes["checkpoint"]`` tells that. On resuming, ``progress.epoch`` is called for the epochs
    that were done before.

    Args:
        network: A freshly initialised network, from (B, ...) images to outputs.
        training: Examples to learn from.
        validation: Examples for the loss and error after each epoch; may be empty.
        recipe: Schedule of the training.
        loss: loss(outputs, targets), a scalar from raw outputs (logits).
        error_mm: error_mm(outputs, rows), the mean position error of these rows of the validation
            set, mm, or None.
        seeds: Seeds of the training.
        identity: JSON values that determine the weights, together with recipe, seeds and data
            (architecture, parameters).
        progress: Is told of every step and epoch.
        device: "cpu" or "cuda".
        checkpoints: Folder of the checkpoint; None for no checkpoint.

    Raises:
        UserError: The loss is not finite.
    """
    place = _Place(device, recipe.precision)
    layout = torch.channels_last if recipe.channels_last else torch.contiguous_format
    network.to(device=device, memory_format=layout)  # type: ignore[call-overload]
    run = _Training(
        network=network,
        mean=average_weights(network, recipe.average) if recipe.average else None,
        optimiser=_optimiser(network, recipe, place.precision),
        recipe=recipe,
        loss=loss,
        seeds=seeds,
        place=place,
        examples=training.to(device),
    )
    key = _key(identity, recipe, place, seeds, training, validation)
    state, warning = TrainingState(), None
    if checkpoints is not None:
        state, warning = load_checkpoint(checkpoints, key, network, run.optimiser, run.mean)
    resumed = state.epoch
    validation = validation.to(device)

    progress.start(recipe.epochs, -(-len(training) // recipe.batch))
    for row in state.history:
        progress.epoch(int(row["epoch"]), row["loss"], row.get("validation_mm"))
    with deterministic_kernels(device, place.precision):
        while state.epoch < recipe.epochs and not _stalled(state, recipe):
            start = time.perf_counter()
            row = {"epoch": float(state.epoch + 1)}
            row["loss"] = _train_epoch(run, state.epoch, progress)
            row |= _validate(run, validation, error_mm)
            state.epoch += 1
            _keep_best(state, row, run.result, recipe)
            row["seconds"] = time.perf_counter() - start
            state.seconds += row["seconds"]
            state.history.append(row)
            if checkpoints is not None:
                save_checkpoint(checkpoints, key, state, network, run.optimiser, run.mean)
            progress.epoch(state.epoch, row["loss"], row.get("validation_mm"))

    network.load_state_dict(state.best or run.result.state_dict())
    network.eval()
    notes: dict[str, Any] = {"precision": place.precision}
    if recipe.patience is not None and state.best:
        notes["best_epoch"] = state.best_epoch
    if warning is not None:
        notes["checkpoint"] = warning
    return FitReport(state.epoch, state.seconds, resumed, tuple(state.history), notes)


def _train_epoch(run: _Training, epoch: int, progress: Progress) -> float:
    """Pass once over the training frames and return the mean loss of a frame.

    Raises:
        UserError: The loss is not finite.
    """
    run.network.train()
    batches = run.batches(epoch)
    total = 0.0
    with torch_seed(run.seeds.of_epoch(epoch), run.place.device):
        for number, rows in enumerate(batches):
            step, steps = epoch * len(batches) + number, run.recipe.epochs * len(batches)
            for group in run.optimiser.param_groups:
                group["lr"] = run.recipe.rate(step, steps)
            images, targets = run.examples.take(rows, run.place.device)
            run.optimiser.zero_grad(set_to_none=True)
            value = run.loss(run.place.outputs(run.network, images), targets)
            value.backward()  # type: ignore[no-untyped-call]
            run.optimiser.step()
            if run.mean is not None:
                run.mean.update_parameters(run.network)
            current = value.item()
            if not math.isfinite(current):
                raise UserError(
                    f"the training loss is {current} in epoch {epoch + 1}; train with "
                    "precision=float32 or another seed."
                )
            total += current * len(rows)
            progress.step(current)
        if run.mean is not None:
            run.measure_statistics()
    return total / len(run.examples)


@torch.inference_mode()
def _validate(run: _Training, validation: Examples, error_mm: ErrorMm) -> dict[str, float]:
    """Return validation loss and position error.

    The error is that of at most 200 frames spread evenly. The loss is that of all frames where it
    can stop the training, otherwise that of the same frames.
    """
    if not len(validation):
        return {}
    network, place = run.result.eval(), run.place
    count = len(validation)
    decoded = np.unique(np.linspace(0, count - 1, min(count, _DECODED)).round().astype(np.int64))
    rows = decoded if run.recipe.patience is None else np.arange(count)
    outputs, targets = [], []
    for batch in torch.split(torch.from_numpy(rows), _EVALUATION_BATCH):
        images, wanted = validation.take(batch, place.device)
        outputs.append(place.outputs(network, images))
        targets.append(wanted)
    output = torch.cat(outputs)
    loss = {"validation_loss": float(run.loss(output, torch.cat(targets)))}
    places = torch.from_numpy(np.searchsorted(rows, decoded)).to(place.device)
    error = error_mm(output[places], decoded)
    return loss if error is None else {**loss, "validation_mm": error}


def _keep_best(
    state: TrainingState, row: dict[str, float], network: nn.Module, recipe: Recipe
) -> None:
    if recipe.patience is None or "validation_loss" not in row:
        return
    if state.best_loss is None or row["validation_loss"] < state.best_loss:
        state.best_loss, state.best_epoch = row["validation_loss"], state.epoch
        state.best = {name: value.clone() for name, value in network.state_dict().items()}


def _stalled(state: TrainingState, recipe: Recipe) -> bool:
    if recipe.patience is None or state.best_loss is None:
        return False
    return state.epoch - state.best_epoch >= recipe.patience


def _optimiser(network: nn.Module, recipe: Recipe, precision: str) -> torch.optim.Optimizer:
    """Return the optimiser; weight decay acts on kernels, not on biases and normalisations."""
    kernels = [weight for weight in network.parameters() if weight.ndim > 1]
    others = [weight for weight in network.parameters() if weight.ndim <= 1]
    groups = [
        {"params": kernels, "weight_decay": recipe.weight_decay},
        {"params": others, "weight_decay": 0.0},
    ]
    if recipe.optimiser == "muon":
        dtype = torch.bfloat16 if precision == "bf16" else torch.float32
        return Muon(groups, lr=recipe.learning_rate, dtype=dtype)
    kind = torch.optim.AdamW if recipe.optimiser == "adamw" else torch.optim.Adam
    return kind(groups, lr=recipe.learning_rate, fused=True)


def _key(
    identity: Mapping[str, Any],
    recipe: Recipe,
    place: _Place,
    seeds: Seeds,
    training: Examples,
    validation: Examples,
) -> str:
    facts = {
        "identity": dict(identity),
        "recipe": asdict(recipe),
        "place": asdict(place),
        "seeds": asdict(seeds),
        "torch": torch.__version__,
        "threads": torch.get_num_threads(),
    }
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    digest.update(training.bits())
    digest.update(validation.bits())
    return digest.hexdigest()
