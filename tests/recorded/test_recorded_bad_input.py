"""Every mistake in a recorded folder is one sentence that says where and what."""

from __future__ import annotations

import shutil
import zlib

import cv2
import numpy as np
import pytest
from png_bytes import png

from tactibench import UserError


def edit(folder, row, old, new):
    """Replace text in one row of targets.csv, counted from 1 below the header."""
    path = folder / "targets.csv"
    lines = path.read_text().splitlines()
    assert old in lines[row]
    lines[row] = lines[row].replace(old, new)
    path.write_text("\n".join(lines) + "\n")


def refused(open_recording, folder, *parts):
    """Opening is refused with one sentence that holds every part."""
    with pytest.raises(UserError) as caught:
        open_recording(folder)
    text = str(caught.value)
    assert text.endswith(".")
    assert not text.endswith("..")
    assert "\n" not in text
    for part in parts:
        assert part in text
    return text


def test_no_data(open_recording):
    refused(open_recording, None, "--data")


def test_no_such_folder(open_recording, tmp_path):
    refused(open_recording, tmp_path / "nowhere", "nowhere", "does not exist")


def test_a_file_instead_of_a_folder(open_recording, recording):
    refused(open_recording, recording / "targets.csv", "is a file")


def test_no_targets(open_recording, recording):
    (recording / "targets.csv").unlink()
    refused(open_recording, recording, "plates", "no targets.csv")
    refused(open_recording, recording.parent, "no targets.csv")


def test_several_recordings(open_recording, recording):
    shutil.copytree(recording, recording.parent / "again")
    refused(open_recording, recording.parent, "again, plates")


def test_no_frames_folder(open_recording, recording):
    (recording / "frames_bw").rename(recording / "pictures")
    refused(open_recording, recording, "frames_bw, images, sensor_images, processed_images")


@pytest.mark.parametrize("column", ["image_name", "pose_2", "pose_6"])
def test_missing_column(open_recording, recording, column):
    edit(recording, 0, column, "other")
    refused(open_recording, recording, "targets.csv", column, "its columns are")


def test_missing_frames_are_counted(open_recording, recording):
    for i in (1, 3):
        (recording / "frames_bw" / f"frame_{i}_0.png").unlink()
    refused(open_recording, recording, "2 frames", "frame_1_0.png")
    (recording / "frames_bw" / "frame_1_0.png").mkdir()
    refused(open_recording, recording, "2 frames", "frame_1_0.png")


def test_one_missing_frame(open_recording, recording):
    (recording / "frames_bw" / "frame_4_0.png").unlink()
    refused(open_recording, recording, "1 frame that is not", "frame_4_0.png")


@pytest.mark.parametrize("name", ["frame_2_0.png", "init_0.png"])
@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda data: b"", "not a PNG"),
        (lambda data: b"GIF89a" + data, "not a PNG"),
        (lambda data: data[:20], "cut short"),
        (lambda data: data[: len(data) // 2], "cut short"),
        (lambda data: data[:-1], "cut short"),
        (lambda data: data[:60] + bytes([data[60] ^ 255]) + data[61:], "checksum"),
    ],
)
def test_damaged_png(open_recording, recording, name, damage, says):
    path = recording / "frames_bw" / name
    path.write_bytes(damage(path.read_bytes()))
    refused(open_recording, recording, name, says)


@pytest.mark.parametrize("data", [b"", b"no picture"])
def test_frame_that_breaks_after_opening(open_recording, recording, data):
    sensor = open_recording(recording)
    (recording / "frames_bw" / "frame_2_0.png").write_bytes(data)
    scenes = list(sensor.scenes().values())
    with pytest.raises(UserError, match=r"frame_2_0\.png cannot be decoded"):
        list(sensor.press_many(scenes))
    assert sensor.press(scenes[3]).timestamp == 3


def test_the_png_writer_of_these_tests_is_right(open_recording, recording):
    rows = np.hstack([np.zeros((12, 1), np.uint8), np.full((12, 10), 7, np.uint8)])
    data = png(10, 12, zlib.compress(rows.tobytes()))
    (recording / "frames_bw" / "frame_0_0.png").write_bytes(data)
    sensor = open_recording(recording)
    assert (sensor.press(next(iter(sensor.scenes().values()))).image == 7).all()


