"""A run: from a request to a stored record."""
