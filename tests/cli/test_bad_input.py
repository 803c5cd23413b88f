"""A mistake in the options or a protocol gets one sentence and exit code 2."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
import torch

from tactibench.cli.main import call

EXP1 = Path(__file__).parents[2] / "protocols" / "exp1.toml"
MEAN = ("run", "exp1", "--model", "mean")
UNET = ("run", "exp2", "--model", "unet")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["runn"], ["unknown command 'runn'", "did you mean 'run'?"]),
        (["zzz"], ["unknown command 'zzz'", "known: board, check, compare, data, demo, describe"]),
        (["run"], ["Missing argument 'PROTOCOL'", "tactibench run --help"]),
        (["run", "exp1"], ["Missing option '--model'", "tactibench run --help"]),
        (["run", "exp1", "--model"], ["'--model' requires an argument"]),
        (["run", "exp1", "mean", "--model", "mean"], ["unexpected extra argument (mean)"]),
        ([*MEAN, "--limt", "3"], ["No such option '--limt'", "mean", "--limit"]),
        (["list", "modles"], ["'modles' is not one of", "models"]),
        (["describe", "unett"], ["nothing is called 'unett'", "did you mean 'unet'?"]),
        (["run", "exp1", "--model", "unett"], ["unknown model 'unett'", "did you mean 'unet'?"]),
        (["run", "exp9", "--model", "mean"], ["unknown protocol 'exp9'", "did you mean 'exp"]),
        (["run", "EXP1", "--model", "mean"], ["unknown protocol 'EXP1'", "did you mean 'exp1'?"]),
        (
            ["run", "slant", "--model", "mean"],
            ["known: exp1", "TACTIBENCH_PROTOCOLS names a folder"],
        ),
        ([*MEAN, "--sensor", "tactip-128"], ["unknown sensor 'tactip-128'", "'tactip-12"]),
        ([*UNET, "--encoder", "herz"], ["unknown encoder 'herz'", "did you mean 'hertz'?"]),
        ([*MEAN, "--encoder", "hertz"], ["'mean' uses no encoder"]),
        ([*MEAN, "--param", "encoder.blur=1"], ["'mean' uses no encoder"]),
        ([*UNET, "--regime", "both"], ["no regime 'both'", "single, multiple"]),
        (
            ["run", "exp1", "--model", "cnn", "--regime", "multiple"],
            ["'cnn' predicts one contact per frame", "'multiple'", "--regime single"],
        ),
        ([*MEAN, "--limit", "0"], ["'--limit'", "0 is not in the range x>=1"]),
        ([*MEAN, "--seed", "-1"], ["'--seed'", "-1 is not in the range x>=0"]),
        ([*MEAN, "--seed", "x"], ["'--seed'", "'x' is not a valid integer"]),
        ([*MEAN, "--device", "gpu"], ["'--device'", "'gpu' is not one of", "cuda"]),
        ([*UNET, "--param", "width=8"], ["--param 'width=8'", "KIND.NAME=VALUE"]),
        ([*UNET, "--param", "modle.width=8"], ["--param 'modle.width=8'", "model, sensor, enc"]),
        ([*UNET, "--param", "model.width"], ["--param 'model.width'"]),
        ([*UNET, "--param", "model.widht=8"], ["'widht'", "did you mean 'width'?"]),
        ([*UNET, "--param", "model.width=9"], ["'width' is 9", "allowed: 8, 16, 32, 64"]),
        ([*UNET, "--param", "model.epochs=many"], ["'epochs' is 'many'", "a whole number"]),
        ([*UNET, "--param", "model.epochs=-1"], ["'epochs' is -1", ">= 0"]),
        ([*UNET, "--param", "encoder.blur=nan"], ["'blur' is nan", "finite number"]),
        ([*UNET, "--param", "encoder.blur=inf"], ["'blur' is inf", "finite number"]),
        ([*UNET, "--param", "sensor.noise=perhaps"], ["'noise' is 'perhaps'", "yes or no"]),
        (
            [*UNET, "--param", "model.width=8", "--param", "model.width=16"],
            ["model.width is given twice"],
        ),
        ([*MEAN, "--sensor", "recorded"], ["recorded", "--data DIR"]),
        (["run", "surface", "--model", "cnn"], ["'surface'", "--data DIR"]),
        ([*MEAN, "--data", "nowhere"], ["nowhere does not exist", "--data"]),
        ([*MEAN, "--data", ".", "--sensor", "tactip-127"], ["'tactip-127'", "takes no --data"]),
        ([*MEAN, "--json", "nowhere/x.json"], ["'--json'", "nowhere is not there", "make it"]),
        ([*MEAN, "--json", "."], ["'--json'", "is a directory"]),
        (["score"], ["Missing argument 'RUN'", "tactibench score --help"]),
        (["score", "no-such-run"], ["no run 'no-such-run' in runs", "holds no run yet"]),
        (["data", "inport", "x"], ["No such command 'inport'"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_command_options(refused: Any, arguments: list[str], words: list[str]) -> None:
    sentence = refused(*arguments)
    for word in words:
        assert word in sentence


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there(refused: Any) -> None:
    assert "--device cuda was asked for, but torch finds no GPU" in refused(
        *MEAN, "--device", "cuda"
    )


def test_out_that_is_a_file(refused: Any, tmp_path: Path) -> None:
    (tmp_path / "store").write_text("")
    assert "'store' is a file" in refused(*MEAN, "--quick", "--store", "store")


EDITS = {
    "a wrong key": (
        b"\n[split]\n",
        b"\n[split]\ntset = 3\n",
        ["split.tset", "did you mean 'test'?"],
    ),
    "a wrong table": (b"[test]", b"[tests]", ["'tests'", "did you mean 'test'?"]),
    "a missing key": (b"gate_mm = 3.0", b"", ["'test.gate_mm'", "is missing"]),
    "a wrong type": (b"test = 1000", b'test = "many"', ["'split.test'", "integer"]),
    "another schema": (b"schema = 1", b"schema = 2", ["schema"]),
    "no answer it knows": (b'answer = "contacts"', b'answer = "poses"', ["answer", "contacts"]),
    "a draw that is not there": (b'draw = "singles"', b'draw = "solos"', ["solos"]),
    "a number that is none": (b"gate_mm = 3.0", b"gate_mm = nan", ["gate_mm"]),
    "broken TOML": (b"[test]", b"[test", ["not valid TOML", "line"]),
    "bytes that are no text": (b"[test]", b"\xff\xfe[test]", ["not valid TOML"]),
}


@pytest.mark.parametrize("edit", EDITS)
def test_a_protocol_file_with_a_mistake(refused: Any, tmp_path: Path, edit: str) -> None:
    before, after, words = EDITS[edit]
    text = EXP1.read_bytes()
    assert before in text
    file = tmp_path / "mine.toml"
    file.write_bytes(text.replace(before, after, 1))
    sentence = refused("run", file, "--model", "mean", "--dry-run")
    for word in ["mine.toml", *words]:
        assert word in sentence


def test_a_metric_that_is_not_there(cli: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(EXP1.read_bytes().replace(b'"r2",', b'"r3",').replace(b'"exp1"', b'"mine"'))
    code, _, err = cli("run", file, "--model", "mean", "--quick")
    assert code == 2
    assert "'r3'" in err
    assert "did you mean 'r2'?" in err
    assert not (tmp_path / "cache" / "frames").exists(), "refused before any work"


def test_protocols_that_are_no_files(refused: Any, tmp_path: Path) -> None:
    assert "gone.toml does not exist" in refused("run", "gone.toml", "--model", "mean")
    (tmp_path / "folder.toml").mkdir()
    assert "folder.toml is a folder" in refused("run", "folder.toml", "--model", "mean")
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    assert "not valid TOML" in refused("run", "binary.toml", "--model", "mean")
    (tmp_path / "empty.toml").write_bytes(b"")
    assert "is missing" in refused("describe", "empty.toml")


def test_a_full_disk(refused: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "frames.npy")

    monkeypatch.setattr(os, "replace", full)
    monkeypatch.setattr("tactibench.cli.output.Terminal.say", lambda *_: None)
    sentence = refused(*MEAN, "--quick")
    assert "the disk is full while writing frames.npy" in sentence
    assert "--store" in sentence
    assert "TACTIBENCH_CACHE" in sentence
    assert not [path for path in tmp_path.rglob("*.npy") if path.name.startswith(".")]
    assert not (tmp_path / "runs").exists()


def test_a_folder_that_may_not_be_written(
    refused: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "file" / "below"))
    monkeypatch.setattr("tactibench.cli.output.Terminal.say", lambda *_: None)
    sentence = refused(*MEAN, "--quick")
    assert "file/below" in sentence
    assert "Not a directory" in sentence


def test_debug_shows_the_exception_itself(cli: Any) -> None:
    from tactibench import UserError

    for arguments in (["--debug", *MEAN, "--sensor", "x"], [*MEAN, "--sensor", "x", "--debug"]):
        with pytest.raises(UserError, match="unknown sensor 'x'"):
            call(arguments)


def test_control_characters_are_shown_escaped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In names of files and in words of the command line."""
    monkeypatch.chdir(tmp_path)
    evil = tmp_path / "evil\x1b[2J\u202e.json"
    evil.write_text("x")
    assert call(["board", "verify", str(evil)]) == 1
    assert call(["run", "exp\x1b[2J", "--model", "mean"]) == 2
    out, err = capsys.readouterr()
    assert r"REFUSED evil\x1b[2J\u202e.json" in out
    assert r"unknown protocol 'exp\x1b[2J'" in err
    assert "\x1b" not in out + err
    assert "\u202e" not in out + err
