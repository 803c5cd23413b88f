"""doctor, list and other verbs beside broken plugins, each in a process of its own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

HEAVY = """
@hookimpl
def tactibench_models():
    return [ModelSpec("outsider", "dist_outsider_heavy:Model", "from elsewhere")]

@hookimpl
def tactibench_commands():
    return [CommandSpec("outside", "dist_outsider_heavy:verb", "does something else")]
"""
HALFWAY = """
@hookimpl
def tactibench_sensors():
    yield SensorSpec("half", "m:C", "")
    raise ValueError("half way")
"""
HOLLOW = """
@hookimpl
def tactibench_models():
    return [ModelSpec("hollow", "dist_outsider_heavy:NoSuchModel", "a target that is not there")]

@hookimpl
def tactibench_encoders():
    return [EncoderSpec("older", "dist_outsider_heavy:Older", "a class of version 1")]

@hookimpl
def tactibench_commands():
    return [CommandSpec("hollow-verb", "dist_outsider_heavy:Model", "a class for a command")]
"""
MODULE = """
import click
import tactibench
print("heavy module imported")

class Model(tactibench.Model):
    def fit(self, frames, truth, *, validation, rng, progress): ...
    def predict(self, frames): ...
    def save(self, directory): ...
    def load(self, directory): ...

class Older: ...

@click.command()
def verb():
    click.echo("outside verb called")
"""


@pytest.fixture
def outsider(install: Any, site: Any) -> None:
    install("outsider", HEAVY)
    (site / "dist_outsider_heavy.py").write_text(MODULE)


@pytest.fixture
def broken(install: Any, site: Any, outsider: None) -> None:
    install("crash", "import a_module_nobody_has")
    install("quit", "raise SystemExit(0)")
    install("halfway", HALFWAY)
    install("misspelt", "@hookimpl\ndef tactibench_encoder(): return []")
    install("wrong", "@hookimpl\ndef tactibench_models(): return {'mean': 1}")
    install("twin", HEAVY.replace("_outsider_heavy", "_twin_heavy").replace('"outside"', '"run"'))
    install("hollow", HOLLOW)


def test_doctor_names_every_broken_plugin_and_why(tactibench: Any, broken: None) -> None:
    done = tactibench("doctor")
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    lines = done.stdout.splitlines()
    complaints = [line for line in lines if line.startswith("broken")]
    for words in [
        "'crash' (dist-crash 1.2) in step load: ModuleNotFoundError: No module named 'a_module",
        "'quit' (dist-quit 1.2) in step load: SystemExit: 0",
        "'halfway' (dist-halfway 1.2) in step declare: tactibench_sensors raised ValueError: half",
        "'misspelt' (dist-misspelt 1.2) in step validate: there is no hook 'tactibench_encoder'",
        "'wrong' (dist-wrong 1.2) in step declare: tactibench_models gave str where ModelSpec",
        "'outsider' (dist-outsider 1.2) in step duplicate: model 'outsider' is offered also by",
        "'twin' (dist-twin 1.2) in step duplicate: model 'outsider' is offered also by",
        "'twin' (dist-twin 1.2): its command 'run' is a built-in verb",
        "'hollow' (dist-hollow 1.2): model 'hollow' cannot be used, because dist_outsider_heavy:No",
        "'hollow' (dist-hollow 1.2): dist_outsider_heavy:Model is no click command",
        "'hollow' (dist-hollow 1.2): encoder 'older' cannot be used, because dist_outsider_heavy:O",
        "'twin' (dist-twin 1.2): command 'run' cannot be used",
    ]:
        assert sum(words in line for line in complaints) == 1, (words, complaints)
    assert lines[-1] == f"{len(complaints)} problems found"
    assert len(complaints) == 12
    healthy = [line for line in lines if line.startswith("plugin ")]
    own = list(Path(__file__).resolve().parents[2].glob("plugins/**/hooks.py"))
    fine = ["(tactibench " in line and line.endswith(": ok") for line in healthy]
    assert sum(fine) == len(own)


def test_list_works_beside_broken_plugins(tactibench: Any, broken: None) -> None:
    done = tactibench("list")
    assert done.returncode == 0, done.stderr
    assert "  unet " in done.stdout
    assert "  hollow " in done.stdout
    assert "outsider" not in done.stdout, "two plugins offer it"
    assert "heavy module imported" not in done.stdout
    assert done.stderr.strip().endswith("; run `tactibench doctor`.")


def test_a_terminal_that_lacks_a_letter_is_no_reason_to_stop(
    install: Any, tactibench: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("greek", HEAVY.replace("from elsewhere", "\N{GREEK SMALL LETTER SIGMA} of 0.1 mm"))
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    done = tactibench("list", "models")
    assert done.returncode == 0, done.stderr
    assert re.search(r"outsider +\? of 0.1 mm", done.stdout)


def test_a_plugin_verb_is_offered_and_called(tactibench: Any, outsider: None) -> None:
    shown = tactibench("--help")
    assert re.search(r"outside +does something else", shown.stdout)
    assert "heavy module imported" not in shown.stdout
    assert tactibench("outside").stdout.endswith("outside verb called\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hollow-verb"], "'hollow-verb' cannot be used, because dist_outsider_heavy:Model is no"),
        (["describe", "outsider"], "model 'outsider' is offered by 'outsider' (dist-outsider 1.2)"),
        (["run", "exp1", "--model", "hollow", "--quick"], "'hollow' cannot be used, because dist"),
    ],
)
def test_what_is_broken_is_one_sentence_when_it_is_used(
    tactibench: Any, broken: None, arguments: list[str], words: str
) -> None:
    done = tactibench(*arguments)
    assert done.returncode == 2, done.stdout
    assert done.stderr.startswith("tactibench: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
