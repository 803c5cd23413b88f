"""Heatmap encoders: contacts to maps that a network can draw, and back."""
