"""``tactibench doctor`` on this machine; broken plugins are tested with the plugin host."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tactibench.plugins import PluginHost
from tactibench.protocols import protocol_files


def broken(out: str) -> list[str]:
    return [line for line in out.splitlines() if line.startswith("broken")]


def test_a_sound_installation_is_well(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli("doctor")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == "all is well"
    for origin in PluginHost().plugins:
        assert f"plugin    {origin}: ok\n" in out
    for name in protocol_files():
        assert f"protocol  {name}@" in out
    assert f"cache     {tmp_path / 'cache'}\n" in out


def test_a_cache_that_cannot_be_written(
    cli: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "file" / "cache"))
    code, out, _ = cli("doctor")
    assert code == 1
    (line,) = broken(out)
    assert "file/cache cannot be written (Not a directory); set TACTIBENCH_CACHE" in line
    assert out.endswith("1 problem found\n")
