"""A model in a worker: plugins that look for the truth of hidden presses do not get it."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from fake_distribution import fake_distribution
from few_presses import few_presses

from tactibench import UserError, api
from tactibench.protocols import commitment_file, commitment_text, given_seed, load_protocol
from tactibench.protocols.loader import SEED_VARIABLE
from tactibench.records import StoredRun, open_run, run_names
from tactibench.run import NullReporter, execute, rescore

pytestmark = pytest.mark.long

SECRET = "5eed" * 16
FAKE = Path(__file__).parent / "fake"
DRIVER = """
import sys
from pathlib import Path
from tactibench.protocols import loader
loader.shipped_folder = lambda name, folder=Path(sys.argv.pop(1)): folder / name
from tactibench.cli.main import call
sys.exit(call(sys.argv[1:]))
"""
"""The command, with published hashes of hidden seeds in a folder of the test."""


@pytest.fixture(scope="module")
def spied(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[StoredRun, Path]]:
    """Options of a run of the spying plugin -> the run, and the folder of what was found.

    The plugin is installed as far as Python can tell; the run is the command's.
    """

    def spy(name: str, *options: str) -> tuple[StoredRun, Path]:
        folder = tmp_path_factory.mktemp(name)
        shutil.copytree(FAKE / "spying", folder / "site" / "spying")
        fake_distribution(folder / "site", "spying", spying="spying.hooks")
        (folder / "found").mkdir()
        hashes = folder / "leaderboards" / "hidden"
        hashes.mkdir(parents=True)
        path = few_presses(folder / "protocols")["exp1"]
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(SEED_VARIABLE, SECRET)
            protocol = load_protocol(str(path))
            seed = given_seed(protocol)
        published = commitment_file(protocol, seed.commitment, hashes)
        published.write_text(commitment_text(protocol, seed))
        done = subprocess.run(
            [
                *(sys.executable, "-c", DRIVER, str(folder), "run", str(path), "--model", "spy"),
                *("--quick", "--store", str(folder / "runs"), *options),
            ],
            env={
                **os.environ,
                "PYTHONPATH": str(folder / "site"),
                "TACTIBENCH_CACHE": str(folder / "cache"),
                SEED_VARIABLE: SECRET,
            },
            cwd=folder,
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        (made,) = run_names(folder / "runs")
        return open_run(folder / "runs", made), folder / "found"

    return spy


@pytest.fixture(scope="module")
def hidden(spied: Callable[..., tuple[StoredRun, Path]]) -> tuple[StoredRun, Path]:
    return spied("hidden", "--hidden-seed")


@pytest.fixture(scope="module")
def public(spied: Callable[..., tuple[StoredRun, Path]]) -> tuple[StoredRun, Path]:
    """The same plugin in an ordinary run, in the process that holds everything."""
    return spied("public")


def tells(found: bytes, run: StoredRun) -> bool:
    """Whether bytes hold the seed, or the place of a test press, as text or as a number."""
    places = run.arrays("truth")["xy"][:, 0].tolist()
    texts = [SECRET.encode(), *(repr(x).encode() for x in places)]
    return any(text in found for text in (*texts, *(struct.pack("<d", x) for x in places)))


WORKING = ("stack", "collector", "cache", "environment", "modules", "thread")
"""Attacks that find the truth where a model answers in the process that scores it."""
ALL = (*WORKING, "parents", "descriptors", "arguments", "folders", "frame", "generator")


@pytest.mark.parametrize("attack", ALL)
def test_an_attack_does_not_find_the_truth_of_hidden_presses(
    attack: str, hidden: tuple[StoredRun, Path]
) -> None:
    run, found = hidden
    assert (found / attack).is_file()  # it did look
    assert not tells((found / attack).read_bytes(), run)


@pytest.mark.parametrize("attack", WORKING)
def test_the_attack_works_where_the_model_shares_the_process(
    attack: str, public: tuple[StoredRun, Path]
) -> None:
    run, found = public
    assert tells((found / attack).read_bytes(), run)


def test_a_metric_that_a_plugin_patched_is_not_the_one_that_scores(
    hidden: tuple[StoredRun, Path], public: tuple[StoredRun, Path]
) -> None:
    assert public[0].value("mae_mm", "mean") == 0
    run = hidden[0]
    assert run.value("mae_mm", "mean") > 0.1
    protocol = load_protocol(str(hidden[1].parent / "protocols" / "few-exp1.toml"))
    assert [m.json_values() for m in rescore(run, protocol).metrics] == [
        m.json_values() for m in run.record.metrics
    ]
    assert np.isfinite(run.arrays("predictions")["xy"]).all()


BROKEN = """
import numpy as np
from tactibench import Contacts, FitReport, Model


class Broken(Model):
    def __init__(self, context, how="well"):
        self.how = how

    def fit(self, *_, **__):
        return FitReport()

    def save(self, directory):
        (directory / "weights").write_text("none")

    def load(self, directory):
        print("loaded")  # a worker's standard output is not for plugins

    def predict(self, frames):
        if self.how == "raises":
            raise ValueError("shapes do not fit")
        if self.how == "ends":
            import os

            os._exit(3)
        if self.how == "two":
            return [Contacts.none()] * 2
        return [Contacts(np.zeros((1, 2)), np.ones(1), np.ones(1)) for _ in frames]
"""
HOOKS = """
from tactibench import ModelSpec, Parameter, hookimpl

HOW = Parameter("how", "well", "what it does", choices=("well", "raises", "ends", "two"))


@hookimpl
def tactibench_models():
    yield ModelSpec("broken", "broken_plugin.model:Broken", "fails", (HOW,), deterministic=True)
"""


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("well", ""),
        ("raises", r"plugin 'broken'.* raised ValueError: shapes do not fit in Broken.predict"),
        ("ends", r"the process in which the model answers ended \(status 3\)"),
        ("two", r"gave 2 answers for one frame, but must give one; fix Broken.predict"),
    ],
)
def test_a_model_that_fails_in_its_worker_is_named(
    how: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "site" / "broken_plugin"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "model.py").write_text(BROKEN)
    (package / "hooks.py").write_text(HOOKS)
    fake_distribution(tmp_path / "site", "broken", broken="broken_plugin.hooks")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path / "site")  # its source is hashed, never imported
    path = few_presses(tmp_path / "protocols")["exp1"]
    plan = api.plan(
        path, "broken", params={"model.how": how}, quick=True, runner="", store=tmp_path / "runs"
    )
    with pytest.raises(UserError, match=said) if said else nullcontext():
        execute(plan, NullReporter(), timed=False)
    assert not [name for name in sys.modules if name.startswith("broken_plugin")]
