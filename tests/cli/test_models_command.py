"""``tactibench models``: train once, list it, and find it again in a run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest


def test_trained_weights_are_listed_and_found_again(cli):
    code, out, _ = cli("models", "train", "mean", "--presses", "40", "--json", "t.json")
    assert code == 0
    assert out.startswith("mean (single), seed 0: trained 0 epochs on 40 presses in ")
    assert json.loads(Path("t.json").read_text())[0]["reused"] is False
    assert "found in the cache" in cli("models", "train", "mean", "--presses", "40")[1]
    assert (
        "found in the cache"
        in cli("models", "train", "mean", "--presses", "40", "--protocol", "exp2")[1]
    ), "the experiments share their weights"
    code, out, _ = cli("models", "list", "--json", "l.json")
    assert code == 0
    (line,) = [line for line in out.split("\n") if line.startswith("mean")]
    assert line.split()[:6] == ["mean", "none", "single", "40", "0", "cpu"]
    rows = {row["metric"]: row for row in json.loads(Path("l.json").read_text())}
    assert rows["size_bytes"]["value"] > 0
    assert rows["epochs"]["presses"] == 40


def test_an_empty_cache_says_so(cli):
    code, out, _ = cli("models", "list")
    assert (code, out.startswith("no trained weights in ")) == (0, True)


def test_a_damaged_manifest_is_passed_over(cli, tmp_path):
    folder = tmp_path / "cache" / "weights" / "abc"
    folder.mkdir(parents=True)
    for text in ("{", "[]", "{}"):
        (folder / "manifest.json").write_text(text)
        assert cli("models", "list")[1].startswith("no trained weights in ")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["nobody"], "unknown model 'nobody'"),
        (["cnn", "--regime", "multiple"], "use --regime single"),
        (["mean", "--presses", "3600"], "must be less than the 3,600 presses"),
        (["mean", "--protocol", "exp9"], "unknown protocol 'exp9'"),
        (["mean", "--param", "model.width=3"], "has no parameter 'width'"),
    ],
)
def test_mistakes(refused, options, words):
    assert words in refused("models", "train", *options)
