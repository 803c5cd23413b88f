"""Recordings of other formats: Bristol folders, CSV files, Hugging Face image folders.

``open_recording`` reads any of them, and v1 data sets, as one vocabulary; ``import_folder`` turns
one into a v1 data set.
"""

from tactibench.datasets.importing.fitted import indentation_options
from tactibench.datasets.importing.geometry import indentation, plate_scenes
from tactibench.datasets.importing.importer import import_folder
from tactibench.datasets.importing.opening import FORMATS, find_format, open_recording
from tactibench.datasets.importing.options import (
    FRAME_FOLDERS,
    PARAMETERS,
    ImportOptions,
    read_options,
)
from tactibench.datasets.importing.recording import Recording

__all__ = [
    "FORMATS",
    "FRAME_FOLDERS",
    "PARAMETERS",
    "ImportOptions",
    "Recording",
    "find_format",
    "import_folder",
    "indentation",
    "indentation_options",
    "open_recording",
    "plate_scenes",
    "read_options",
]
