"""Plain CSV files and Hugging Face image folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tactibench import Indenter, Pose, Scene, UserError
from tactibench.datasets import import_folder, open_recording, read_options, read_table


def frames(folder, count, stem="f"):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        image = np.random.default_rng(i).integers(0, 256, (8, 9), dtype=np.uint8)
        assert cv2.imwrite(str(folder / f"{stem}{i}.png"), image)


@pytest.fixture
def plain(tmp_path):
    folder = tmp_path / "plain"
    frames(folder / "images", 4)
    text = "file_name,x_mm,y_mm,depth_mm,force,who\n"
    text += "".join(f"f{i}.png,{i},-{i}.5,{i + 1},0.{i},me\n" for i in range(4))
    (folder / "labels.csv").write_text(text)
    return folder


def test_contact_columns_become_presses_by_a_tip(plain, tmp_path):
    assert open_recording(plain).format == "csv"
    dataset = import_folder(plain, tmp_path / "out", read_options(["radius_mm=2.5"]))
    assert [s.scene for s in dataset.samples] == [
        Scene(Indenter.single(2.5), Pose(float(i), -i - 0.5, depth=float(i + 1))) for i in range(4)
    ]
    contacts = dataset.contacts(dataset.samples[2])
    np.testing.assert_allclose([*contacts.xy[0], contacts.depth[0]], [2, -2.5, 3])
    assert dataset.samples[2].labels["force"] == 0.2
    assert dataset.samples[2].extra["who"] == "me"


def test_labels_and_name_column_can_be_chosen(plain, tmp_path):
    options = read_options(["labels=force", "indenter=none", "column=file_name"])
    sample = import_folder(plain, tmp_path / "out", options).samples[1]
    assert sample.labels == {"force": 0.1}
    assert sample.scene is None
    assert sample.extra["x_mm"] == "1"


def test_names_with_folders_keep_the_rest_frame_of_their_place(plain):
    frames(plain / "images" / "a", 4)
    frames(plain / "images", 1, stem="init_")
    (plain / "init_setup.png").write_bytes(b"no frame, and not asked for")
    text = (plain / "labels.csv").read_text().replace("\nf", "\na/f")
    (plain / "labels.csv").write_text(text)
    recording = open_recording(plain)
    assert recording.frames == plain / "images"
    assert recording.rest == plain / "images" / "init_0.png"


def test_other_contact_columns(plain, tmp_path):
    text = (plain / "labels.csv").read_text().replace("x_mm", "u").replace("depth_mm", "w")
    (plain / "labels.csv").write_text(text)
    recording = open_recording(plain)
    assert recording.scenes == (None,) * 4
    assert any("x_mm, depth_mm is missing" in note for note in recording.notes)
    options = read_options(["indenter=single", "x=u", "depth=w", "offset_mm=-1"])
    scenes = open_recording(plain, options).scenes
    assert scenes[3].pose == Pose(3.0, -3.5, depth=3.0)


def test_several_csv_files_ask_which(plain, refused):
    (plain / "more.csv").write_text("a\n1\n")
    refused(lambda: open_recording(plain), "labels.csv, more.csv", "--param table")
    assert len(open_recording(plain, read_options(["table=labels.csv"]))) == 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("indenter", ("NAME=VALUE",)),
        ("indentr=plate", ("did you mean 'indenter'",)),
        ("indenter=ball", ("'ball'", "plate")),
        ("offset_mm=nan", ("offset_mm",)),
        ("radius_mm=0", ("radius_mm", "0.01")),
    ],
)
def test_options_that_are_not_understood(refused, text, words):
    refused(lambda: read_options([text]), *words)
    refused(lambda: read_options(["pivot_mm=1", "pivot_mm=2"]), "given twice")


def test_a_cell_of_spaces_is_an_empty_one():
    table = read_table(Path("a.csv"), b"frame, depth\na.png,   2.1\nb.png,      \n")
    assert table.numbers("depth", allow_empty=True).tolist() == pytest.approx(
        [2.1, float("nan")], nan_ok=True
    )
    with pytest.raises(UserError, match="row 2: depth is '      '"):
        table.numbers("depth")
