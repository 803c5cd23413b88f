"""Which arithmetic a machine computes natively."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch


def resolve_precision(precision: str, device: str) -> str:
    """Turn "auto" into "bf16" where the device has instructions for it, else into "float32".

    On a CPU that is avx512_bf16 or AMX, as oneDNN reports it; emulated bf16 is slower than float32.
    """
    if precision != "auto":
        return precision
    if device == "cuda":
        return "bf16" if torch.cuda.is_bf16_supported() else "float32"
    return "bf16" if torch.ops.mkldnn._is_mkldnn_bf16_supported() else "float32"


def autocast(precision: str, device: str) -> AbstractContextManager[Any]:
    """Mixed bf16 arithmetic for "bf16", nothing for "float32"."""
    if precision == "bf16":
        return torch.autocast(device, dtype=torch.bfloat16)
    return nullcontext()
