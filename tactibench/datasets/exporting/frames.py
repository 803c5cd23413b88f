"""The PNG files of a data set as bytes: an export copies them, so that nothing is lost."""

from __future__ import annotations

import hashlib

from tactibench.datasets import Dataset, Sample
from tactibench.errors import UserError
from tactibench.png import encode_png, read_file


def file_of(dataset: Dataset, sample: Sample) -> bytes:
    """The file of a sample's image. Raises UserError when it is not the one that was written."""
    path = dataset.folder / sample.file_name
    data = read_file(path)
    if hashlib.sha256(data).hexdigest() != sample.sha256:
        raise UserError(
            f"{path} is not the file that sample {sample.id} had (its sha256 differs); see "
            f"`tactibench data verify {dataset.folder}`."
        )
    return data


def size_of(dataset: Dataset, sample: Sample) -> int:
    """Bytes of the file of a sample's image. Raises UserError when it is not there."""
    path = dataset.folder / sample.file_name
    try:
        return path.stat().st_size
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None


def rest_file(dataset: Dataset) -> bytes | None:
    """A PNG file of the sensor at rest; None where the data set has no such frame."""
    return None if dataset.rest is None else encode_png(dataset.rest)
