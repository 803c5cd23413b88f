"""A sensor and a model small enough to run a protocol in a fraction of a second."""
