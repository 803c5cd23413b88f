"""Every mistake in a source is one sentence with file and row, and nothing is half imported."""

from __future__ import annotations

import errno
import zlib

import cv2
import numpy as np
import pytest
from png_bytes import png

from tactibench.datasets import (
    ImportOptions,
    Writer,
    import_folder,
    open_dataset,
    open_recording,
    verify,
)


@pytest.fixture
def unimported(refused, tmp_path):
    """Folder, words -> the import is refused with these words and leaves nothing behind."""

    def check(folder, *words, options=None):
        before = sorted(p.name for p in tmp_path.iterdir())
        text = refused(lambda: import_folder(folder, tmp_path / "out", options), *words)
        assert sorted(p.name for p in tmp_path.iterdir()) == before
        return text

    return check


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data: data[: len(data) // 2], "cut short"),
        (lambda data: b"GIF89a" + data, "not a PNG"),
        (lambda _: cv2.imencode(".png", np.zeros((12, 10, 3), np.uint8))[1].tobytes(), "10 colour"),
        (lambda data: data[:60] + bytes([data[60] ^ 255]) + data[61:], "checksum"),
        (lambda data: png(10, 12, b"junk"), "cannot be decoded"),
        (lambda data: png(10, 12, zlib.compress(bytes(252)), bits=16), "16 bits a pixel"),
    ],
)
@pytest.mark.parametrize("name", ["frame_3_0.png", "init_0.png"])
def test_damaged_frames(first, unimported, name, damage, words):
    path = first / "frames_bw" / name
    path.write_bytes(damage(path.read_bytes()))
    unimported(first, name, words)


def test_an_image_bomb_is_not_decoded(first, unimported):
    for path in (first / "frames_bw").iterdir():
        path.write_bytes(png(60_000, 60_000, zlib.compress(bytes(1000))))
    unimported(first, "60,000 x 60,000 pixels", "64,000,000")


def test_names_that_are_no_files(first, unimported):
    for i in (1, 3):
        (first / "frames_bw" / f"frame_{i}_0.png").unlink()
    unimported(first, "targets.csv", "frame_1_0.png (and 1 more)", "not in", "frames_bw")
    (first / "raw").mkdir()
    for i in (1, 3):  # pictures of another kind are no frames of this table
        (first / "raw" / f"frame_{i}_0.png").write_bytes(
            (first / "frames_bw" / "frame_2_0.png").read_bytes()
        )
    unimported(first, "frame_1_0.png (and 1 more)", "frames_bw")
    (first / "frames_bw" / "frame_1_0.png").mkdir()
    unimported(first, "targets.csv", "frame_1_0.png (and 1 more)")
    (first / "frames_bw" / "frame_1_0.png").rmdir()
    for path in (first / "frames_bw").glob("frame*"):
        path.unlink()
    unimported(first, "(and 4 more)", options=ImportOptions(missing="skip"))


def replace(old, new):
    """Change the first place of the table in which a text stands."""

    def change(folder):
        path = folder / "targets.csv"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return change


def write(data, name="targets.csv"):
    return lambda folder: (folder / name).write_bytes(data)


def unquoted_commas(folder):
    lines = (folder / "targets.csv").read_text().splitlines()
    tail = [line.replace(".25", ",25").replace("png,", ".png,") for line in lines[1:]]
    (folder / "targets.csv").write_text("\n".join([lines[0], *(f"{line},0,0" for line in tail)]))


