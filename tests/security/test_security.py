"""No pickle on any path, and no code of a stranger where nothing of his was asked for."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_distribution import fake_distribution

ROOT = Path(__file__).parents[2]
SOURCES = [
    p for folder in ("tactibench", "plugins", "scripts") for p in (ROOT / folder).rglob("*.py")
]
UNPICKLERS = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
RUNS_TEXT = {"eval", "exec", "compile"}

STRANGER = """
from pathlib import Path
Path({mark!r}).write_text(__name__)
from tactibench import ModelSpec, hookimpl

@hookimpl
def tactibench_models():
    return [ModelSpec("stranger", "stranger_model:Model", "of a stranger")]
"""


def _dangers(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        else:
            names = []
        yield from (f"imports {n}" for n in names if n.partition(".")[0] in UNPICKLERS)
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        given = {word.arg: ast.unparse(word.value) for word in node.keywords}
        if given.get("allow_pickle", "False") != "False":
            yield f"{called} allows pickle"
        if called == "torch.load":
            yield "torch.load"
        if called in RUNS_TEXT or called in {"yaml.load", "os.system", "pd.read_pickle"}:
            yield f"calls {called}"
        if given.get("shell") == "True":
            yield f"{called} through a shell"
        if called.endswith((".extractall", ".extract")):
            yield f"{called} unpacks an archive"


@pytest.mark.long
def test_nothing_is_unpickled_run_as_text_or_unpacked() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {danger}"
        for path in SOURCES
        for danger in _dangers(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert len(SOURCES) > 100
    assert found == []


@pytest.mark.parametrize(
    "code",
    [
        "import pickle",
        "from joblib import load",
        "torch.load(p)",
        "np.load(p, allow_pickle=True)",
        "eval(text)",
        "subprocess.run(c, shell=True)",
        "zipfile.ZipFile(p).extractall(f)",
    ],
)
def test_a_danger_is_found(code: str) -> None:
    assert list(_dangers(ast.parse(code)))


@pytest.fixture
def stranger(tmp_path: Path) -> tuple[Path, dict[str, str], Path]:
    """Environment of a process beside a distribution whose modules leave a mark when imported."""
    site, marks = tmp_path / "site", tmp_path / "marks"
    fake_distribution(site, "stranger", stranger="stranger_hooks")
    marks.mkdir()
    for name in ("hooks", "model"):
        source = STRANGER.format(mark=str(marks / name))
        (site / f"stranger_{name}.py").write_text(source)
    path = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    cache = str(tmp_path / "cache")
    return tmp_path, {**os.environ, "PYTHONPATH": path, "TACTIBENCH_CACHE": cache}, marks


def marks_after(stranger: tuple[Path, dict[str, str], Path], *command: str) -> list[str]:
    folder, environment, marks = stranger
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stdout + done.stderr
    return sorted(path.name for path in marks.iterdir())


def test_list_hears_the_hooks_and_imports_nothing_that_they_name(
    stranger: tuple[Path, dict[str, str], Path],
) -> None:
    assert marks_after(stranger, "-m", "tactibench", "list", "models") == ["hooks"]


@pytest.mark.long
def test_verify_imports_no_model(
    stranger: tuple[Path, dict[str, str], Path],
) -> None:
    found = sorted((ROOT / "leaderboards" / "submissions" / "exp1").glob("*.json"))
    if not found:
        pytest.skip("no submissions: not a checkout")
    assert marks_after(stranger, "-m", "tactibench", "board", "verify", str(found[0])) == ["hooks"]


def test_exclusions_of_the_scanner_are_explained() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    skips = re.search(r"\[tool\.bandit\].*?skips = \[\n(.*?)\n\]", text, re.DOTALL)
    assert skips is not None
    for line in skips.group(1).splitlines():
        assert re.fullmatch(r'  "B\d{3}", # \S.{20,}', line), line
    for path in SOURCES:
        for line in path.read_text(encoding="utf-8").splitlines():
            assert "nosec" not in line or re.search(r" - \S.*# nosec B\d{3}$", line), (path, line)


@pytest.mark.parametrize("named", ["../secret.txt", "/dev/zero", "sub/names.txt", ".hidden", ""])
def test_a_protocol_reads_no_file_but_one_beside_it(tmp_path: Path, named: str) -> None:
    from tactibench import UserError
    from tactibench.protocols import protocol_files, read_protocol

    text = protocol_files()["surface"].read_text(encoding="utf-8")
    spoilt, count = re.subn(r'(?m)^test_frames = ".*"', f'test_frames = "{named}"', text)
    assert count == 1
    (tmp_path / "p.toml").write_text(spoilt, encoding="utf-8")
    with pytest.raises(UserError, match=r"recorded\.test_frames"):
        read_protocol(tmp_path / "p.toml")
