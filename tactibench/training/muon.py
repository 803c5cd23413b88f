"""Muon: steps of equal size in every direction of a layer's matrix.

Jordan et al. 2024, "Muon: an optimizer for hidden layers in neural networks", with the step length
of Liu et al. 2025, "Muon is scalable for LLM training", which makes AdamW's learning rate fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch

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
