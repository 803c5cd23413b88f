import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from state_hash import state_hash

ROOT = Path(__file__).parents[2]
CHECKPOINT = "checkpoint.safetensors"


@pytest.mark.parametrize("stop", [{"stop_after_epoch": 1}, {"stop_at_step": 11}])
@pytest.mark.parametrize("optimiser", ["adam", "adamw", "muon"])
def test_an_interrupted_training_resumes_to_the_same_bits(
    run, recipe, recorder, interrupted, tmp_path, stop, optimiser
):
    recipe = replace(recipe, optimiser=optimiser, patience=3)
    undisturbed, whole = run(recipe=recipe)
    with pytest.raises(interrupted):
        run(recipe=recipe, checkpoints=tmp_path, progress=recorder(**stop))
    progress = recorder()
    resumed, report = run(recipe=recipe, checkpoints=tmp_path, progress=progress)
    assert report.resumed_from > 0
    assert "checkpoint" not in report.notes
    assert state_hash(resumed) == state_hash(undisturbed)
    without_times = [{**row, "seconds": 0} for row in report.history]
    assert without_times == [{**row, "seconds": 0} for row in whole.history]
    assert [epoch for epoch, _, _ in progress.epochs] == [1, 2, 3, 4]
    assert len(progress.losses) == 4 * (4 - report.resumed_from)


def test_bf16_and_channels_last_resume_to_the_same_bits(
    run, recipe, recorder, interrupted, tmp_path
):
    recipe = replace(recipe, precision="bf16", channels_last=True)
    undisturbed, _ = run(recipe=recipe)
    with pytest.raises(interrupted):
        run(recipe=recipe, checkpoints=tmp_path, progress=recorder(stop_after_epoch=2))
    resumed, report = run(recipe=recipe, checkpoints=tmp_path)
    assert report.resumed_from == 2
    assert state_hash(resumed) == state_hash(undisturbed)


def test_a_finished_training_is_not_repeated(run, recorder, tmp_path):
    first, _ = run(checkpoints=tmp_path)
    progress = recorder()
    second, report = run(checkpoints=tmp_path, progress=progress)
    assert progress.losses == []
    assert report.resumed_from == 4
    assert state_hash(first) == state_hash(second)


def test_checkpoints_do_not_change_the_weights(run, tmp_path):
    assert state_hash(run(checkpoints=tmp_path)[0]) == state_hash(run()[0])
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]


def _cut(path):
    path.write_bytes(path.read_bytes()[:-40])


def _flip(path):
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)


def _replace(path):
    path.write_bytes(b"not a checkpoint")


@pytest.mark.parametrize("damage", [_cut, _flip, _replace, lambda path: path.write_bytes(b"")])
def test_a_damaged_checkpoint_is_ignored_and_said(run, recorder, interrupted, tmp_path, damage):
    with pytest.raises(interrupted):
        run(checkpoints=tmp_path, progress=recorder(stop_after_epoch=2))
    damage(tmp_path / CHECKPOINT)
    network, report = run(checkpoints=tmp_path)
    assert report.resumed_from == 0
    assert "ignored" in report.notes["checkpoint"]
    assert state_hash(network) == state_hash(run()[0])


@pytest.mark.parametrize("difference", ["seed", "recipe", "identity", "data", "threads"])
def test_a_checkpoint_of_another_training_is_never_used(
    run, recipe, make_examples, tmp_path, difference
):
    run(checkpoints=tmp_path)
    changed = {
        "seed": {"seed": 8},
        "recipe": {"recipe": replace(recipe, learning_rate=2e-2)},
        "identity": {"identity": {"model": "tiny", "width": 2}},
        "data": {"training": make_examples(30, 5)},
        "threads": {},
    }[difference]
    threads = torch.get_num_threads()
    torch.set_num_threads(threads + 1 if difference == "threads" else threads)
    try:
        network, report = run(checkpoints=tmp_path, **changed)
        assert report.resumed_from == 0
        assert "another" in report.notes["checkpoint"]
        assert state_hash(network) == state_hash(run(**changed)[0])
    finally:
        torch.set_num_threads(threads)


_SCRIPT = """
import importlib.util, sys, time
from pathlib import Path
import numpy as np, torch
torch.set_num_threads(1)
spec = importlib.util.spec_from_file_location("tiny", {conftest!r})
tiny = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tiny)
from torch import nn
from state_hash import state_hash
from tactibench.training import Recipe, Seeds, torch_seed, train

class Announcing(tiny.Recorder):
    def step(self, loss):
        print("step", flush=True)
        time.sleep(0.001)

seeds = Seeds.draw(np.random.default_rng(5))
with torch_seed(seeds.init):
    network = tiny.TinyNetwork()
train(network, tiny.examples(400, 1), tiny.examples(20, 2),
      recipe=Recipe(epochs=12, batch=8, learning_rate=1e-2), loss=nn.functional.mse_loss,
      error_mm=lambda outputs, rows: None, seeds=seeds, identity={{}}, progress=Announcing(),
      checkpoints=Path(sys.argv[1]))
print("hash", state_hash(network))
"""


def _start(folder):
    script = _SCRIPT.format(conftest=str(Path(__file__).with_name("conftest.py")))
    return subprocess.Popen(
        [sys.executable, "-c", script, str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests/shared")))},
    )


@pytest.mark.slow
def test_kill_9_at_any_moment_then_the_same_command_gives_the_same_bits(tmp_path):
    whole, _ = _start(tmp_path / "undisturbed").communicate()
    for steps in (20, 130, 333):  # in the first, third and seventh epoch
        with _start(tmp_path / "killed") as process:
            for _ in range(steps):
                process.stdout.readline()
            time.sleep(0.01)
            process.send_signal(signal.SIGKILL)
    resumed, _ = _start(tmp_path / "killed").communicate()
    assert resumed.splitlines()[-1] == whole.splitlines()[-1]
    assert resumed.splitlines()[-1].startswith("hash ")
    assert len(resumed.splitlines()) < len(whole.splitlines())
