"""Measure how long it takes to find the plugins when 50 plugins of other authors are installed.

    python benchmarks/discovery.py [--plugins 50]

Makes distributions with an entry point, a light module and a model each in a temporary folder and
puts it on PYTHONPATH. Asks in fresh processes for all models, sensors and encoders, with and
without the folder, in turn. For ``PluginHost()`` and its catalogues it prints the wall time and the
processor time, which hardly depends on other work of the machine and is compared with the target;
for the whole ``tactibench list models`` it prints the wall time. Files and byte code are warm.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TARGET_S = 0.3
HOOKS = '''"""One model."""

from __future__ import annotations

from tactibench import ModelSpec, Parameter, hookimpl


@hookimpl
def tactibench_models() -> list[ModelSpec]:
    width = Parameter("width", 16, "channels", low=1)
    return [ModelSpec("model-{number}", "plugin_{number}.model:Model", "a model", (width,))]
'''
METADATA = "Metadata-Version: 2.1\nName: plugin-{number}\nVersion: 1.0\n\n" + "A long text.\n" * 200
INSIDE = """
import time
start, began = time.process_time(), time.perf_counter()
from tactibench.plugins.host import PluginHost
host = PluginHost()
found = [len(catalogue.specs) for catalogue in host.catalogues]
print(time.process_time() - start, time.perf_counter() - began, found[0])
"""


def install(site: Path, count: int) -> None:
    """Write the files that ``pip install`` of ``count`` plugins would leave."""
    for number in range(count):
        package = site / f"plugin_{number}"
        package.mkdir()
        (package / "__init__.py").touch()
        (package / "hooks.py").write_text(HOOKS.format(number=number))
        info = site / f"plugin_{number}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(METADATA.format(number=number))
        (info / "RECORD").write_text(f"plugin_{number}/hooks.py,,\n")
        (info / "entry_points.txt").write_text(
            f"[tactibench]\nplugin-{number} = plugin_{number}.hooks\n"
        )


def environment(site: Path | None) -> dict[str, str]:
    """Return the environment of this process, with a folder at the front of PYTHONPATH."""
    path = os.environ.get("PYTHONPATH", "")
    variables = {**os.environ, "PYTHONPATH": f"{site}{os.pathsep}{path}" if site else path}
    variables.pop("PYTHONDONTWRITEBYTECODE", None)
    return variables


def inside(site: Path | None) -> tuple[float, float, int]:
    """Return processor and wall seconds of discovery alone, and the number of models found."""
    done = subprocess.run(
        [sys.executable, "-c", INSIDE],
        check=True,
        capture_output=True,
        text=True,
        env=environment(site),
    )
    processor, wall, count = done.stdout.split()
    return float(processor), float(wall), int(count)


def whole(site: Path | None) -> float:
    """Return the wall seconds of ``tactibench list models``."""
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "tactibench", "list", "models"],
        check=True,
        capture_output=True,
        env=environment(site),
    )
    return time.perf_counter() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plugins", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=11)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        site = Path(folder)
        install(site, asked.plugins)
        places = {"without": None, "with": site}
        models = {name: inside(place)[2] for name, place in places.items()}  # writes byte code
        if models["with"] != models["without"] + asked.plugins:
            raise SystemExit(f"not every plugin was found: {models}")
        times: dict[str, list[float]] = {}
        for _ in range(asked.rounds):  # in turn, so that a busy moment falls on both
            for name, place in places.items():
                processor, wall, _ = inside(place)
                times.setdefault(f"discovery {name}, processor", []).append(processor)
                times.setdefault(f"discovery {name}, wall", []).append(wall)
                times.setdefault(f"list models {name}, wall", []).append(whole(place))
    print(f"{f'{asked.plugins} plugins, {asked.rounds} rounds':34}{'median s':>10}{'least s':>10}")
    for name in sorted(times):
        print(f"{name:34}{statistics.median(times[name]):10.3f}{min(times[name]):10.3f}")
    slow = False
    for clock in ("processor", "wall"):
        pairs = zip(
            times[f"discovery without, {clock}"], times[f"discovery with, {clock}"], strict=True
        )
        added = [b - a for a, b in pairs]
        middle = statistics.median(added)
        print(f"{f'added by the plugins, {clock}':34}{middle:10.3f}{min(added):10.3f}")
        slow |= clock == "processor" and middle > TARGET_S
    print(f"target: at most {TARGET_S} s of processor time: {'missed' if slow else 'met'}")
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
