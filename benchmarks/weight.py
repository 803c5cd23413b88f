"""Measure the size of the code: modules that a run loads, lines, import cycles, language, start-up.

python benchmarks/weight.py              all measurements but the long ones
python benchmarks/weight.py --run        with `run exp2 --model unet`, cold and again (minutes)
python benchmarks/weight.py --tests      with the README's test command (minutes)
python benchmarks/weight.py --list       name every offender instead of counting it
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
QUESTIONS = ("What", "Of", "Who", "Which", "How", "Where", "Whether")
"""First words of docstrings that are not sentences."""
PARTICIPLES = re.compile(
    r"(?:^|_)(?:answered|kept|tested|asked|opened|drawn|printed|chosen|sealed|ahead|still|silent|"
    r"known|inert|wanted|judged|guarded|released|committed|presses?able|cut|served|placed|found|"
    r"corrected|rendered|planned|packed|named|fitted|matched|generated|repeated|stored|pressed)$"
)
"""Last words of module and class names that are participles or adverbs instead of nouns."""
LOADED = """
import sys
from pathlib import Path
from tactibench.cli.main import call
code = call(sys.argv[1:])
rows = {}
for name, module in list(sys.modules.items()):
    place = getattr(module, "__file__", None)
    if place and place.endswith(".py") and name.partition(".")[0].startswith("tactibench"):
        rows[name] = len(Path(place).read_text(encoding="utf-8").splitlines())
for name in sorted(rows):
    print("loaded", name, rows[name])
sys.exit(code)
"""


def sources(*folders: str) -> list[Path]:
    """Return the Python files of folders of the repository."""
    return sorted(p for folder in folders for p in (ROOT / folder).rglob("*.py"))


def lines_of(paths: list[Path]) -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[1:] if parts[0] == "plugins" else parts
    return ".".join(parts).removesuffix(".__init__")


def loaded_modules() -> list[tuple[str, int]]:
    """Return the modules of the project that a quick U-Net run loads, with their lines."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", LOADED, "run", "exp2", "--model", "unet", "--quick"],
            cwd=folder,
            env={**os.environ, "TACTIBENCH_CACHE": folder},
            capture_output=True,
            text=True,
            check=True,
            timeout=900,
        )
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("loaded ")]
    return [(name, int(count)) for _, name, count in rows]


def import_graph() -> dict[str, set[str]]:
    """Return module -> modules of the project that it imports, also inside functions."""
    modules = {module_name(path): path for path in sources("tactibench", "plugins")}
    graph: dict[str, set[str]] = {name: set() for name in modules}
    for name, path in modules.items():
        for module, names in _imports(ast.parse(path.read_text(encoding="utf-8"))):
            for target in (f"{module}.{imported}" for imported in names):
                graph[name].add(target if target in modules else module)
            if not names:
                graph[name].add(module)
        graph[name] = {target for target in graph[name] if target in modules and target != name}
    return graph


def _imports(tree: ast.AST) -> Iterator[tuple[str, tuple[str, ...]]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module, tuple(alias.name for alias in node.names)
        yield from _imports(node)


def packages_of(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the same graph between packages: tactibench.run -> tactibench.frames."""

    def package(name: str) -> str:
        return ".".join(name.split(".")[:2]) if name.startswith("tactibench.") else name

    packages: dict[str, set[str]] = {}
    for name, targets in graph.items():
        imported = packages.setdefault(package(name), set())
        imported |= {package(target) for target in targets} - {package(name), "tactibench"}
    return packages


def cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return groups of nodes that reach each other (Tarjan's strongly connected components)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    groups: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for target in sorted(graph.get(node, ())):
            if target not in order:
                visit(target)
            if target in stack:
                low[node] = min(low[node], low[target])
        if low[node] == order[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                groups.append(sorted(group))

    sys.setrecursionlimit(10_000)
    for node in sorted(graph):
        if node not in order:
            visit(node)
    return groups


def question_docstrings() -> list[str]:
    """Return the places of docstrings, also below attributes, that begin with a question word."""
    rows = []
    for path in sources("tactibench", "plugins"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
                continue
            words = str(node.value.value).split()
            if words and words[0].rstrip(",:") in QUESTIONS:
                rows.append(f"{path.relative_to(ROOT)}:{node.lineno} {' '.join(words[:6])}")
    return rows


def participle_names() -> list[str]:
    """Return modules and classes that are named by participles or adverbs."""
    rows = []
    for path in sources("tactibench", "plugins"):
        if PARTICIPLES.search(path.stem):
            rows.append(str(path.relative_to(ROOT)))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                snake = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", node.name).lower()
                if PARTICIPLES.search(snake):
                    rows.append(f"{path.relative_to(ROOT)}:{node.lineno} class {node.name}")
    return rows


def format_exceptions() -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{number}"
        for path in sources("tactibench", "plugins", "tests", "benchmarks", "scripts")
        if path.name != Path(__file__).name
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if "# fmt: skip" in line
    ]


def seconds_of(*arguments: str, repeats: int = 15) -> float:
    """Return the median seconds of a command line."""
    command = [sys.executable, "-m", "tactibench", *arguments]
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True, timeout=60)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def show(title: str, rows: list[str], listed: bool) -> None:
    print(f"{title}: {len(rows)}")
    if listed:
        print(*(f"    {row}" for row in rows), sep="\n")


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
    for option in ("run", "tests", "list"):
        parser.add_argument(f"--{option}", action="store_true")
    given = parser.parse_args()

    product, tests = sources("tactibench", "plugins"), sources("tests")
    print(f"product code: {lines_of(product):,} lines, {len(product)} modules")
    sizes = sorted(len(p.read_text(encoding="utf-8").splitlines()) for p in product)
    print(f"    median {statistics.median(sizes):.0f}, above 400: {sum(n > 400 for n in sizes)}")
    print(f"test code: {lines_of(tests):,} lines, {len(tests)} files")
    graph = import_graph()
    for title, groups in (
        ("package cycles", cycles(packages_of(graph))),
        ("module cycles", cycles(graph)),
    ):
        show(title, [" <-> ".join(group) for group in groups], given.list)
    show("modules and classes named by participles", participle_names(), given.list)
    show("docstrings that begin with a question word", question_docstrings(), given.list)
    show("# fmt: skip", format_exceptions(), given.list)
    loaded = loaded_modules()
    print(
        f"loaded by run exp2 --model unet --quick: {len(loaded)} modules, "
        f"{sum(count for _, count in loaded):,} lines"
    )
    if given.list:
        print(*(f"    {name} {count}" for name, count in loaded), sep="\n")
    print(f"--help: {seconds_of('--help'):.3f} s, list: {seconds_of('list'):.3f} s")
    if given.run:
        measure_run()
    if given.tests:
        measure_tests()


if __name__ == "__main__":
    main()
