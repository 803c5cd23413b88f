"""The fingerprint, and its reading of kernel files."""

from __future__ import annotations

import json
import os
import sys

import pytest

from tactibench.run import cpu_of, fingerprint, fingerprint_hash, physical_cores
from tactibench.run import machine as module

HYPERTHREADED = "\n\n".join(
    f"processor\t: {cpu}\nmodel name\t: Maker Nine 9000 @ 2.00GHz\nphysical id\t: {socket}\n"
    f"core id\t\t: {core}\nflags\t\t: fpu avx2 avx512f avx512_bf16 amx_tile amx_bf16"
    for cpu, (socket, core) in enumerate([(0, 0), (0, 1), (0, 0), (0, 1), (1, 0), (1, 0)])
)
ARM = "processor\t: 0\nBogoMIPS\t: 50.00\nFeatures\t: fp asimd\n\nprocessor\t: 1\nBogoMIPS\t: 50.00"


def test_keys_and_json():
    found = fingerprint()
    assert set(found) == {
        "cpu",
        "cpu_flags",
        "cores_physical",
        "cores_logical",
        "memory_gib",
        "gpu",
        "os",
        "python",
        "torch",
    }
    assert json.loads(json.dumps(found)) == found
    assert 1 <= found["cores_logical"] <= (os.cpu_count() or 1)
    assert found["python"] == f"{sys.version_info[0]}.{sys.version_info[1]}"


def test_hash_is_stable_and_sees_every_value():
    found = fingerprint()
    digest = fingerprint_hash(found)
    assert len(digest) == 12
    assert fingerprint_hash(dict(reversed(found.items()))) == digest
    others = {fingerprint_hash({**found, key: "other"}) for key in found}
    assert len(others | {digest}) == len(found) + 1


def test_cpuinfo():
    assert cpu_of(HYPERTHREADED) == (
        "Maker Nine 9000 @ 2.00GHz",
        ["amx_bf16", "amx_tile", "avx2", "avx512_bf16", "avx512f"],
    )
    assert physical_cores(HYPERTHREADED, {0, 1, 2, 3, 4, 5}) == 3
    assert physical_cores(HYPERTHREADED, {0, 2}) == 1  # two threads of one core
    assert cpu_of(ARM) == (None, [])
    hidden = "processor: 0\ncpu family: 6\nmodel: {}\nmodel name: A Processor\n"
    models = [cpu_of(hidden.format(number))[0] for number in (143, 207)]
    assert models == ["A Processor, family 6 model 143", "A Processor, family 6 model 207"]
    assert physical_cores(ARM, {0, 1}) is None
    assert cpu_of("") == (None, [])


@pytest.mark.parametrize(
    ("cpu_max", "cores"),
    [
        ("max 100000\n", 8),
        ("200000 100000\n", 2),
        ("150000 100000", 2),
        ("5000 100000", 1),
        ("", 8),
    ],
)
def test_cgroup_quota(cpu_max, cores):
    assert module._within_quota(8, cpu_max) == cores


def test_cards_are_read_from_the_driver(tmp_path, monkeypatch):
    for bus, name in (("0000:02:00.0", "Card B"), ("0000:01:00.0", "Card A")):
        folder = tmp_path / "driver/nvidia/gpus" / bus
        folder.mkdir(parents=True)
        (folder / "information").write_text(f"Model: \t\t {name}\nIRQ:   \t 12\n")
    monkeypatch.setattr(module, "_PROC", tmp_path)
    found = fingerprint()
    assert found["gpu"] == ["Card A", "Card B"]
    assert found["cores_physical"] is None  # no cpuinfo there
