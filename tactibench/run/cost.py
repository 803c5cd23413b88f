"""What a model costs beside time: weights, operations, memory."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tactibench.contacts import Frame
from tactibench.plugins.base import Model

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
"""Written to clear_refs it sets the peak of the resident memory to what it is now (proc(5))."""


class PeakMemory:
    """Largest resident memory of this process inside the block, in MB (10^6 bytes).

    mb: None where the system does not tell it. Where the kernel cannot reset its count, the peak is
    that of the whole life of the process.
    """

    mb: float | None = None


@contextmanager
def peak_memory() -> Iterator[PeakMemory]:
    """Watch the memory of this process; the figure is there after the block."""
    found = PeakMemory()
    with suppress(OSError):  # another system, or a kernel without it
        _RESET.write_text(_RESET_PEAK)
    yield found
    found.mb = _peak_mb()


def cost(model: Model, frame: Frame) -> dict[str, int | None]:
    """Return "parameters" and "flops_per_frame" of a model; None for what it does not know."""
    return {"parameters": model.parameter_count(), "flops_per_frame": model.flops(frame)}


def _peak_mb() -> float | None:
    try:
        lines = _STATUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return _peak_of_life_mb()
    kib = [int(line.split()[1]) for line in lines if line.startswith("VmHWM:")]
    return 1.024e-3 * kib[0] if kib else _peak_of_life_mb()


def _peak_of_life_mb() -> float | None:
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return 1e-6 * unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
