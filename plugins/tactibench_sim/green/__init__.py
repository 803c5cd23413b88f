"""Tier ``green``: a linear Green's function of the dome under unilateral contact, any radius."""
