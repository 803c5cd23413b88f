"""Muon: steps of equal size in every direction of a layer's matrix.

Jordan et al. 2024, "Muon: an optimizer for hidden layers in neural networks", with the step length
of Liu et al. 2025, "Muon is scalable for LLM training", which lets it take AdamW's learning rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import torch

_MOMENTUM = 0.95
_BETAS, _EPSILON = (0.9, 0.999), 1e-8
_SMALLEST = 10
"""A kernel of fewer rows or columns (the first and the last layer) has no directions to balance."""
_STEPS = 5
_A, _B, _C = 3.4445, -4.7750, 2.0315
"""x -> a x + b x^3 + c x^5 drives singular values of 0..1 to about 0.7..1.2 in five steps."""
_RMS = 0.2
"""Root mean square of an AdamW step at learning rate 1."""


class Muon(torch.optim.Optimizer):
    """Muon for kernels, AdamW for biases, scales and kernels of the first and last layer.

    A convolution's kernel is a matrix of output channels by everything else. Weight decay is
    decoupled, as in AdamW. The state holds tensors only. dtype: of the orthogonalisation, bfloat16
    where the machine computes in it.
    """

    def __init__(
        self,
        params: Iterable[dict[str, Any]],
        lr: float,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__(params, {"lr": lr, "weight_decay": 0.0})
        self._dtype = dtype

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """One step; ``closure`` is not used."""
        del closure
        for group in self.param_groups:
            for weight in group["params"]:
                if weight.grad is None:
                    continue
                state = self.state[weight]
                if min(_matrix(weight).shape) < _SMALLEST:
                    step = _adam(weight.grad, state)
                else:
                    step = _balanced(weight.grad, state, self._dtype)
                weight.mul_(1 - group["lr"] * group["weight_decay"])
                weight.add_(step, alpha=-group["lr"])


def _matrix(weight: torch.Tensor) -> torch.Tensor:
    return weight.flatten(1) if weight.ndim > 1 else weight.reshape(1, -1)


def _balanced(
    gradient: torch.Tensor, state: dict[str, torch.Tensor], dtype: torch.dtype
) -> torch.Tensor:
    momentum = state.setdefault("momentum", torch.zeros_like(gradient))
    momentum.lerp_(gradient, 1 - _MOMENTUM)
    matrix = _matrix(gradient.lerp(momentum, _MOMENTUM))  # Nesterov's
    length = _RMS * math.sqrt(max(matrix.shape))
    return (length * orthogonal(matrix, dtype)).reshape(gradient.shape)


def _adam(gradient: torch.Tensor, state: dict[str, torch.Tensor]) -> torch.Tensor:
    for name in ("first", "second"):
        state.setdefault(name, torch.zeros_like(gradient))
    count = state.setdefault("count", gradient.new_zeros(()))
    count += 1
    state["first"].lerp_(gradient, 1 - _BETAS[0])
    state["second"].lerp_(gradient.square(), 1 - _BETAS[1])
    first = state["first"] / (1 - _BETAS[0] ** count)
    second = state["second"] / (1 - _BETAS[1] ** count)
    step: torch.Tensor = first / (second.sqrt() + _EPSILON)
    return step


def orthogonal(matrix: torch.Tensor, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    """(R, C) U V^T of the singular value decomposition U S V^T, approximately, float32.

    In float32 the steps are taken on the small square matrix by whose polynomials they multiply:
    4 products of its size a step, not 2 with the long side. bfloat16, for which that would not be
    stable, takes them on the whole. Singular values below about 1e-3 of the norm end below 0.7.
    """
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonal(matrix.T, dtype).T
    x = matrix.float()
    x = (x / x.norm().clamp_min(1e-12)).to(dtype)
    if dtype == torch.bfloat16:
        for _ in range(_STEPS):
            square = x @ x.T
            x = torch.addmm(x, _B * square + _C * (square @ square), x, beta=_A)
        return x.float()
    gram = x @ x.T
    unit = torch.eye(len(gram), dtype=gram.dtype, device=gram.device)
    product = unit
    for _ in range(_STEPS):
        factor = _A * unit + _B * gram + _C * (gram @ gram)
        product = factor @ product
        gram = factor @ (factor @ gram)
    orthogonal_: torch.Tensor = product @ x
    return orthogonal_
