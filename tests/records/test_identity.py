"""Whatever changes a result changes its key."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tactibench.records import (
    VARIABLE,
    cache_folder,
    canonical,
    code_commit,
    code_hash,
    code_mentions,
    digest,
    installed_versions,
    outside_packages,
)


def test_equal_values_have_one_text() -> None:
    text = '{"a":[1,2],"b":1}'
    assert canonical({"b": 1, "a": [1, 2]}) == canonical({"a": (1, 2), "b": 1}) == text
    assert digest({"a": 1}) != digest({"a": 1.5})
    with pytest.raises(ValueError, match="not JSON compliant"):
        digest(float("nan"))


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "hashed_package"
    (folder / "inner").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "inner" / "table.bin").write_bytes(b"1")
    monkeypatch.syspath_prepend(tmp_path)
    code_hash.cache_clear()
    return folder


def hashed(*without: str) -> str:
    code_hash.cache_clear()
    return code_hash("hashed_package", frozenset(without))


def test_the_code_hash_sees_every_file_but_byte_code(package: Path) -> None:
    seen = {hashed()}
    for name in ("more.py", "inner/data.txt", "inner/more.npz"):
        (package / name).write_text("x")
        seen.add(hashed())
    (package / "more.py").write_text("y")
    seen.add(hashed())
    (package / "more.py").rename(package / "moved.py")
    last = hashed()
    seen.add(last)
    assert len(seen) == 6
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "a.pyc").write_bytes(b"x")
    (package / ".DS_Store").write_bytes(b"x")
    assert hashed() == last


def test_folders_that_only_show_are_left_out(package: Path) -> None:
    before = hashed("inner")
    (package / "inner" / "data.txt").write_text("x")
    assert hashed("inner") == before != hashed()


def test_modules_have_a_hash_and_unknown_packages_none() -> None:
    assert code_hash("tactibench.geometry") != code_hash("tactibench.contacts")
    with pytest.raises(ModuleNotFoundError):
        code_hash("no_such_package_at_all")


def test_versions_are_read_without_import() -> None:
    found = installed_versions("numpy", "no-such-distribution")
    import numpy as np

    assert found == {"numpy": np.__version__, "no-such-distribution": "not installed"}


def test_commit(tmp_path: Path) -> None:
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    assert code_commit(tmp_path) == "installed"
    subprocess.run([*git, "init", "-q"], check=True)
    assert code_commit(tmp_path) == "installed"
    (tmp_path / "pyproject.toml").write_text("")
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-qm", "one"], check=True)
    clean = code_commit(tmp_path)
    assert len(clean) == 40
    (tmp_path / "pyproject.toml").write_text("x = 1")
    assert code_commit(tmp_path) == f"{clean}+dirty"


def test_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.setenv(VARIABLE, "~/x")
    assert cache_folder() == Path.home() / "x"
    monkeypatch.delenv(VARIABLE)
    assert "tactibench" in str(cache_folder())


def test_a_package_mentions_what_its_source_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pinned").mkdir()
    (tmp_path / "pinned" / "__init__.py").write_text('"""Nothing."""\n')
    (tmp_path / "pinned" / "model.py").write_text("from tactibench.markers import Tracker\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert code_mentions("pinned", ["tactibench.superposition", "tactibench.markers"])
    assert not code_mentions("pinned", ["tactibench.superposition"])
    with pytest.raises(ModuleNotFoundError):
        code_mentions("not_there_at_all", ["x"])


def test_a_package_imports_what_its_author_wrote_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {
        "outer/__init__.py": "import numpy, json\nfrom tactibench import Frame\n",
        "outer/model.py": "if 1:\n  from shifts.small import X\n  import alone as a, nothing\n",
        "shifts/__init__.py": "",
        "shifts/small.py": "from deeper import X\nY = 1\n",
        "deeper.py": "import outer\n",
        "alone.py": "",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "nothing").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert outside_packages("outer") == ("alone", "deeper", "shifts")
