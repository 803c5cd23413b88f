"""Rigid transforms, and how a press on the dome becomes a pose of the tool."""
