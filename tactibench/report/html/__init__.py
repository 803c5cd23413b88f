"""The report: boards and runs as one HTML file that asks no network for anything."""
