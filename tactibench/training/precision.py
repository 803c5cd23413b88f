"""Which arithmetic a machine computes natively."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import torch

_FLAGS = {"avx512_bf16", "amx_bf16", "bf16"}
"""Names in /proc/cpuinfo of bf16 products: two on x86, the last on ARM."""


def resolve_precision(precision: str, device: str) -> str:
    """Turn "auto" into "bf16" where the device has instructions for it, else into "float32".

    torch says that oneDNN supports bf16 also where it has to emulate it, which is slower than
    float32; so the processor's own flags decide. Where they cannot be read: float32.
    """
    if precision != "auto":
        return precision
    if device == "cuda":
        return "bf16" if torch.cuda.is_bf16_supported() else "float32"
    return "bf16" if _FLAGS & processor_flags() else "float32"


@cache
def processor_flags(path: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Instruction-set flags of the first processor; empty where there is no such file."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return frozenset()
    for line in lines:
        name, _, flags = line.partition(":")
        if name.strip() in ("flags", "Features"):
            return frozenset(flags.split())
    return frozenset()


def autocast(precision: str, device: str) -> AbstractContextManager[Any]:
    """Mixed bf16 arithmetic for "bf16", nothing for "float32"."""
    if precision == "bf16":
        return torch.autocast(device, dtype=torch.bfloat16)
    return nullcontext()


@contextmanager
def repeatable(device: str, precision: str) -> Iterator[None]:
    """Let cuDNN choose only kernels that give the same bits twice.

    For "float32" it may not compute in TF32 either, whose 10 bits it takes for float32 by default.
    """
    if device != "cuda":
        yield
        return
    exact = precision == "float32"
    with torch.backends.cudnn.flags(
        enabled=True, benchmark=False, deterministic=True, allow_tf32=not exact
    ):
        yield
