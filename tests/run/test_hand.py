"""A real hand on which up to six places are touched at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from briefly import time_briefly

from tactibench.datasets import ImportOptions, import_folder
from tactibench.plugins import PluginHost
from tactibench.run import NullReporter, RunRequest, execute, make_plan

HAND = Path(__file__).parents[3] / "shared" / "data" / "hand"
OPTIONS = ImportOptions(
    channels="Batch*.mat", channel_columns="syncresponses", sites="patterns", sensor="hand"
)

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not HAND.is_dir(), reason=f"the recording {HAND} is not there"),
]


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return import_folder(HAND, tmp_path_factory.mktemp("hand") / "data", OPTIONS).folder


@pytest.mark.parametrize(
    ("model", "regime", "expected"),
    [
        ("kernel", "single", {"2": 0.75, "3": 0.67, "4": 0.5}),
        ("superpose", "pairs", {"3": 0.8, "4": 0.75, "5": 0.65}),
        (
            "kernel",
            "all",
            {"2": 0.85, "3": 0.85, "4": 0.85}
            | {"session:2": 0.52, "session:3": 0.47, "session:4": 0.45},
        ),
    ],
)
def test_sets_of_places_are_right_as_often_as_the_page_of_models_says(
    hand: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    model: str,
    regime: str,
    expected: dict[str, float],
) -> None:
    time_briefly(monkeypatch.setattr)
    request = RunRequest("sites", model, regime=regime, data=hand, device="cpu")
    plan = make_plan(request, PluginHost(), tmp_path / "cache", store=tmp_path / "runs")
    record = execute(plan, NullReporter()).record
    found = {group: record.metric("exact", group).value for group in expected}
    assert all(found[group] > least for group, least in expected.items()), found
