"""The same trainings on a GPU; without one these are skipped."""

from dataclasses import replace

import pytest
import torch
from state_hash import state_hash

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device")


@pytest.mark.parametrize("precision", ["float32", "bf16"])
def test_a_training_is_repeatable_and_resumes_to_the_same_bits(
    run, recipe, recorder, interrupted, tmp_path, precision
):
    recipe = replace(recipe, precision=precision)
    undisturbed, _ = run(recipe=recipe, device="cuda")
    assert next(undisturbed.parameters()).is_cuda
    progress = recorder(stop_after_epoch=2)
    with pytest.raises(interrupted):
        run(recipe=recipe, device="cuda", checkpoints=tmp_path, progress=progress)
    resumed, report = run(recipe=recipe, device="cuda", checkpoints=tmp_path)
    assert report.resumed_from == 2
    assert state_hash(resumed) == state_hash(undisturbed)


def test_float32_on_the_gpu_learns_what_the_processor_learns(run, recipe):
    recipe = replace(recipe, epochs=1)
    there, report = run(recipe=recipe, device="cuda")
    here, wanted = run(recipe=recipe)
    assert report.history[0]["loss"] == pytest.approx(wanted.history[0]["loss"], rel=0.2)  # dropout
    assert {name for name, _ in there.named_buffers()} == {name for name, _ in here.named_buffers()}
