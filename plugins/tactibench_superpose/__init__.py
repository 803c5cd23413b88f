"""Superposition fit: contacts whose single-press fields add up to the motion of the pins."""
