"""Published predictions: found beside the data, aligned by name, refused when foreign."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tactibench import PlatePose, UserError
from tactibench.protocols import ReleasedAnswers, load_protocol
from tactibench.records import file_hash
from tactibench.run import PublishedPredictions, find_published, published_arrays, unpack_published
from tactibench.run import published_predictions as module

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "tac-vgnn"
NAMES = ("a.png", "b.png", "c.png")
PREDICTED = [(-1.5, 2.0), (-2.0, -9.0), (-3.25, 0.5)]
LABELS = [(-1.0, 1.0), (-2.5, -10.0), (-3.0, 0.25)]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "answers.csv"
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["", "p1", "t1", "p2", "t2"])
        for k, (p, t) in enumerate(zip(PREDICTED, LABELS, strict=True)):
            rows.writerow([k, f"tensor({p[0]})", f"tensor({t[0]})", p[1], f" {t[1]} "])
    return path


@pytest.fixture
def one(file):
    keys = ReleasedAnswers(
        file=file.name, sha256=file_hash(file), depth=("p1", "t1"), tilt=("p2", "t2")
    )
    return PublishedPredictions("paper", "Net", keys, file)


def truth(offset=5.0, bend=0.0):
    return [PlatePose(d + offset + bend * t**2, t) for d, t in LABELS]


def test_answers_stand_by_name_and_keep_their_errors(one):
    order = ["c.png", "a.png"]
    true = [truth()[2], truth()[0]]
    (poses,) = unpack_published(published_arrays([one], NAMES, order, true)).values()
    error = [(p.depth - t.depth, p.tilt - t.tilt) for p, t in zip(poses, true, strict=True)]
    np.testing.assert_allclose(error, [(-0.25, 0.25), (-0.5, 1.0)])


def test_other_tilts_or_another_count_are_refused(one):
    wrong = [replace(pose, tilt=pose.tilt + 0.1) for pose in truth()]
    with pytest.raises(UserError, match=r"answers.csv holds answers to other tilts .*0.1 deg"):
        published_arrays([one], NAMES, NAMES, wrong)
    with pytest.raises(UserError, match="3 rows for 4 test frames"):
        published_arrays([one], (*NAMES, "d.png"), NAMES, truth())


def test_a_column_that_is_no_number_is_refused(one):
    keys = one.file.model_copy(update={"depth": ("no such", "t1")})
    with pytest.raises(UserError, match="columns no such and t1 must hold finite numbers"):
        published_arrays([replace(one, file=keys)], NAMES, NAMES, truth())


@pytest.fixture
def published(monkeypatch, one):
    """One table with the small file, in place of the shipped ones."""
    row = SimpleNamespace(protocol="surface", model="Net", released=one.file)
    table = SimpleNamespace(name="paper", rows=(row,))
    monkeypatch.setattr(module, "load_published", lambda _names, _folder=None: [table])
    return load_protocol("surface")


@pytest.mark.parametrize("inside", ["", "331", "331/recording"])
def test_it_is_looked_for_beside_the_data(published, file, inside):
    data = file.parent / inside
    data.mkdir(parents=True, exist_ok=True)
    (found,) = find_published(published, data, None)
    assert found.path is not None
    assert found.path.resolve() == file.resolve()


def test_a_given_file_is_taken_wherever_it_lies_or_refused(published, file, tmp_path):
    moved = tmp_path / "elsewhere.csv"
    moved.write_bytes(file.read_bytes())
    file.unlink()
    (found,) = find_published(published, None, moved)
    assert found.path == moved
    moved.write_text("other")
    with pytest.raises(UserError, match=r"not a file that was released.*answers.csv \(Net\)"):
        find_published(published, None, moved)
    with pytest.raises(UserError, match="cannot be read"):
        find_published(published, None, tmp_path / "nothing.csv")


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data/tac-vgnn is not there")
def test_the_released_file_gives_the_published_errors():
    """0.0552 mm and 1.011 deg over 1,210 frames, from columns 1 (depth) and 2 (roll)."""
    (found,) = find_published(load_protocol("surface"), DATA / "331", None)
    assert found.path is not None
    columns = [
        module.read_columns(found.path, pair) for pair in (found.file.depth, found.file.tilt)
    ]
    errors = [float(np.abs(column[:, 0] - column[:, 1]).mean()) for column in columns]
    assert len(columns[0]) == 1210
    assert errors == pytest.approx([0.0552, 1.011], abs=5e-4)
