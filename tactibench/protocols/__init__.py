"""Protocols, the questions of the benchmark: versioned, validated and hashed TOML files."""
