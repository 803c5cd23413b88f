"""Run records: identity, storage, integrity."""
