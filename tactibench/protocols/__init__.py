"""Protocols: what is asked. Versioned TOML files, validated, hashed, never edited in place."""
