"""The wheel is complete: built, installed into an empty environment, run outside the checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOREIGN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "TACTIBENCH_CACHE")


def clean_environment(**more: str) -> dict[str, str]:
    """Nothing that points back to the checkout or to this environment."""
    return {**{k: v for k, v in os.environ.items() if k not in FOREIGN}, **more}


def ran(*command: str | Path, cwd: Path, **more: str) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=clean_environment(**more),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    ran(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (built,) = folder.glob("tactibench-*.whl")
    return built


@pytest.fixture(scope="module")
def empty(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with the wheel; only its dependencies are lent by the present one.

    A folder named in a .pth file is searched after the environment's own packages, and .pth files
    in it are not read, so an editable install of the checkout stays out of sight.
    """
    environment = tmp_path_factory.mktemp("empty") / "venv"
    ran(sys.executable, "-m", "venv", "--without-pip", environment, cwd=environment.parent)
    python = environment / "bin" / "python"
    site = Path(
        ran(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=environment
        ).strip()
    )
    pip = (sys.executable, "-m", "pip", "--python", python)  # its own takes seconds to install
    ran(*pip, "install", "--no-deps", "--no-index", "-q", wheel, cwd=environment)
    lent = [p for p in sys.path if Path(p).name in ("site-packages", "dist-packages")]
    (site / "zz_lent_dependencies.pth").write_text("\n".join(lent) + "\n")
    return environment


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as file:
        return set(file.namelist())


def files_under(folder: Path, pattern: str = "*") -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob(pattern)
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_wheel_holds_the_core_all_plugins_protocols_and_boards(wheel: Path) -> None:
    expected = {f"tactibench/{name}" for name in files_under(ROOT / "tactibench")}
    plugins = {name for name in files_under(ROOT / "plugins") if name.startswith("tactibench_")}
    assert {name.partition("/")[0] for name in plugins} >= {"tactibench_sim", "tactibench_unet"}
    expected |= plugins
    boards = [f"leaderboards/{name}" for name in ("hidden", "published", "submissions")]
    for source in ("protocols", *boards):
        names = files_under(ROOT / source)
        assert any(name.endswith((".toml", ".npz")) for name in names)
        expected |= {f"tactibench/_shipped/{source}/{name}" for name in names}
    held = {name for name in names_in(wheel) if ".dist-info/" not in name}
    assert held == expected
    assert "tactibench/py.typed" in held


def test_an_installed_copy_is_used_and_lists_everything(empty: Path, tmp_path: Path) -> None:
    where = "import tactibench, tactibench_sim; print(tactibench.__file__, tactibench_sim.__file__)"
    for file in ran(empty / "bin" / "python", "-c", where, cwd=tmp_path).split():
        assert empty in Path(file).parents
    ran(empty / "bin" / "tactibench", "list", "--json", "listed.json", cwd=tmp_path)
    listed = json.loads((tmp_path / "listed.json").read_text(encoding="utf-8"))
    assert {row["name"] for row in listed["models"]} >= {"cnn", "mean", "nearest", "unet"}
    assert {row["name"] for row in listed["sensors"]} >= {"recorded", "tactip-127", "tactip-331"}
    assert {row["name"] for row in listed["encoders"]} >= {"depth", "hertz", "offset"}
    protocols = {p.stem for p in (ROOT / "protocols").glob("*.toml") if "." not in p.stem}
    assert {row["name"] for row in listed["protocols"]} == protocols


@pytest.mark.long
def test_the_boards_that_ship_are_shown_in_an_empty_folder(empty: Path, tmp_path: Path) -> None:
    for words, shown in {
        ("board", "show", "sites"): "rank",
        ("plot", "frontier", "sites"): "frontier",
        ("report", "--protocol", "sites"): "wrote report.html",
    }.items():
        printed = ran(empty / "bin" / "tactibench", *words, cwd=tmp_path)
        assert shown in printed
        assert "board: that of tactibench 0." in printed
    (tmp_path / "leaderboards").mkdir()
    with pytest.raises(AssertionError, match="leaderboards has no ranked rows of sites"):
        ran(empty / "bin" / "tactibench", "board", "show", "sites", cwd=tmp_path)


@pytest.mark.slow
def test_a_quick_job_runs_outside_the_checkout(empty: Path, tmp_path: Path) -> None:
    printed = ran(
        *(empty / "bin" / "tactibench", "run", "exp1", "--model", "mean", "--quick"),
        *("--device", "cpu", "--json", tmp_path / "record.json"),
        cwd=tmp_path,
        TACTIBENCH_CACHE=str(tmp_path / "cache"),
    )
    record: dict[str, Any] = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    assert record["partial"] is True
    assert record["identity"]["commit"] == "installed"
    assert record["protocol"]["id"] == "exp1"
    assert (tmp_path / "runs" / record["name"] / "record.json").is_file()
    assert record["signature"] in printed.replace("\n", "")
    assert "tactiverse" in printed, "published numbers travel with the wheel"
