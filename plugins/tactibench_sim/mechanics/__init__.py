"""The dome under spherical tips and plates: from scenes to the displacement of its skin."""
