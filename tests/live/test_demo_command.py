"""``tactibench demo``: models are trained, and the page answers."""

from __future__ import annotations

from pathlib import Path

import pytest
from asked_page import ask_page
from demo_page import demo_page


@pytest.mark.long
def test_a_bare_cache_a_model_is_trained_and_the_page_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path))
    opened = tmp_path / "opened"  # by the browser of a terminal, which it would take over
    monkeypatch.setenv("BROWSER", f"touch {opened} %s")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    asked = ["mean", "nearest", "--train", "--param", "sensor.size=64"]
    with demo_page(asked, options=()) as (url, process):
        press = b'{"tips": [[1.0, 2.0]], "depth": 1.0, "radius": 3.0}'
        content, _ = ask_page(url, "/press", press)
        assert content.count(b'"ms"') == 2
    assert process.returncode == 0
    assert not opened.exists()