def mixed_commas(folder):
    path = folder / "targets.csv"
    path.write_text(path.read_text().replace(",", ";").replace("-0.75", "-0,75"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        *(
            (replace("frame_3_0.png", again), ["rows 1 and 4", "frame_0_0.png"])
            for again in ("frame_0_0.png", r".\frame_0_0.png")
        ),
        *(
            (replace("frame_1_0.png", name), ["names the frame", name[-5:], "not in"])
            for name in (*("a/../../b.png", "/etc/x.png", r"C:\x.png"),)
        ),
        *(
            (replace(old, new), ["row 3", column, repr(text)])
            for text in ("nan", "", "deep")
            for old, new, column in (
                ("-0.75", text, "pose_2"),
                ("3.0,2\n", f"3.0,{text}\n", "move_1"),
            )
        ),
        (replace("-0.75", '"-0,75"'), ["row 3", "'-0,75'", "decimal commas", "';'"]),
        (unquoted_commas, ["saw 12", "decimal commas", "';'"]),
        (mixed_commas, ["row 3", "'-0,75'", "row 1", "'-0.25'", "one way"]),
        (replace(",10.0,4", ""), ["cut off", "Expected 9", "line 6, saw 7"]),
        (replace("frame_1", "extra,extra,frame_1"), ["line 3, saw"]),
        (write(b"image_name,pose_2,pose_6\n"), ["no rows"]),
        (write(b"image_name,pose_2,pose_2\nframe_0_0.png,1,2\n"), ["two columns 'pose_2'"]),
        (write(b"first,pose_2\nframe_0_0.png,1\n"), ["names the frames", "column=COLUMN"]),
        (write(b"image_name,pose_2\n ,1\n"), ["row 1 names no frame"]),
        (write(b"\xff\xfe\x00junk,\xd8"), ["not a readable CSV"]),
        (write(b""), ["is empty; it must have a header"]),
    ],
)
def test_a_mistake_in_the_table_is_named(first, unimported, change, words):
    change(first)
    unimported(first, "targets.csv", *words)


@pytest.mark.parametrize("data", [b"{", b'{"exposure": NaN}'])
def test_a_damaged_description_is_left_out_where_labels_do_not_need_it(first, data):
    write(data, "meta.json")(first)
    assert any("meta.json" in note and "JSON" in note for note in open_recording(first).notes)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"indenter": "plate", "depth": "pose_9"}, ["pose_9", "did you mean"]),
        ({"indenter": "plate", "depth": "pose_2,pose_1"}, ["no column 'pose_2,pose_1'"]),
        ({"indenter": "plate", "depth": "nan"}, ["no column 'nan'"]),
        ({"indenter": "plate", "tilt": "5"}, ["no column '5'"]),
        ({"indenter": "single", "x": "pose_1,pose_2"}, ["one column each", "2 for x"]),
        ({"indenter": "plate", "depth": "pose_1"}, ["pose_1 has the same value", "pose_2 changes"]),
        ({"press": "tap"}, ["no column 'tap'"]),
        ({"labels": "wrong"}, ["no column 'wrong'"]),
    ],
)
def test_columns_that_are_not_there(first, unimported, options, words):
    unimported(first, *words, options=ImportOptions(**options))


def test_folders_that_are_none(tmp_path, refused, first, second):
    refused(lambda: open_recording(tmp_path / "no"), "does not exist")
    refused(lambda: open_recording(first / "targets.csv"), "is a file")
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", first.parent):  # several recordings lie in the other one
        refused(lambda folder=folder: open_recording(folder), "targets.csv")


def test_targets_that_cannot_be(first, tmp_path, unimported, refused):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep")
    unimported(first, "out", "is there already")
    assert (tmp_path / "out" / "mine.txt").read_text() == "keep"
    refused(lambda: import_folder(first, tmp_path / "no" / "out"), "is not there")
    refused(lambda: import_folder(first, first / "out"), "lies in")
    assert not (first / "out").exists()
    import_folder(first, tmp_path / "set")
    refused(lambda: import_folder(tmp_path / "set", tmp_path / "again"), "data set", "copy")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left")])
def test_an_interruption_leaves_nothing(first, tmp_path, monkeypatch, error):
    def stop(self, drafts):
        raise error

    monkeypatch.setattr(Writer, "add_many", stop)
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(type(error) if isinstance(error, OSError) else error):  # a full disk as such
        import_folder(first, tmp_path / "out")
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_a_frame_that_changes_after_the_import_is_found(first, tmp_path, refused):
    dataset = import_folder(first, tmp_path / "out")
    path = tmp_path / "out" / dataset.samples[2].file_name
    assert cv2.imwrite(str(path), np.zeros((12, 10), np.uint8))
    (finding,) = verify(tmp_path / "out")
    assert "000002.png" in finding
    again = open_recording(tmp_path / "out")
    refused(lambda: again.image(2), "000002.png", "changed")
    assert [*open_dataset(tmp_path / "out").samples] == [*dataset.samples]
