"""Count code lines and modules a package; measure what a run loads and how long commands take.

    python benchmarks/weight.py              code lines and modules, with the ceilings
    python benchmarks/weight.py --loaded     and what `run exp2 --model unet --quick` loads
    python benchmarks/weight.py --run        and the seconds of `run exp2 --model unet`
    python benchmarks/weight.py --tests      and those of the README's test command

Docstrings, comments and blank lines do not count: a package grows by what it does, not by what it
explains. A test holds the ceilings; docs/decisions/code.md says what users got for a higher one.
"""

from __future__ import annotations

import argparse
import ast
import io
import os
import statistics
import subprocess
import sys
import tempfile
import time
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SILENT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
"""Tokens that are no code."""
CEILINGS: dict[str, tuple[int, int]] = {
    "plugins/tactibench_baselines": (229, 3),
    "plugins/tactibench_cnn": (186, 3),
    "plugins/tactibench_heatmaps": (720, 4),
    "plugins/tactibench_mixture": (213, 3),
    "plugins/tactibench_pins": (1075, 7),
    "plugins/tactibench_recorded": (276, 3),
    "plugins/tactibench_sim": (3962, 22),
    "plugins/tactibench_superpose": (604, 6),
    "plugins/tactibench_tactip": (3825, 22),
    "plugins/tactibench_unet": (437, 3),
    "plugins/tactibench_vgnn": (352, 3),
    "tactibench": (920, 11),
    "tactibench/board": (2165, 12),
    "tactibench/cli": (2219, 12),
    "tactibench/datasets": (4887, 16),
    "tactibench/frames": (1968, 12),
    "tactibench/live": (410, 4),
    "tactibench/markers": (1778, 8),
    "tactibench/metrics": (1753, 11),
    "tactibench/plugins": (669, 5),
    "tactibench/protocols": (1094, 5),
    "tactibench/records": (895, 7),
    "tactibench/report": (3444, 17),
    "tactibench/run": (2833, 16),
    "tactibench/scaffold": (105, 2),
    "tactibench/stats": (324, 4),
    "tactibench/superposition": (1598, 9),
    "tactibench/sweep": (467, 3),
    "tactibench/testing": (1290, 6),
    "tactibench/training": (1513, 10),
}
"""Package -> most code lines, most modules. A row is lowered when a package shrinks."""
LOADED = """
import sys
from tactibench.cli.main import call
code = call(sys.argv[1:])
for name, module in sorted(sys.modules.items()):
    place = getattr(module, "__file__", None)
    if place and place.endswith(".py") and name.partition(".")[0].startswith("tactibench"):
        print("loaded", place)
sys.exit(code)
"""


def code_lines(text: str) -> int:
    """Return the number of lines of a module on which code stands."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in SILENT:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                lines.difference_update(range(first.lineno, (first.end_lineno or 0) + 1))
    return len(lines)


def lines_of(path: Path) -> int:
    """Return the code lines of a file."""
    return code_lines(path.read_text(encoding="utf-8"))


def packages() -> dict[str, list[Path]]:
    """Return package -> its modules: those of the core, "tactibench" itself, and the plugins."""
    core = ROOT / "tactibench"
    folders = {"tactibench": sorted(core.glob("*.py"))}
    for folder in (*core.iterdir(), *(ROOT / "plugins").iterdir()):
        modules = sorted(folder.rglob("*.py")) if folder.is_dir() else []
        if modules:
            folders[folder.relative_to(ROOT).as_posix()] = modules
    return dict(sorted(folders.items()))


def weights() -> dict[str, tuple[int, int]]:
    """Return package -> code lines, modules."""
    return {
        name: (sum(map(lines_of, modules)), len(modules)) for name, modules in packages().items()
    }


def sums() -> Iterator[tuple[str, list[Path]]]:
    """Yield the name and the files of all product code, tests, and benchmarks with scripts."""
    yield "product", [path for modules in packages().values() for path in modules]
    yield "tests", sorted((ROOT / "tests").rglob("*.py"))
    tools = [path for folder in ("benchmarks", "scripts") for path in (ROOT / folder).rglob("*.py")]
    yield "benchmarks and scripts", sorted(tools)


def loaded_modules() -> list[Path]:
    """Return the modules of the project that a quick U-Net run loads."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", LOADED, "run", "exp2", "--model", "unet", "--quick"],
            cwd=folder,
            env={**os.environ, "TACTIBENCH_CACHE": folder},
            capture_output=True,
            text=True,
            check=True,
            timeout=1800,
        )
    rows = [line for line in done.stdout.splitlines() if line.startswith("loaded ")]
    return [Path(row.removeprefix("loaded ")) for row in rows]


def seconds_of(*arguments: str, repeats: int = 15) -> float:
    """Return the median seconds of a command line."""
    command = [sys.executable, "-m", "tactibench", *arguments]
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True, timeout=60)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def measure_run() -> None:
    """Print the seconds of the main run, cold (no cache, no frames) and again."""
    with tempfile.TemporaryDirectory() as folder:
        for title in ("cold", "again"):
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "tactibench", "run", "exp2", "--model", "unet"],
                cwd=folder,
                env={**os.environ, "TACTIBENCH_CACHE": folder},
                capture_output=True,
                check=True,
                timeout=3600,
            )
            print(f"run exp2 --model unet, {title}: {time.perf_counter() - start:.1f} s")


def measure_tests() -> None:
    """Print wall and processor seconds of the README's test command."""
    before, start = os.times(), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q"], cwd=ROOT, capture_output=True, text=True
    )
    after, wall = os.times(), time.perf_counter() - start
    spent = sum(after[2:4]) - sum(before[2:4])
    print(f"README test command: {wall:.0f} s wall, {spent:.0f} s processor")
    print("    " + (done.stdout.strip().splitlines() or ["no output"])[-1])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for option in ("loaded", "run", "tests"):
        parser.add_argument(f"--{option}", action="store_true")
    given = parser.parse_args()

    print(f"{'package':34}{'code':>8}{'ceiling':>9}{'modules':>9}{'ceiling':>9}")
    for name, (code, modules) in weights().items():
        most_code, most_modules = CEILINGS.get(name, (0, 0))
        print(f"{name:34}{code:8,}{most_code:9,}{modules:9}{most_modules:9}")
    for name, paths in sums():
        raw = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
        print(f"all: {name:29}{sum(map(lines_of, paths)):8,} code lines, {len(paths)} modules, ")
        print(f"{'':34}{raw:8,} lines with docstrings, comments and blank ones")
    print(f"--help: {seconds_of('--help'):.3f} s, list: {seconds_of('list'):.3f} s")
    if given.loaded:
        loaded = loaded_modules()
        lines = sum(map(lines_of, loaded))
        print(f"run exp2 --model unet --quick loads {len(loaded)} modules, {lines:,} code lines")
    if given.run:
        measure_run()
    if given.tests:
        measure_tests()


if __name__ == "__main__":
    main()
