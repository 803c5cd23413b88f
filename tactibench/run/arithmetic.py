"""The arithmetic in which a network may compute: what ``configured`` offers, and types beside it.

``configured`` holds ways that are worth timing on a machine. What another type of number does to
the answers can be asked of any machine, also of one that only emulates it.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from tactibench.contacts import Frame
from tactibench.errors import UserError
from tactibench.plugins.base import Model
from tactibench.run.configurations import COMPILED
from tactibench.run.latency import Stage

if TYPE_CHECKING:
    import torch

    from tactibench.training import LearnedModel

TYPES = {
    "float64": "float64 throughout the network",
    "bf16": "bf16 products (autocast), normalisation folded, channels_last",
    "fp16": "fp16 products (autocast), normalisation folded, channels_last",
}
"""Name -> what it is; of any model that is one network."""
OWN = "default"
"""Of a model without a choice: as it computes."""

Make = Callable[[Sequence[Frame]], Sequence[Stage]]


def ways(
    model: Model, *, compiled: bool = False
) -> tuple[dict[str, tuple[str, Make]], dict[str, str]]:
    """Name -> (words, what makes the stages ready for frames), and name -> why it is left out.

    A way that the model configures goes before the type of number of its name, which stands in
    where this machine cannot go that way: what a type does to the answers can be asked anywhere.
    Making raises UserError with the reason where this machine or model cannot.
    """
    from tactibench.training import LearnedModel

    found: dict[str, tuple[str, Make]] = {}
    skipped: dict[str, str] = {}
    if model.configurations:
        configured = model.configurations
        found = {name: (words, _configured(model, name)) for name, words in configured.items()}
    else:
        found[OWN] = (model.timed_as, lambda _: model.stages())
    if isinstance(model, LearnedModel):
        for name, words in TYPES.items():
            typed = _typed(model, name)
            own = found.get(name)
            found[name] = (words, typed) if own is None else (own[0], _or_else(own[1], typed))
    else:
        reason = "the model is no network of tactibench.training, whose numbers could be changed"
        skipped = {name: reason for name in TYPES if name not in found}
    if COMPILED in found and not compiled:
        del found[COMPILED]
        skipped[COMPILED] = "it takes long to make; add --compile"
    return found, skipped


def _configured(model: Model, name: str) -> Make:
    return lambda frames: model.configured(name, frames)


def _or_else(make: Make, other: Make) -> Make:
    def made(frames: Sequence[Frame]) -> Sequence[Stage]:
        try:
            return make(frames)
        except UserError:
            return other(frames)

    return made


def _typed(model: LearnedModel, name: str) -> Make:
    return lambda _: typed_stages(model, name)


def typed_stages(model: LearnedModel, name: str) -> list[Stage]:
    """Phases of a learned model whose network computes in one of TYPES.

    What comes before and after the network is computed as always.
    """
    return [
        ("preprocess", model.inputs),
        ("forward", _wide(model) if name == "float64" else _narrow(model, name)),
        ("decode", model.answers),
    ]


def _narrow(model: LearnedModel, name: str) -> Callable[[torch.Tensor], Any]:
    """Mixed arithmetic: products in 16 bits, sums in 32, as autocast divides them."""
    import torch

    device = model.context.device
    kind = {"bf16": torch.bfloat16, "fp16": torch.float16}[name]
    try:
        with torch.no_grad():
            network = model.fold(model.network, "bf16" if name == "bf16" else "float32")
    except RuntimeError as error:
        raise UserError(f"its network cannot be folded for {name}: {error}") from error

    def forward(inputs: torch.Tensor) -> Any:
        with torch.inference_mode(), torch.autocast(device, dtype=kind):
            raw = network(inputs.to(device))
        return model.outputs(raw)

    return forward


def _wide(model: LearnedModel) -> Callable[[torch.Tensor], Any]:
    """A copy with all weights in float64; where the network asks for float32 it is given more."""
    import torch
    from torch.overrides import TorchFunctionMode

    class Wider(TorchFunctionMode):
        def __torch_function__(
            self, function: Any, _types: Any, args: Any = (), kwargs: Any = None
        ) -> Any:
            if function is torch.Tensor.float:
                function = torch.Tensor.double
            return function(*args, **(kwargs or {}))

    device = model.context.device
    network = copy.deepcopy(model.network).double().eval()

    def forward(inputs: torch.Tensor) -> Any:
        given = inputs.to(device)
        with torch.inference_mode(), Wider():
            raw = network(given.double() if given.is_floating_point() else given)
            return model.outputs(raw)

    return forward
