"""Data set v1: loose PNG files, an append-only journal, and a header.

dataset.json       what holds for every sample; status open or closed
plan.jsonl         what is to be recorded, if that is known beforehand
metadata.jsonl     the journal: a line for every finished sample (a Hugging Face image folder)
images/000000/     PNG files, 1000 in a folder; images/reference/: the undeformed sensor
events.jsonl       reference frames, stops, warnings
splits/NAME.json   ids of training, validation and test samples
.cache/  .trash/   derived arrays, what repairs moved aside

"""

from tactibench.datasets.v1.dataset import Dataset, open_dataset
from tactibench.datasets.v1.header import FRAMES, Header
from tactibench.datasets.v1.layout import is_dataset
from tactibench.datasets.v1.sample import Draft, Sample
from tactibench.datasets.v1.splits import Split
from tactibench.datasets.v1.verify import count_samples, verify
from tactibench.datasets.v1.writer import Writer

__all__ = [
    "FRAMES",
    "Dataset",
    "Draft",
    "Header",
    "Sample",
    "Split",
    "Writer",
    "count_samples",
    "is_dataset",
    "open_dataset",
    "verify",
]
