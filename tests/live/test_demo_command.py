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
    with demo_page(["mean", "nearest", "--train", "--param", "sensor.size=64"]) as (url, process):
        press = b'{"tips": [[1.0, 2.0]], "depth": 1.0, "radius": 3.0}'
        content, _ = ask_page(url, "/press", press)
        assert content.count(b'"ms"') == 2
    assert process.returncode == 0
