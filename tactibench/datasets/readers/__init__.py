"""Readers of recordings: Bristol folders, CSV files, Hugging Face image folders, data sets."""
