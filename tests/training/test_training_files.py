import subprocess
import sys

import pytest
import torch
from torch import nn

from tactibench import UserError
from tactibench.training import (
    autocast,
    count_parameters,
    fold_batch_norm,
    load_weights,
    resolve_precision,
    save_weights,
    state_hash,
)
from tactibench.training.container import DamagedFile, read_container, write_container
from tactibench.training.precision import processor_flags


def test_importing_the_package_does_not_import_torch():
    code = (
        "import sys, tactibench, tactibench.training; tactibench.training.__all__;"
        "assert 'torch' not in sys.modules and 'numpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_all_is_exactly_what_is_public():
    import tactibench.training as public

    assert sorted(public.__all__) == dir(public)
    assert all(getattr(public, name) is not None for name in public.__all__)
    with pytest.raises(AttributeError):
        public.nothing  # noqa: B018


def test_equal_tensors_and_headers_make_equal_bytes(tmp_path):
    """Two entries of metadata come in random order: ten files would differ with p > 0.99."""
    tensors = {name: torch.full((3,), float(ord(name))) for name in "dacb"}
    written = set()
    for _ in range(10):
        write_container(tmp_path / "file", tensors, {"model": "unet", "extra": {"b": 1, "a": 2}})
        written.add((tmp_path / "file").read_bytes())
    assert len(written) == 1


def test_a_container_returns_tensors_and_header(tmp_path):
    tensors = {"a": torch.arange(6.0).reshape(2, 3).t(), "b/c": torch.tensor(3, dtype=torch.int64)}
    write_container(tmp_path / "file", tensors, {"n": [1, None, 0.1]})
    found, header = read_container(tmp_path / "file")
    assert header == {"n": [1, None, 0.1]}
    assert found.keys() == tensors.keys()
    assert all(torch.equal(found[name], tensors[name]) for name in tensors)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing(tmp_path, monkeypatch):
    write_container(tmp_path / "file", {"a": torch.zeros(1)}, 1)

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_container(tmp_path / "file", {"a": torch.ones(1)}, 2)
    monkeypatch.undo()
    assert read_container(tmp_path / "file")[1] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_changed_header_is_noticed(tmp_path):
    path = tmp_path / "file"
    write_container(path, {"a": torch.zeros(1)}, {"width": 16})
    path.write_bytes(path.read_bytes().replace(b"16", b"32"))
    with pytest.raises(DamagedFile, match="digest"):
        read_container(path)


def test_weights_come_back(tmp_path):
    tensors = {"w": torch.rand(2, 2)}
    save_weights(tmp_path, tensors, model="m", architecture={"width": 8}, extra={"offset": 0.5})
    found, extra = load_weights(tmp_path, model="m", architecture={"width": 8})
    assert torch.equal(found["w"], tensors["w"])
    assert extra == {"offset": 0.5}


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"model": "other", "architecture": {"width": 8}}, "other"),
        ({"model": "m", "architecture": {"width": 16}}, "width=16"),
        ({"model": "m", "architecture": {"width": 8, "stem": 2}}, "stem=None"),
    ],
)
def test_foreign_weights_are_refused(tmp_path, asked, named):
    save_weights(tmp_path, {"w": torch.zeros(1)}, model="m", architecture={"width": 8})
    with pytest.raises(UserError) as caught:
        load_weights(tmp_path, **asked)
    assert named in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_missing_damaged_and_old_weights_are_refused(tmp_path):
    ask = {"model": "m", "architecture": {}}
    with pytest.raises(UserError, match="missing"):
        load_weights(tmp_path, **ask)
    write_container(
        tmp_path / "weights.safetensors", {}, {"schema": 0, "model": "m", "architecture": {}}
    )
    with pytest.raises(UserError, match="schema 0"):
        load_weights(tmp_path, **ask)
    (tmp_path / "weights.safetensors").write_bytes(b"junk")
    with pytest.raises(UserError, match="no usable weights"):
        load_weights(tmp_path, **ask)


def test_a_folded_network_answers_as_before():
    network = nn.Sequential(
        nn.Sequential(nn.Conv2d(1, 3, 3, bias=False), nn.BatchNorm2d(3), nn.ReLU(inplace=True)),
        nn.Conv2d(3, 2, 1),
        nn.BatchNorm2d(2),
    )
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -1, 1)
            nn.init.uniform_(module.running_var, 0.2, 2)
            nn.init.uniform_(module.weight, -1, 1)
            nn.init.uniform_(module.bias, -1, 1)
    before = state_hash(network)
    folded = fold_batch_norm(network)
    images = torch.rand(4, 1, 9, 9)
    with torch.inference_mode():
        expected = network.eval()(images)
        torch.testing.assert_close(folded(images), expected, rtol=1e-5, atol=1e-6)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in folded.modules())
    assert state_hash(network) == before


def test_a_copy_stored_in_bf16_answers_like_autocast():
    network = nn.Sequential(
        nn.Conv2d(1, 3, 3), nn.BatchNorm2d(3), nn.ReLU(), nn.Flatten(), nn.Linear(147, 2)
    )
    images = torch.rand(4, 1, 9, 9)
    with torch.inference_mode(), autocast("bf16", "cpu"):
        expected = fold_batch_norm(network)(images)
        assert torch.equal(fold_batch_norm(network, "bf16")(images), expected)


def test_parameters_are_counted():
    assert count_parameters(nn.Linear(3, 2)) == 8


def test_state_hash_sees_one_bit_and_not_the_memory_layout():
    network = nn.Conv2d(2, 3, 3)
    first = state_hash(network)
    assert state_hash(network.to(memory_format=torch.channels_last)) == first
    with torch.no_grad():
        network.bias[0] = torch.nextafter(network.bias[0], torch.tensor(9.0))
    assert state_hash(network) != first


def test_precision_is_taken_as_given_and_auto_is_one_of_both():
    assert resolve_precision("float32", "cpu") == "float32"
    assert resolve_precision("bf16", "cpu") == "bf16"
    assert resolve_precision("auto", "cpu") in ("float32", "bf16")
    layer = nn.Linear(2, 2)
    for precision, dtype in (("float32", torch.float32), ("bf16", torch.bfloat16)):
        with autocast(precision, "cpu"):
            assert layer(torch.zeros(1, 2)).dtype == dtype


@pytest.mark.parametrize(
    ("flags", "chosen"),
    [("fpu avx512f avx512_bf16", "bf16"), ("fpu amx_bf16", "bf16"), ("fpu avx512f", "float32")],
)
def test_auto_follows_the_processors_flags(monkeypatch, tmp_path, flags, chosen):
    file = tmp_path / "cpuinfo"
    file.write_text(f"processor : 0\nflags\t\t: {flags}\n\nprocessor : 1\nflags : other\n")
    found = processor_flags(file)
    assert found == set(flags.split())
    monkeypatch.setattr("tactibench.training.precision.processor_flags", lambda: found)
    assert resolve_precision("auto", "cpu") == chosen


def test_a_machine_that_does_not_tell_its_flags_trains_in_float32(tmp_path):
    assert processor_flags(tmp_path / "missing") == frozenset()
