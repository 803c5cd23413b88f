"""Each protocol draws its own pictures beside the record."""

from __future__ import annotations

import numpy as np
import pytest
from report_material import contact_parts, exp2_metrics, pair_parts
from stored_answers import store_run

from tactibench.report import draw_pictures, update_pictures

PNG = b"\x89PNG\r\n\x1a\n"


def single_parts():
    """Presses whose errors differ, so that they have a histogram."""
    parts = contact_parts()
    places = parts["predictions"]["xy"]
    parts["predictions"]["xy"] = places + np.linspace(0, 0.1, len(places))[:, None]
    return parts


@pytest.mark.parametrize(
    ("protocol", "parts", "names"),
    [
        ("exp1", single_parts(), {"frame.png", "errors.png"}),
        ("exp2", pair_parts(), {"distance.png"}),
        ("surface", contact_parts(), set()),
    ],
)
def test_a_run_leaves_its_pictures(tmp_path, fabricate, protocol, parts, names):
    more = {"metrics": exp2_metrics(0.2)} if protocol == "exp2" else {}
    run = store_run(tmp_path, fabricate(protocol, **more), parts)
    drawn = draw_pictures(run)
    assert (
        {path.name for path in drawn} == {path.name for path in run.folder.glob("*.png")} == names
    )
    assert all(path.read_bytes().startswith(PNG) for path in drawn)


def test_pictures_that_are_there_are_not_drawn_again(tmp_path, fabricate):
    run = store_run(tmp_path, fabricate(), contact_parts())
    (run.folder / "frame.png").write_bytes(b"")
    assert update_pictures(run) == [run.folder / "frame.png"]
