"""The arithmetic of a network that "auto" stands for on this machine.

It is part of the identity of weights, which is known before torch is imported; so torch is asked
of a graphics card only.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

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
        import torch

        return "bf16" if torch.cuda.is_bf16_supported() else "float32"
    return "bf16" if _FLAGS & processor_flags() else "float32"


@cache
def processor_flags(path: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Return the instruction-set flags of the first processor; none where there is no such file."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return frozenset()
    for line in lines:
        name, _, flags = line.partition(":")
        if name.strip() in ("flags", "Features"):
            return frozenset(flags.split())
    return frozenset()
