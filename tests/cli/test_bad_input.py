"""A mistake in the options or a protocol gets one sentence and exit code 2."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

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
        ([*MEAN, "--limt", "3"], ["No such option '--limt'", "mean", "--limit"]),
        (["list", "modles"], ["there is no 'modles'; did you mean 'models'?"]),
        (["list", "zzz"], ["there is no 'zzz'; known: encoders, models, protocols, runs"]),
        (["new", "modle", "x"], ["there is no 'modle'; did you mean 'model'?"]),
        (["run", "exp1", "--model", "unett"], ["unknown model 'unett'", "did you mean 'unet'?"]),
        (["run", "exp9", "--model", "mean"], ["unknown protocol 'exp9'", "did you mean 'exp"]),
        ([*MEAN, "--sensor", "tactip-128"], ["unknown sensor 'tactip-128'", "'tactip-12"]),
        ([*UNET, "--encoder", "herz"], ["unknown encoder 'herz'", "did you mean 'hertz'?"]),
        ([*MEAN, "--encoder", "hertz"], ["'mean' uses no encoder"]),
        ([*UNET, "--regime", "both"], ["no regime 'both'", "single, multiple"]),
        (
            ["run", "exp1", "--model", "cnn", "--regime", "multiple"],
            ["'cnn' predicts one contact per frame", "'multiple'", "--regime single"],
        ),
        ([*MEAN, "--limit", "0"], ["'--limit'", "0 is not in the range x>=1"]),
        ([*UNET, "--param", "width=8"], ["--param 'width=8'", "KIND.NAME=VALUE"]),
        ([*UNET, "--param", "epoch=3"], ["KIND.NAME=VALUE", "did you mean 'model.epochs'?"]),
        ([*UNET, "--param", "read_noise=3"], ["did you mean 'sensor.read_noise'?"]),
        ([*UNET, "--param", "width"], ["KIND.NAME=VALUE", "try --param model.width=32"]),
        ([*UNET, "--param", "modle.width=8"], ["--param 'modle.width=8'", "model, sensor, enc"]),
        ([*UNET, "--param", "model.widht=8"], ["'widht'", "did you mean 'width'?"]),
        ([*UNET, "--param", "model.width=9"], ["'width' is 9", "allowed: 8, 16, 32, 64"]),
        ([*UNET, "--param", "model.epochs=many"], ["'epochs' is 'many'", "a whole number"]),
        ([*UNET, "--param", "encoder.blur=nan"], ["'blur' is nan", "finite number"]),
        ([*MEAN, "--sensor", "recorded"], ["recorded", "--data DIR"]),
        (["run", "surface", "--model", "cnn"], ["'surface'", "--data DIR"]),
        ([*MEAN, "--data", "nowhere"], ["nowhere does not exist", "--data"]),
        ([*MEAN, "--json", "nowhere/x.json"], ["'--json'", "nowhere is not there", "make it"]),
        (["score", "no-such-run"], ["no run 'no-such-run' in runs", "holds no run yet"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_command_options(refused: Any, arguments: list[str], words: list[str]) -> None:
    sentence = refused(*arguments)
    for word in words:
        assert word in sentence


def test_a_full_disk(refused: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "frames.npy")

    monkeypatch.setattr(os, "replace", full)
    monkeypatch.setattr("tactibench.cli.output.Terminal.say", lambda *_: None)
    sentence = refused(*MEAN, "--quick")
    assert "the disk is full while writing frames.npy" in sentence
    assert "free some space" in sentence
    assert not [path for path in tmp_path.rglob("*.npy") if path.name.startswith(".")]
    assert not list(tmp_path.rglob("record.json"))


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


def test_a_plugin_that_is_written_and_not_installed(refused) -> None:
    assert "did you mean 'mixture'" in refused("check", "mixtur")
    Path("tactibench-mixtur").mkdir()
    assert "'mixtur' is not installed yet; run `pip install -e ./tactibench-mixtur`" in refused(
        "check", "mixtur"
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "pipe.toml", "--model", "mean"),
        ("sweep", "pipe.toml"),
        ("describe", "pipe.toml"),
        ("data", "import", ".", "set", "--map", "pipe.toml"),
    ],
    ids=" ".join,
)
def test_a_pipe_is_refused_and_not_waited_for(refused: Any, arguments: tuple[str, ...]) -> None:
    os.mkfifo("pipe.toml")
    assert "pipe.toml cannot be read: it is no regular file" in refused(*arguments)
