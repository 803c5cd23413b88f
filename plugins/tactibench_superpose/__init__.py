"""Superposition fit: contacts whose single-press fields add up to what the pins do."""
