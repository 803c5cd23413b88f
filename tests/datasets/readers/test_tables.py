"""Plain CSV files and Hugging Face image folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

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


ROWS = [["a.png", "1.5", "-2"], ["b.png", "3", "4.25"]]
PLAIN = "file,x,depth\na.png,1.5,-2\nb.png,3,4.25\n"
FORMS = {
    "comma": PLAIN.encode(),
    "semicolon": PLAIN.replace(",", ";").encode(),
    "decimal comma": PLAIN.replace(",", ";").replace("1.5", "1,5").replace("4.25", "4,25").encode(),
    "tab": PLAIN.replace(",", "\t").encode(),
    "spaces": PLAIN.replace(",", "   ").replace("\n", "\n  ").encode(),
    "spaces and decimal comma": PLAIN.replace(",", " ")
    .replace("1.5", "1,5")
    .replace("4.25", "4,25")
    .encode(),
    "byte-order mark": PLAIN.encode("utf-8-sig"),
    "UTF-16": PLAIN.encode("utf-16"),
    "UTF-16 without mark": PLAIN.encode("utf-16-le"),
    "sep line": ("sep=;\n" + PLAIN.replace(",", ";")).encode(),
    "comment header": ("# recorded today\n# " + PLAIN).encode(),
    "title line": ("Recording 7\n\n" + PLAIN).encode(),
    "quotes": PLAIN.replace("a.png", '"a.png"').replace("1.5", '"1.5"').encode(),
    "trailing separators": PLAIN.replace("\n", ",\n").encode(),
    "Windows lines": PLAIN.replace("\n", "\r\n").encode(),
    "no last line break": PLAIN.rstrip().encode(),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_text_table_of_any_form(form):
    table = read_table(Path("t.txt"), FORMS[form])
    assert table.columns == ("file", "x", "depth")
    assert table.numbers("x").tolist() == [1.5, 3]
    assert table.numbers("depth").tolist() == [-2, 4.25]
    assert [cell.strip() for cell in table.cells["file"]] == ["a.png", "b.png"]


def test_units_below_the_header_are_part_of_the_names():
    table = read_table(
        Path("t.csv"), "file;x;t;n\n;[µm];(s);-\na;1;2;3\nb;4;5;6\n".encode("cp1252")
    )
    assert table.columns == ("file", "x [um]", "t [s]", "n")
    assert len(table) == 2


@pytest.mark.parametrize("first", ["a.png,1,2", "1,2,3", "nan,2,3"])
def test_a_first_line_like_the_others_is_no_header(first):
    table = read_table(Path("t.csv"), f"{first}\n{first}\n{first}\n".encode())
    assert table.columns == ("column_1", "column_2", "column_3")
    assert (len(table), table.header) == (3, False)


def arrays():
    rng = np.random.default_rng(2)
    return {
        "xy": rng.normal(size=(7, 2)),
        "taxels": rng.normal(size=(7, 3, 4)),
        "t": np.arange(7.0),
    }


def write_arrays(path):
    values = arrays()
    if path.suffix == ".npz":
        np.savez(path, **values)
    elif path.suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
        pd.DataFrame({"t": values["t"], "name": ["a"] * 7}).to_parquet(path)
    elif path.name == "old.mat":
        savemat(path, {"trial": values, "note": "hello"})
    else:
        h5py = pytest.importorskip("h5py", reason="h5py is not installed")
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, value in values.items():
                data = value.T if path.suffix == ".mat" else value
                file.create_dataset(f"trial/{name}", data=data)
                if path.suffix == ".mat":
                    file[f"trial/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
        if path.suffix == ".mat":
            path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])


@pytest.mark.parametrize("name", ["a.npz", "old.mat", "new.mat", "a.h5", "a.parquet"])
def test_arrays_are_columns(tmp_path, name):
    write_arrays(tmp_path / name)
    table = read_table(tmp_path / name, (tmp_path / name).read_bytes())
    (time,) = [column for column in table.columns if column.endswith("t")]
    assert table.numbers(time).tolist() == list(range(7))
    if name == "a.parquet":
        return
    (prefix,) = {column.rpartition("taxels")[0] for column in table.select("*taxels*")}
    names = table.select(f"{prefix}taxels")
    assert table.shape(names) == (3, 4)
    values = np.column_stack([table.numbers(column) for column in names])
    assert np.array_equal(values, arrays()["taxels"].reshape(7, -1))
    assert np.array_equal(table.numbers(f"{prefix}xy_2"), arrays()["xy"][:, 1])


@pytest.mark.parametrize("name", ["a.mat", "a.h5", "a.npz", "a.npy", "a.parquet"])
def test_a_file_that_is_no_such_table_is_one_sentence(refused, name):
    if name in ("a.h5", "a.parquet"):
        pytest.importorskip("h5py" if name == "a.h5" else "pyarrow", reason="not installed")
    for data in (b"", b"junk", b"PK\x03\x04" + bytes(90), b"MATLAB 5.0 MAT-file".ljust(140, b"\1")):
        refused(lambda data=data: read_table(Path(name), data), name)
