"""Frames as cameras and people leave them: formats, depths, turns, videos, names, junk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactibench import UserError
from tactibench.datasets import guess_mapping, import_folder, open_recording, read_options, verify

COUNT = 6


def frame(row: int) -> np.ndarray:
    image = np.zeros((16, 24), np.uint8)
    image[4:8, 3 * row : 3 * row + 4] = 200
    return image


def folder_of(tmp_path: Path, suffix: str, names: str = "{}") -> Path:
    folder = tmp_path / "lab"
    (folder / "shots").mkdir(parents=True)
    for row in range(COUNT):
        Image.fromarray(frame(row)).save(folder / "shots" / f"f{row}{suffix}")
    lines = [f"{names.format(f'f{row}{suffix}')},{row - 3},{row % 2},1" for row in range(COUNT)]
    (folder / "log.csv").write_text("\n".join(["file,x_mm,y_mm,depth_mm", *lines]))
    return folder


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".JPG", ".bmp", ".tif"])
def test_pictures_of_any_format_become_png(tmp_path: Path, suffix: str) -> None:
    dataset = import_folder(folder_of(tmp_path, suffix), tmp_path / "out")
    assert verify(dataset.folder) == []
    for row, sample in enumerate(dataset.samples):
        apart = np.abs(dataset.signal(sample).astype(int) - frame(row))
        assert apart.max() <= (30 if suffix.lower() == ".jpg" else 0)


def test_16_bits_become_8_by_the_brightest_pixel_of_all(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ".png")
    for row in range(COUNT):  # a camera of 12 bits
        deep = frame(row).astype(np.uint16) * 16
        assert cv2.imwrite(str(folder / "shots" / f"f{row}.png"), deep)
    recording = open_recording(folder)
    assert np.array_equal(recording.image(2), frame(2))
    assert any("12 bits a pixel" in note for note in recording.notes)
    Image.fromarray(frame(3)).save(folder / "shots" / "f3.png")
    with pytest.raises(UserError, match=r"f3\.png is 16x24 gray, but .* must be alike"):
        open_recording(folder)


def test_a_picture_is_turned_as_its_exif_says(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ".jpg")
    exif = Image.Exif()
    exif[0x0112] = 6  # turned by a quarter
    for row in range(COUNT):
        Image.fromarray(frame(row)).save(folder / "shots" / f"f{row}.jpg", exif=exif)
    assert open_recording(folder).image(0).shape == (24, 16)


@pytest.mark.parametrize(
    "names", ["/home/me/rec/shots/{}", r"D:\data\lab\shots\{}", "../elsewhere/shots/{}", "shots/{}"]
)
def test_names_from_another_machine_are_found_by_their_last_parts(
    tmp_path: Path, names: str
) -> None:
    folder = folder_of(tmp_path, ".png", names)
    for junk in ("._f0.png", "Thumbs.db", ".DS_Store"):
        (folder / "shots" / junk).write_bytes(b"junk")
    recording = open_recording(folder)
    assert [path.name for path in recording.paths] == [f"f{row}.png" for row in range(COUNT)]
    assert guess_mapping(folder).options["column"] == "file"


def test_a_table_in_a_neighbour_folder_is_found(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ".png")
    (folder / "labels").mkdir()
    (folder / "log.csv").rename(folder / "labels" / "log.csv")
    (folder / "labels" / "._log.csv").write_bytes(b"\0junk")
    assert len(open_recording(folder)) == COUNT
    assert guess_mapping(folder).options["table"] == "labels/log.csv"


def test_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ".png", "run1/{}")
    text = (folder / "log.csv").read_text().replace("run1/f3", "run2/f1")
    (folder / "log.csv").write_text(text)
    with pytest.raises(UserError, match=r"rows 2 and 4 both name the frame f1\.png"):
        open_recording(folder)


def test_a_video_with_a_table_of_its_frames(tmp_path: Path) -> None:
    folder = tmp_path / "video"
    folder.mkdir()
    video = cv2.VideoWriter(
        str(folder / "run.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (48, 32), True
    )
    if not video.isOpened():
        pytest.skip("OpenCV writes no MJPG here")
    for row in range(COUNT):
        big = cv2.resize(frame(row), (48, 32), interpolation=cv2.INTER_NEAREST)
        video.write(np.repeat(big[..., None], 3, axis=2))
    video.release()
    rows = [f"{row + 1},{row - 3},{row % 2},1" for row in (4, 0, 5)]
    (folder / "log.csv").write_text("\n".join(["frame,x_mm,y_mm,depth_mm", *rows]))
    recording = open_recording(folder, read_options(["column=frame"]))
    assert recording.kind.shape == (32, 48)
    centre = [np.argwhere(recording.image(row) > 100).mean(axis=0)[1] / 2 for row in range(3)]
    assert np.allclose(centre, [13.5, 1.5, 16.5], atol=0.6)
    (folder / "log.csv").write_text("x_mm,y_mm,depth_mm\n0,0,1\n1,1,1")
    with pytest.raises(UserError, match=r"2 rows, and the video 6 frames.*--param column=COLUMN"):
        open_recording(folder)
