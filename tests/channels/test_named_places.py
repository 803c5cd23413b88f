"""Recordings that know which named places are touched: tables, arrays, and one file a session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench import UserError
from tactibench.datasets import ImportOptions, import_folder, open_recording
from tactibench.frames import served_protocols

TOUCHED = np.array([[1, 0, 0], [0, 1, 1], [1, 1, 1], [0, 0, 1]])


def write_days(folder: Path, *, days: int = 2) -> Path:
    """Write an archive a day: patterns, and channels before and during every trial."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for day in range(days):
        before = rng.uniform(1, 2, (len(TOUCHED), 5))
        during = before * (1 + 0.1 * (day + 1))
        np.savez(folder / f"day{day}.npz", patterns=TOUCHED, before=before, during=during)
    return folder


OPTIONS = ImportOptions(
    channels="day*.npz", channel_columns="during", before="before", sites="patterns"
)


def test_every_file_is_a_session_and_places_of_an_array_are_letters(tmp_path: Path) -> None:
    data = import_folder(write_days(tmp_path / "lab"), tmp_path / "data", OPTIONS)
    again = open_recording(tmp_path / "data")
    assert again.sites == ("A", "B", "C")
    assert again.sessions == ("day0",) * 4 + ("day1",) * 4
    assert [str(scene.sites) for scene in again.site_scenes()] == ["A", "B+C", "A+B+C", "C"] * 2
    assert len(set(again.names)) == len(set(again.presses)) == len(data.samples) == 8


def test_columns_of_a_table_name_their_places(tmp_path: Path) -> None:
    lines = ["thumb,palm,c1,c2", "1,0,0.5,0.1", "1,1,0.7,0.2"]
    (tmp_path / "glove.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    options = ImportOptions(channels="glove.csv", channel_columns="c1:c2", sites="thumb,palm")
    recording = open_recording(tmp_path, options)
    assert [str(scene.sites) for scene in recording.site_scenes()] == ["thumb", "thumb+palm"]
    served = {service.protocol: service for service in served_protocols(recording)}
    assert [name for name, service in served.items() if service.served] == ["sites"]
    assert served["sites"].reason == "2 trials of 2 named places, 1 sessions"


def test_files_that_differ_or_are_not_there_are_one_sentence(tmp_path: Path) -> None:
    folder = write_days(tmp_path / "lab")
    np.savez(folder / "day2.npz", patterns=TOUCHED, before=np.ones((4, 6)), during=np.ones((4, 6)))
    with pytest.raises(UserError, match=r"day2\.npz has 6 channels .* one by one"):
        open_recording(folder, OPTIONS)
    with pytest.raises(UserError, match=r"holds no file night\*\.npz"):
        open_recording(folder, ImportOptions(channels="night*.npz", sites="patterns"))
