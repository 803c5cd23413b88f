"""``list``, ``describe``, ``doctor``, ``new`` and ``check``: what is installed, and more of it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tactibench.plugins import PluginHost
from tactibench.protocols import protocol_files

TRAIN = ("run", "exp1", "--model", "mean", "--presses", "40", "--train-only")


@pytest.fixture(scope="module")
def host() -> PluginHost:
    return PluginHost()


def test_list_names_everything_that_is_installed(cli: Any, host: PluginHost) -> None:
    code, out, err = cli("list")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    for catalogue in host.catalogues:
        assert f"{catalogue.kind}s:" in lines
        for spec in catalogue:
            assert any(line.split(maxsplit=1) == [spec.name, spec.summary] for line in lines)
    for name in protocol_files():
        assert any(line.startswith(f"  {name} ") for line in lines)


def test_describe_shows_every_spec_with_its_parameters(cli: Any, host: PluginHost) -> None:
    for catalogue in host.catalogues:
        for spec in catalogue:
            code, out, err = cli("describe", spec.name)
            assert (code, err) == (0, "")
            assert spec.target in out
            assert str(catalogue.origins[spec.name]) in out
            for parameter in spec.parameters:
                assert f"--param {catalogue.kind}.{parameter.name}={parameter.default}" in out
                assert parameter.help in out
    assert "encoder   of kind" in cli("describe", "unet")[1]


def test_describe_shows_every_protocol_by_name_and_by_file(cli: Any) -> None:
    for name, file in protocol_files().items():
        code, out, err = cli("describe", name)
        assert (code, err) == (0, "")
        assert out.startswith(f"protocol {name}@")
        assert cli("describe", file)[1] == out


def listed(cli: Any, kind: str) -> Any:
    assert cli("list", kind, "--json", "rows.json")[0] == 0
    return json.loads(Path("rows.json").read_text())


def test_trained_weights_are_listed_and_found_again(cli: Any) -> None:
    code, out, _ = cli(*TRAIN, "--json", "t.json")
    assert code == 0
    assert out.startswith("mean (single), seed 0: trained 0 epochs on 40 presses in ")
    assert json.loads(Path("t.json").read_text())["reused"] is False
    assert not Path("runs").exists(), "nothing was tested"
    other = (TRAIN[0], "exp2", *TRAIN[2:])
    assert "found in the cache" in cli(*other)[1], "the experiments share their weights"
    line = next(line for line in cli("list", "weights")[1].split("\n") if line.startswith("mean"))
    assert line.split()[:6] == ["mean", "none", "single", "40", "0", "cpu"]
    (row,) = listed(cli, "weights")
    assert (row["model"], row["presses"], row["epochs"]) == ("mean", 40, 0)


def test_runs_of_a_store_are_listed(cli: Any, stored_run: Any) -> None:
    assert cli("list", "runs")[1].startswith("no runs in runs")
    name = stored_run()
    assert name in cli("list", "runs")[1]
    (row,) = listed(cli, "runs")
    assert (row["name"], row["protocol"], row["partial"]) == (name, "exp1", False)


def test_doctor_names_what_is_there_and_what_is_broken(
    cli: Any, host: PluginHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, err = cli("doctor")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == "all is well"
    for origin in host.plugins:
        assert f"plugin    {origin}: ok\n" in out
    for name in protocol_files():
        assert f"protocol  {name}@" in out
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "file" / "cache"))
    code, out, _ = cli("doctor")
    assert code == 1
    assert "file/cache cannot be written (Not a directory); set TACTIBENCH_CACHE" in out
    assert out.endswith("1 problem found\n")


def test_new_says_what_it_wrote_and_what_is_next(cli: Any, refused: Any, tmp_path: Path) -> None:
    assert "is a path" in refused("new", "model", "../ridge")
    code, out, err = cli("new", "model", "ridge", "--out", "else")
    assert (code, err) == (0, "")
    folder = tmp_path / "else" / "tactibench-ridge"
    written = sorted(
        str(path.relative_to(tmp_path)) for path in folder.rglob("*") if path.is_file()
    )
    lines = out.splitlines()
    assert [line.removeprefix("wrote ") for line in lines[: len(written)]] == written
    assert lines[len(written) :] == [
        "next:",
        "  pip install -e ./else/tactibench-ridge",
        "  tactibench check ridge",
        "  tactibench run exp1 --model ridge --quick",
    ]


@pytest.mark.long
def test_check_prints_a_line_a_property_and_the_counts(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli("check", "mean", "--json", "found.json")
    assert (code, err) == (0, "")
    first, *lines, last = out.splitlines()
    assert first.startswith("model mean of plugin 'baselines' (tactibench ")
    assert re.fullmatch(r"\d+ ran: \d+ passed, 0 failed, 1 failed as expected; \d+ skipped", last)
    (expected,) = [line for line in lines if "failed as expected" in line]
    assert "nan_frame" in expected
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert len(found["properties"]) == len(lines)
    code, out, _ = cli("check", "depth", "--expect-failed", "noise=reads cells")
    assert code == 1
    assert "1 passed unexpectedly" in out.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["unett"], "did you mean 'unet'?"),
        (["mean", "--expect-failed", "nan_frame"], "write PROPERTY=REASON"),
        (["nearest", "--sensor", "recorded"], "presses only the scenes that it has"),
        (["recorded"], "--data DIR"),
    ],
)
def test_check_refuses(refused: Any, arguments: list[str], said: str) -> None:
    assert said in refused("check", *arguments)
