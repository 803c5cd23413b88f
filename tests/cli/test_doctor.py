"""``tactibench doctor`` on this machine; broken plugins are tested with the plugin host."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
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


def test_a_torch_that_does_not_load(cli: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*, with_torch: bool = False) -> dict[str, Any]:
        if with_torch:
            raise ImportError("libc10.so: cannot open shared object file")
        return {"cpu": "some", "cores_logical": 2, "memory_gib": 1, "gpu": []}

    monkeypatch.setattr("tactibench.run.fingerprint", missing)
    code, out, _ = cli("doctor")
    assert code == 1
    assert broken(out) == [
        "broken    torch does not load: libc10.so: cannot open shared object file"
    ]


def test_a_package_that_is_missing(cli: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactibench.cli.plugin.PACKAGES", ("numpy", "no-such-package-here"))
    code, out, _ = cli("doctor")
    assert code == 1
    (line,) = broken(out)
    assert line == (
        "broken    no-such-package-here is not installed; pip install no-such-package-here"
    )


def test_a_folder_of_frames_is_checked(cli: Any, tmp_path: Path) -> None:
    folder = tmp_path / "plates"
    (folder / "images").mkdir(parents=True)
    code, out, _ = cli("doctor", "--data", folder)
    assert code == 1
    assert "targets.csv" in broken(out)[0]
    rows = ["image_name,pose_1,pose_2,pose_3,pose_4,pose_5,pose_6"]
    for i in range(3):
        assert cv2.imwrite(str(folder / "images" / f"f{i}.png"), np.full((8, 9), i, np.uint8))
        rows.append(f"f{i}.png,0,{-i},0,0,0,{i}")
    (folder / "targets.csv").write_text("\n".join(rows) + "\n")
    code, out, _ = cli("doctor", "--data", folder)
    assert code == 0
    assert f"data      {folder}: 3 frames of 8x9 px: ok\n" in out


def test_a_data_set_of_channels_is_checked(cli: Any, channels: Path) -> None:
    code, out, _ = cli("doctor", "--data", channels)
    assert code == 0
    assert f"data      {channels}: 3 frames of 15 channels: ok\n" in out
