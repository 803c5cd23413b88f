"""Robots behind one protocol: UR, GRBL, cri."""