@pytest.mark.parametrize(
    ("size", "pixels"),
    [((10, 12), b"junk"), ((10, 12), zlib.compress(b"few")), ((90_000, 90_000), b"")],
)
def test_frame_whose_pixels_cannot_be_decoded(open_recording, recording, size, pixels):
    for path in (recording / "frames_bw").iterdir():
        path.write_bytes(png(*size, pixels))
    sensor = open_recording(recording)
    with pytest.raises(UserError, match=r"init_0\.png cannot be decoded"):
        sensor.rest()
    with pytest.raises(UserError, match=r"frame_0_0\.png cannot be decoded"):
        sensor.press(next(iter(sensor.scenes().values())))


def test_frame_that_vanishes_after_opening(open_recording, recording):
    sensor = open_recording(recording)
    (recording / "frames_bw" / "frame_0_0.png").unlink()
    with pytest.raises(UserError, match=r"frame_0_0\.png cannot be read"):
        sensor.press(next(iter(sensor.scenes().values())))


def test_frame_that_changes_size_after_opening(open_recording, recording):
    sensor = open_recording(recording)
    cv2.imwrite(str(recording / "frames_bw" / "frame_0_0.png"), np.zeros((4, 5), np.uint8))
    with pytest.raises(UserError, match=r"frame_0_0\.png changed its size to 4x5"):
        sensor.press(next(iter(sensor.scenes().values())))


@pytest.mark.parametrize("name", ["frame_3_0.png", "init_0.png"])
@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.zeros((12, 11), np.uint8), "12x11 gray"),
        (np.zeros((12, 10, 3), np.uint8), "12x10 colour"),
    ],
)
def test_frames_that_differ(open_recording, recording, name, image, says):
    cv2.imwrite(str(recording / "frames_bw" / name), image)
    refused(open_recording, recording, name, says, "12x10 gray")


@pytest.mark.parametrize("again", ["frame_0_0.png", "./frame_0_0.png", " frame_0_0.png"])
def test_duplicate_name(open_recording, recording, again):
    edit(recording, 4, "frame_3_0.png", again)
    refused(open_recording, recording, "targets.csv", "rows 1 and 4", "frame_0_0.png")


@pytest.mark.parametrize("text", ["nan", "", "inf", "-inf", "deep", "1,5"])
@pytest.mark.parametrize(("column", "old"), [("pose_2", "-0.75"), ("pose_6", "3.0")])
def test_label_that_is_no_number(open_recording, recording, text, column, old):
    edit(recording, 3, old, f'"{text}"')
    refused(open_recording, recording, "targets.csv row 3", column, repr(text))


def test_row_with_too_few_fields(open_recording, recording):
    edit(recording, 5, ",0,0,0,10.0", "")
    refused(open_recording, recording, "row 5", "pose_3")


def test_row_with_too_many_fields(open_recording, recording):
    edit(recording, 2, "frame_1", "extra,extra,frame_1")
    refused(open_recording, recording, "targets.csv")


def test_all_rows_with_too_many_fields(open_recording, recording):
    for row in range(1, 6):
        edit(recording, row, "frame", "extra,frame")
    refused(open_recording, recording, "more fields than its header")


@pytest.mark.parametrize(
    ("data", "says"),
    [(b"", "is empty"), (b"\xff\xfe\x00junk,\xd8", "not a readable CSV"), (None, "no rows")],
)
def test_targets_without_rows(open_recording, recording, data, says):
    path = recording / "targets.csv"
    header = path.read_bytes().splitlines()[0] + b"\n"
    path.write_bytes(header if data is None else data)
    refused(open_recording, recording, "targets.csv", says)


@pytest.mark.parametrize(
    "name",
    ["../secret.png", r"..\secret.png", "a/../../b.png", "/etc/x.png", r"C:\x.png", r"\x.png"],
)
def test_names_never_lead_outside(open_recording, recording, name):
    cv2.imwrite(str(recording / "secret.png"), np.zeros((12, 10), np.uint8))
    edit(recording, 2, "frame_1_0.png", name)
    refused(open_recording, recording, "row 2", repr(name), "inside the frames folder")


def test_row_without_a_name(open_recording, recording):
    edit(recording, 2, "frame_1_0.png", " ")
    refused(open_recording, recording, "row 2", "names no frame")
