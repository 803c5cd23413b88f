"""The machine that a run computes on: its fingerprint, its device, and the versions of packages.

Times are ranked only within one fingerprint. Torch is not imported where that can be avoided: its
version is read from the installed distribution and the graphics card from the driver, so that the
fingerprint does not depend on what was imported.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from tactibench import __version__
from tactibench.errors import UserError
from tactibench.plugins import installed
from tactibench.records import code_hash, installed_versions

PACKAGES = ("numpy", "scipy", "torch", "opencv-contrib-python-headless", "tactibench")
"""Packages whose versions a record holds."""
FLAGS = ("amx_bf16", "amx_int8", "amx_tile", "avx2", "avx512_bf16", "avx512f", "avx512_vnni")
"""Matrix and vector units that determine how fast a network is."""
_DRIVER_NODES = ("/dev/nvidiactl", "/proc/driver/nvidia/gpus", "/dev/dxg", "/dev/kfd")
"""Files that the drivers of a card make on Linux: two of NVIDIA, one of WSL, one of AMD."""
_POOLS = (
    ("torch", "get_num_threads", "set_num_threads"),
    ("cv2", "getNumThreads", "setNumThreads"),
    ("numba", "get_num_threads", "set_num_threads"),
)
"""Modules with threads of their own, and the functions that tell and set their number."""
_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup/cpu.max")


def choose_device(requested: str) -> str:
    """Return "cpu" or "cuda".

    Args:
        requested: "auto", "cpu" or "cuda"; "auto" is cuda where torch finds a card.

    Raises:
        UserError: "cuda" is requested, but torch finds no card.
    """
    if requested == "cpu":
        return "cpu"
    if _has_cuda():
        return "cuda"
    if requested == "cuda":
        raise UserError("--device cuda was asked for, but torch finds no GPU; use --device cpu.")
    return "cpu"


def cuda_possible(nodes: tuple[str, ...] = _DRIVER_NODES, system: str = sys.platform) -> bool:
    """Return whether torch could find a card; False is certain, but only torch can confirm True.

    Args:
        nodes: Files that the drivers of a card make on Linux.
        system: Name of the system, as ``sys.platform``.
    """
    if system == "darwin":
        return False
    return system != "linux" or any(Path(node).exists() for node in nodes)


@cache
def machine() -> dict[str, Any]:
    """Return the fingerprint of this machine, looked at once; torch need not be imported."""
    return fingerprint(with_torch=cuda_possible())


def all_threads() -> int:
    """Return the number of logical cores that this process may use."""
    return int(machine()["cores_logical"] or 1)


def environment_facts() -> dict[str, Any]:
    """Return the fingerprint with its hash, the threads of answers and the versions of packages."""
    facts = machine()
    return {
        **facts,
        "fingerprint": fingerprint_hash(facts),
        "threads": 1,  # a run trains and answers on one
        "versions": installed_versions(*PACKAGES),
    }


def software() -> dict[str, str]:
    """Return name -> version of what the numbers of a run depend on; nothing is imported.

    The version of tactibench and of every plugin ends with the start of the hash of its source.
    """
    versions = installed_versions(*PACKAGES)
    versions["tactibench"] = f"{__version__} ({code_hash('tactibench')[:8]})"
    for point, origin in installed():
        try:
            code = code_hash(point.value.partition(":")[0].partition(".")[0])[:8]
        except (ModuleNotFoundError, ValueError):  # its metadata stayed behind, or names no module
            code = "without source"
        versions[f"plugin {origin.plugin}"] = f"{origin.version} ({code})"
    return versions


def fingerprint(*, with_torch: bool = False) -> dict[str, Any]:
    """Return what determines speed on this machine, as JSON values.

    These are cpu, cpu_flags (matrix and vector units), cores_physical, cores_logical (those that
    this process may use), memory_gib, gpu (names), os, python and torch (version). A value that
    cannot be found is None.

    Args:
        with_torch: Whether to import torch to find a card that the driver's files do not show. When
            torch is imported already, it is always used.
    """
    cpuinfo = _read(_PROC / "cpuinfo")
    cpus = _allowed_cpus()
    model, flags = cpu_of(cpuinfo)
    logical = _within_quota(len(cpus), _read(_CGROUP))
    physical = physical_cores(cpuinfo, cpus)
    torch_version = installed_versions("torch")["torch"]
    return {
        "cpu": model or platform.processor() or platform.machine() or None,
        "cpu_flags": flags,
        "cores_physical": min(physical, logical) if physical else None,
        "cores_logical": logical,
        "memory_gib": _memory_gib(),
        "gpu": _gpus(with_torch=with_torch),
        "os": f"{platform.system()} {platform.machine()}",
        "python": ".".join(platform.python_version_tuple()[:2]),
        "torch": None if torch_version == "not installed" else torch_version,
    }


def fingerprint_hash(facts: dict[str, Any]) -> str:
    """Return 12 hexadecimal digits that are equal only for equal fingerprints."""
    text = json.dumps(facts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def cpu_of(cpuinfo: str) -> tuple[str | None, list[str]]:
    """Return name and flags of the first processor in the text of /proc/cpuinfo.

    Hypervisors give processors of several generations one name, so the numbers of family and model
    stand behind it.
    """
    first = next(iter(_processors(cpuinfo)), {})
    flags = set(first.get("flags", "").split())
    model = first.get("model name")
    if model and {"cpu family", "model"} <= first.keys():
        model = f"{model}, family {first['cpu family']} model {first['model']}"
    return model, [flag for flag in FLAGS if flag in flags]


def physical_cores(cpuinfo: str, cpus: set[int]) -> int | None:
    """Return the number of physical cores of logical ones; None where the text does not tell it.

    Args:
        cpuinfo: Text of /proc/cpuinfo.
        cpus: Numbers of the logical cores.
    """
    cores = {
        (processor["physical id"], processor["core id"])
        for processor in _processors(cpuinfo)
        if int(processor["processor"]) in cpus and {"physical id", "core id"} <= processor.keys()
    }
    return len(cores) or None


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Let this process compute with ``count`` threads inside the block, and as before after it.

    This holds for BLAS and OpenMP, and for torch, OpenCV and numba where they have been imported:
    by the time that a model is built, everything that it computes with is imported.
    """
    from threadpoolctl import threadpool_limits

    loaded = [(sys.modules[name], get, put) for name, get, put in _POOLS if name in sys.modules]
    with ExitStack() as stack:
        # numba is last: it starts its threads when it is asked, which may change OpenMP's number.
        for module, get, put in loaded:
            stack.callback(getattr(module, put), getattr(module, get)())
        stack.enter_context(threadpool_limits(limits=count))
        for module, _, put in loaded:  # numba refuses more threads than it was started with
            most = module.config.NUMBA_NUM_THREADS if module.__name__ == "numba" else count
            getattr(module, put)(min(count, most))
        yield


def _has_cuda() -> bool:
    if not cuda_possible():
        return False
    import torch

    return bool(torch.cuda.is_available())


def _processors(cpuinfo: str) -> list[dict[str, str]]:
    processors = []
    for block in cpuinfo.split("\n\n"):
        fields = (line.partition(":") for line in block.splitlines())
        processor = {name.strip(): value.strip() for name, colon, value in fields if colon}
        if "processor" in processor:
            processors.append(processor)
    return processors


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
    """Return the logical cores within a cgroup's limit, "QUOTA PERIOD" (us) or "max PERIOD"."""
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
