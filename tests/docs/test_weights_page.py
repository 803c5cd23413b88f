"""The ten lines of docs/weights.md answer the frames of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from documented import blocks

from tactibench import Indenter, Pose, Scene, SensorContext, open_sensor
from tactibench.plugins import PluginHost
from tactibench.run import NullReporter, RunRequest, export_weights, make_plan, train_model

PAGE = Path(__file__).resolve().parents[2] / "docs" / "weights.md"
MOST_LINES = 13


class FakeCamera:
    """A TacTip that is pressed after the first frame; blue, green and red, as OpenCV gives them."""

    def __init__(self, _number: int) -> None:
        sensor = open_sensor("tactip-127", SensorContext(np.random.SeedSequence(0)), {})
        press = Scene(Indenter.single(), Pose(2.0, 1.0, depth=2.0))
        self._frames = iter([sensor.rest(), sensor.press(press)])

    def read(self) -> tuple[bool, Any]:
        frame = next(self._frames, None)
        if frame is None:
            raise KeyboardInterrupt
        return True, cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)


def test_a_model_is_served_in_ten_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    request = RunRequest("exp1", "nearest", presses=40, device="cpu")
    plan = make_plan(request, PluginHost(), tmp_path / "cache")
    train_model(plan, NullReporter())
    export_weights(plan, tmp_path / "unet.zip")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cv2, "VideoCapture", FakeCamera)
    (block,) = [b for b in blocks(PAGE.read_text(encoding="utf-8")) if b.language == "python"]
    assert len(block.text.splitlines()) <= MOST_LINES
    names: dict[str, Any] = {}
    with pytest.raises(KeyboardInterrupt):
        exec(block.text, names)  # noqa: S102
    assert len(names["contacts"]) == 1
    assert np.abs(names["contacts"].xy).max() < 12.8
    assert capsys.readouterr().out.startswith("nearest (")
