"""A flat gel pad with a square grid of markers, seen from below."""
