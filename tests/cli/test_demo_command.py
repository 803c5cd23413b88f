"""``tactibench demo``: what cannot be shown is refused before anything is trained."""

from __future__ import annotations

from typing import Any

import pytest
from asked_page import ask_page
from demo_page import demo_page


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("mean nearest cnn", "3 models are named; the page shows 2 at most"),
        ("nothing", "nothing"),
        (
            "unet",
            "there are no trained weights of unet in the cache for this request; make them with",
        ),
        ("superpose --sensor tactip", "sensor 'tactip' cannot be pressed by mouse"),
        ("cnn --protocol surface --data .", "sensor 'recorded' cannot be pressed by mouse"),
        (
            "cnn --protocol surface --sensor fitted-127",
            "takes the presses of a recorded folder",
        ),
        ("superpose --param model.width=3", "'superpose' has no parameter 'width'"),
        ("superpose unet --param model.wide=3", "has no parameter 'wide'"),
    ],
)
def test_what_cannot_be_shown_is_refused(refused: Any, arguments: str, sentence: str) -> None:
    assert sentence in refused(f"demo --no-browser {arguments}")


@pytest.mark.long
def test_a_bare_cache_a_model_is_trained_and_the_page_answers(
    tmp_path: Any, monkeypatch: Any
) -> None:
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path))
    with demo_page(["mean", "nearest", "--train", "--param", "sensor.size=64"]) as (url, process):
        press = b'{"tips": [[1.0, 2.0]], "depth": 1.0, "radius": 3.0}'
        content, _ = ask_page(url, "/press", press)
        assert content.count(b'"ms"') == 2
    assert process.returncode == 0
