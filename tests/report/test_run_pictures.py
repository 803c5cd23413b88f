"""Each protocol draws its own pictures beside the record."""

from __future__ import annotations

import numpy as np
import pytest
from report_material import contact_parts, exp2_metrics, pair_parts
from stored_answers import store_run

from tactibench.contacts import Contacts
from tactibench.records import pack_contacts, unpack_contacts
from tactibench.report import draw_pictures, run_pictures, update_pictures

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


def test_the_errors_are_those_of_the_sensor_of_the_training(tmp_path, fabricate, monkeypatch):
    drawn = {}
    monkeypatch.setattr(run_pictures, "single_figure", lambda t, p, **_: drawn.update(n=len(t)))
    monkeypatch.setattr(run_pictures, "image_bytes", lambda *_: PNG)
    parts = single_parts()
    groups = parts["truth"]["group"].astype("U20")
    groups[:3] = "unseen:instance-1"
    parts["truth"]["group"] = groups
    draw_pictures(store_run(tmp_path, fabricate(), parts))
    assert drawn == {"n": len(groups) - 4}  # three are of another sensor, one has no answer


def test_a_run_on_pairs_shows_a_pair(tmp_path, fabricate, monkeypatch):
    shown = []
    monkeypatch.setattr(run_pictures, "contacts_figure", lambda frames, **_: shown.extend(frames))
    monkeypatch.setattr(run_pictures, "image_bytes", lambda *_: PNG)
    parts = pair_parts()
    contacts = [*unpack_contacts(parts["truth"])[:3], *[Contacts.truth([[0, 0]], [1.0])] * 5]
    parts["truth"] = {
        **pack_contacts(contacts),
        "press": np.arange(8).astype(str),
        "group": np.array(["7.0"] * 8),
    }
    parts["predictions"] = pack_contacts(contacts)
    parts["examples"] = {"index": np.arange(8), "images": np.zeros((8, 9, 9), np.uint8)}
    draw_pictures(store_run(tmp_path, fabricate("exp2", metrics=exp2_metrics(0.2)), parts))
    assert [len(example.truth) for _, example in shown] == [2]
