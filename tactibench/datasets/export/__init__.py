"""Export of data sets to the formats of others: Bristol folders and Hugging Face Parquet."""
