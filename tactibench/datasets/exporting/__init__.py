"""Data sets in the formats of others. Each format is one module with one function."""

from tactibench.datasets.exporting.formats import FORMATS, Exported, export

__all__ = ["FORMATS", "Exported", "export"]
