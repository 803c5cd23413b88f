"""Models that are the same every time, and models that are not."""
