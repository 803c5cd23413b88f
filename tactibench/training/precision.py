"""The arithmetic of a network that "auto" stands for on this machine.

It is part of the identity of weights, which is known before torch is imported. So torch is imported
only for a graphics card.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

_FLAGS = {"avx512_bf16", "amx_bf16", "bf16"}
"""Names of bf16 products in /proc/cpuinfo: the first two on x86, the last on ARM."""


def resolve_precision(precision: str, device: str) -> str:
    """Return "bf16" for "auto" where the device has instructions for it, else "float32".

    Other precisions are returned as they are. torch reports that oneDNN supports bf16 even where it
    has to emulate it, which is slower than float32. So the flags of the processor decide; where
    they cannot be read, it is float32.

    Args:
        precision: "auto", "bf16", "float32" or another precision.
        device: "cpu" or "cuda".
    """
    if precision != "auto":
        return precision
    if device == "cuda":
        import torch

        return "bf16" if torch.cuda.is_bf16_supported() else "float32"
    return "bf16" if _FLAGS & processor_flags() else "float32"


@cache
def processor_flags(path: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Return the instruction-set flags of the first processor; none where the file is missing."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return frozenset()
    for line in lines:
        name, _, flags = line.partition(":")
        if name.strip() in ("flags", "Features"):
            return frozenset(flags.split())
    return frozenset()
