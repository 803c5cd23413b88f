"""The command as a process: help, imports, exit codes, interruption."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from surroundings import surroundings

from tactibench.cli.main import VERBS

HEAVY = [
    "numpy",
    "torch",
    "cv2",
    "pydantic",
    "rich",
    "scipy",
    "pandas",
    "matplotlib",
    "platformdirs",
]
UNET = ("run", "exp1", "--model", "unet", "--quick", "--device", "cpu")
SMALL = [
    "--param",
    "model.width=8",
    "--param",
    "model.size=64",
    "--param",
    "model.epochs=900",
    "--presses",
    "40",
]


BUFFERED = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "tactibench", *arguments]


def ran(*arguments: str, **keys: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=120, **keys)


@pytest.fixture(name="surroundings")
def _surroundings(tmp_path: Path) -> dict[str, Any]:
    """A folder and a cache for a process."""
    return {"cwd": tmp_path, "env": surroundings(tmp_path)}


@pytest.mark.parametrize("arguments", [["list"], ["--version"]])
def test_light_commands_import_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom tactibench.cli.main import call\n"
        f"code = call({arguments!r})\n"
        f"print('loaded:', *[name for name in {HEAVY!r} if name in sys.modules])\nsys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].strip() == "loaded:"


def test_help_of_no_verb_or_action_imports_anything_heavy() -> None:
    code = (
        "import sys\nfrom importlib import import_module\n"
        "import click\nfrom tactibench.cli.main import VERBS, call\n"
        "for verb, (target, _) in VERBS.items():\n"
        "    module, _, name = target.partition(':')\n"
        "    command = getattr(import_module(module), name)\n"
        "    actions = command.commands if isinstance(command, click.Group) else ()\n"
        "    for arguments in ([verb], *([verb, action] for action in actions)):\n"
        "        assert call([*arguments, '--help']) == 0\n"
        f"print('loaded:', *[name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1].strip() == "loaded:", done.stderr


def test_the_command_alone_prints_its_help(cli: Any) -> None:
    code, out, err = cli()
    assert (code, err) == (0, "")
    assert out == cli("--help")[1] == cli("-h")[1]
    for verb in (*VERBS, "hw"):
        assert f"\n  {verb} " in out


@pytest.mark.parametrize("verb", [*VERBS, "hw"])
def test_every_verb_explains_itself(cli: Any, verb: str) -> None:
    code, out, _ = cli(verb, "--help")
    assert code == 0
    assert out.startswith(f"Usage: tactibench {verb} ")


def test_python_m_is_the_command() -> None:
    done = ran("runn")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "tactibench: unknown command 'runn'; did you mean 'run'?\n"


def test_debug_shows_the_traceback() -> None:
    done = ran("runn", "--debug")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "UserError: unknown command 'runn'" in done.stderr


def test_a_reader_that_has_gone_is_no_mistake() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        command("list"), stdout=writing, stderr=subprocess.PIPE, text=True, timeout=60, env=BUFFERED
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.long
def test_a_write_that_fails_half_way(surroundings: dict[str, Any]) -> None:
    """A real failing write: files may not grow beyond 200 kB."""
    done = ran(
        *("run", "exp1", "--model", "mean", "--quick", "--presses", "40", "--device", "cpu"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)),
        **surroundings,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("tactibench: the file system refused")
    assert "File too large" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(surroundings["cwd"].rglob("record.json"))
    assert_whole(surroundings["cwd"])


def assert_whole(folder: Path) -> None:
    """No temporary file was left behind."""
    hidden = [path for path in folder.rglob(".*") if path.suffix != ".lock" and path.is_file()]
    assert hidden == []


@pytest.mark.long
def test_an_interrupt_during_training_is_one_sentence_and_leaves_a_resumable_run(
    surroundings: dict[str, Any],
) -> None:
    folder = surroundings["cwd"]
    process = subprocess.Popen(
        command(*UNET, *SMALL),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs the tests in the background has them ignore SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **surroundings,
    )
    try:
        deadline = time.monotonic() + 100
        checkpoints = folder / "cache" / "training"
        while not any(p.name[0] != "." for p in checkpoints.glob("*/*")) and process.poll() is None:
            assert time.monotonic() < deadline, "training wrote no checkpoint"
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130, err
    last = err.strip().splitlines()[-1]  # before it may stand how far the training was
    assert last == "tactibench: stopped; the same command continues where it was."
    assert out.startswith("plan: ")
    assert_whole(folder)
    assert not list((folder / "runs").rglob("record.json"))
    assert not list((folder / "cache" / "weights").glob("*/"))
    again = ran(*UNET, *SMALL, "--dry-run", **surroundings)
    assert "from where it stopped" in again.stdout
