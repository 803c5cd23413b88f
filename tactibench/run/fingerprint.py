"""On what machine a time was measured. Times are ranked only inside one fingerprint.

Nothing here imports torch of its own accord: its version is read from the installed distribution
and the graphics card from the driver, so the fingerprint does not depend on what was imported.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_FLAGS = ("amx_bf16", "amx_int8", "amx_tile", "avx2", "avx512_bf16", "avx512f", "avx512_vnni")
_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup/cpu.max")


def fingerprint(*, with_torch: bool = False) -> dict[str, Any]:
    """What determines speed on this machine, as JSON values.

    cpu, cpu_flags (matrix and vector units), cores_physical, cores_logical (those this process may
    use), memory_gib, gpu (names), os, python, torch (version). A value that cannot be found is
    None. with_torch: import torch to ask for a card that the driver's files do not show; it is
    asked in any case when it is already imported.
    """
    cpuinfo = _read(_PROC / "cpuinfo")
    cpus = _allowed_cpus()
    model, flags = cpu_of(cpuinfo)
    logical = _within_quota(len(cpus), _read(_CGROUP))
    physical = physical_cores(cpuinfo, cpus)
    return {
        "cpu": model or platform.processor() or platform.machine() or None,
        "cpu_flags": flags,
        "cores_physical": min(physical, logical) if physical else None,
        "cores_logical": logical,
        "memory_gib": _memory_gib(),
        "gpu": _gpus(with_torch=with_torch),
        "os": f"{platform.system()} {platform.machine()}",
        "python": ".".join(platform.python_version_tuple()[:2]),
        "torch": _torch_version(),
    }


def fingerprint_hash(found: dict[str, Any]) -> str:
    """12 hexadecimal digits that are equal only for equal fingerprints."""
    text = json.dumps(found, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def cpu_of(cpuinfo: str) -> tuple[str | None, list[str]]:
    """Model name and the telling flags of the first processor in the text of /proc/cpuinfo."""
    first = next(iter(_processors(cpuinfo)), {})
    have = set(first.get("flags", "").split())
    return first.get("model name"), [flag for flag in _FLAGS if flag in have]


def physical_cores(cpuinfo: str, cpus: set[int]) -> int | None:
    """Number of physical cores behind the given logical ones; None where the text does not say."""
    cores = {
        (one["physical id"], one["core id"])
        for one in _processors(cpuinfo)
        if int(one["processor"]) in cpus and "physical id" in one and "core id" in one
    }
    return len(cores) or None


def _processors(cpuinfo: str) -> list[dict[str, str]]:
    blocks = []
    for block in cpuinfo.split("\n\n"):
        fields = (line.partition(":") for line in block.splitlines())
        one = {name.strip(): value.strip() for name, colon, value in fields if colon}
        if "processor" in one:
            blocks.append(one)
    return blocks


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _allowed_cpus() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return set(os.sched_getaffinity(0))
    return set(range(os.cpu_count() or 1))


def _within_quota(count: int, cpu_max: str) -> int:
    """Logical cores under a cgroup's limit "QUOTA PERIOD" (microseconds), or "max PERIOD"."""
    quota, _, period = cpu_max.strip().partition(" ")
    if quota.isdigit() and period.isdigit() and int(period):
        return max(1, min(count, math.ceil(int(quota) / int(period))))
    return count


def _memory_gib() -> int | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, OSError, ValueError):
        return None


def _gpus(*, with_torch: bool) -> list[str]:
    cards = sorted((_PROC / "driver/nvidia/gpus").glob("*/information"))
    lines = [line for card in cards for line in _read(card).splitlines()]
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("Model:")]
    if names or not (with_torch or "torch" in sys.modules):
        return names
    import torch

    if not torch.cuda.is_available():
        return []
    return [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]


def _torch_version() -> str | None:
    try:
        return version("torch")
    except PackageNotFoundError:
        return None
