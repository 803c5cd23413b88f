"""Weights on disk: they come back, and nothing damaged or foreign is taken for them."""

import json

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactibench import UserError
from tactibench.training import (
    DamagedFileError,
    load_weights,
    pack_image,
    read_container,
    save_weights,
    unpack_image,
    write_container,
)


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


def test_a_changed_header_is_noticed(tmp_path):
    path = tmp_path / "file"
    write_container(path, {"a": torch.zeros(1)}, {"width": 16})
    path.write_bytes(path.read_bytes().replace(b"16", b"32"))
    with pytest.raises(DamagedFileError, match="digest"):
        read_container(path)


def test_weights_come_back(tmp_path):
    tensors = {"w": torch.rand(2, 2)}
    save_weights(tmp_path, tensors, model="m", architecture={"width": 8}, extra={"offset": 0.5})
    found, extra = load_weights(tmp_path, model="m", architecture={"width": 8})
    assert torch.equal(found["w"], tensors["w"])
    assert extra == {"offset": 0.5}


def test_missing_damaged_and_old_weights_are_refused(tmp_path):
    ask = {"model": "m", "architecture": {}}
    with pytest.raises(UserError, match="missing"):
        load_weights(tmp_path, **ask)
    write_container(
        tmp_path / "weights.safetensors", {}, {"schema": 0, "model": "m", "architecture": {}}
    )
    with pytest.raises(UserError, match="schema 0, and not of 'm'"):
        load_weights(tmp_path, **ask)
    (tmp_path / "weights.safetensors").write_bytes(b"junk")
    with pytest.raises(UserError, match="no usable weights"):
        load_weights(tmp_path, **ask)


@given(arrays(np.uint8, st.tuples(st.integers(0, 9), st.integers(0, 9))))
@settings(max_examples=30, deadline=None)
def test_an_image_is_the_same_after_json(image):
    other = unpack_image(json.loads(json.dumps(pack_image(image))))
    assert np.array_equal(other, image)
    assert other.shape == image.shape
    assert other.dtype == np.uint8
    assert other.flags.writeable
