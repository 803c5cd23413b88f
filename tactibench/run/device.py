"""On what a run computes; decided without importing torch wherever that is possible."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from tactibench.errors import UserError
from tactibench.run.fingerprint import fingerprint

_NODES = ("/dev/nvidiactl", "/proc/driver/nvidia/gpus", "/dev/dxg", "/dev/kfd")
"""What the drivers of a card put there on Linux: NVIDIA's, that of WSL, AMD's."""


def cuda_possible(nodes: tuple[str, ...] = _NODES, platform: str = sys.platform) -> bool:
    """Whether torch could find a card. False is certain; True has to be asked of torch."""
    if platform == "darwin":
        return False
    return platform != "linux" or any(Path(node).exists() for node in nodes)


def choose_device(asked: str) -> str:
    """ "cpu" or "cuda". Raises UserError for a card that is not there."""
    if asked == "cpu":
        return "cpu"
    if _cuda_there():
        return "cuda"
    if asked == "cuda":
        raise UserError("--device cuda was asked for, but torch finds no GPU; use --device cpu.")
    return "cpu"


def machine() -> dict[str, Any]:
    """The fingerprint of this machine, the same whether or not torch has been imported."""
    return fingerprint(with_torch=cuda_possible())


def _cuda_there() -> bool:
    if not cuda_possible():
        return False
    import torch

    return bool(torch.cuda.is_available())
